"""Compiled loops of the contact state, each one pass over the cells.

Arrays have the shape (rows, nx), with the rows of this rank. `b` is -h at depth 0, so that the gap is
``e = u - (b + depth)``. Sums are taken row by row, so that their rounding is small on large grids.
"""

from app.base.numba_cache import njit
from app.parallel.reductions import add_tuples, copy_row, njit_reassoc


@njit()
def gap(u, b, depth):
    """Return e = h + u of a cell."""
    # b + depth is exact near contact, u - b is not
    return u - (b + depth)  # (2.3)


@njit()
def right_hand_side(shape, b, admissible):
    """Compute b = -shape; 0 where the shape is NaN, which is not `admissible`."""
    for j in range(b.shape[0]):
        for i in range(b.shape[1]):
            value = shape[j, i]
            admissible[j, i] = value == value
            b[j, i] = -value if value == value else 0.0


@njit_reassoc
def _defect_row(b, depth, u, contact, factor, out):
    for i in range(b.size):
        r = -factor * gap(u[i], b[i], depth)
        out[i] = r if contact[i] else 0.0


@njit_reassoc
def defect(b, depth, u, contact, factor, out):
    """Compute out = -factor (h + u) on C, 0 elsewhere."""
    for j in range(b.shape[0]):
        _defect_row(b[j], depth, u[j], contact[j], factor, out[j])


@njit_reassoc
def _pressure_row(p, contact):
    total, highest, cells = 0.0, 0.0, 0
    for i in range(p.size):
        total += p[i]
        highest = max(highest, p[i])
        cells += contact[i] & (p[i] > 0)
    return total, highest, cells


@njit()
def sum_pressure(p, contact):
    """Return sum and maximum of p, and C's number of loaded cells."""
    total, highest, cells = 0.0, 0.0, 0  # in C with p > 0
    for j in range(p.shape[0]):
        row = _pressure_row(p[j], contact[j])
        total += row[0]
        highest = max(highest, row[1])
        cells += row[2]
    return total, highest, cells


@njit()
def compensated_sum(x, mask):
    """Return the sum of x over a mask, and its rounding error."""
    total, lost = 0.0, 0.0
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            value = x[j, i] if mask[j, i] else 0.0
            before, total = total, total + value
            added = total - before
            lost += (before - (total - added)) + (value - added)
    return total, lost


@njit_reassoc
def _sum_squares_row(x, shift, mask):
    total = 0.0
    for i in range(x.size):
        value = x[i] - shift
        total += value * value if mask[i] else 0.0
    return total


@njit_reassoc
def sum_squares(x, shift, mask):
    """Return the sum of squares of x - shift over a mask."""
    total = 0.0
    for j in range(x.shape[0]):
        total += _sum_squares_row(x[j], shift, mask[j])
    return total


@njit_reassoc
def _gap_row(b, depth, u, mask, overlapping):
    squares, total, cells = 0.0, 0.0, 0
    for i in range(b.size):
        e = gap(u[i], b[i], depth)
        inside = mask[i] | (overlapping[i] & (e <= 0))
        e = e if inside else 0.0
        squares += e * e
        total += e
        cells += inside
    return squares, total, cells


@njit_reassoc
def sum_gaps(b, depth, u, mask, overlapping):
    """Return sum of squared gaps, sum of gaps, and number of cells.

    Summed are the cells in `mask`, and the cells in `overlapping` with a gap h + u <= 0.
    """
    sums = 0.0, 0.0, 0
    for j in range(b.shape[0]):
        sums = add_tuples(sums, _gap_row(b[j], depth, u[j], mask[j], overlapping[j]))
    return sums


@njit_reassoc
def _count_differences(row, other):
    count = 0
    for i in range(row.size):
        count += row[i] != other[i]
    return count


@njit()
def count_faces(contact, before, periodic):
    """Count the faces between contact cells and other cells.

    A face lies between two neighbouring cells. Return the numbers of faces in x and in y. `before` is the row before
    the first row. The upper faces of the last row are left out.
    """
    in_x, in_y = 0, 0
    for j in range(contact.shape[0]):
        row = contact[j]
        in_x += _count_differences(row[1:], row[:-1])
        in_x += row[0] != row[-1] if periodic else int(row[0]) + int(row[-1])
        in_y += _count_differences(row, contact[j - 1] if j else before)
    return in_x, in_y


@njit_reassoc
def _lengthen_row(contact, runs, enough):
    longest = 0
    for i in range(contact.size):
        run = min(runs[i] + 1, enough) if contact[i] else 0
        runs[i] = run
        longest = max(longest, run)
    return longest


@njit_reassoc
def _count_and_shift(run, cells):
    """Count the cells that begin a run; keep those that begin a run longer by one."""
    count = 0
    for i in range(cells):
        count += run[i]
        run[i] &= run[i + 1]
    return count


@njit()
def longest_runs(contact, wraps, enough, runs, buffer):
    """Return the longest runs of contact cells in x and y, up to `enough` cells, at most 255.

    `runs`, uint8 of shape (nx,), has the runs in y that end in the row before; on return those that end in the last
    row. If `wraps` is true, a row continues at its begin. `buffer` is a work array, bool of shape (nx + enough,).
    """
    nx, in_x, in_y = contact.shape[1], 0, 0
    for j in range(contact.shape[0]):
        in_y = max(in_y, _lengthen_row(contact[j], runs, enough))
        copy_row(contact[j], buffer[:nx])
        for i in range(enough):
            buffer[nx + i] = wraps and contact[j, i % nx]
        length = 0
        while length < enough and _count_and_shift(buffer, nx + enough - 1 - length):
            length += 1
        in_x = max(in_x, length)
    return in_x, in_y
