"""One pass over the cells instead of ten: the loops of the contact state, compiled.

Arrays are (rows, nx) of a rank; `b` is -h at no depth, so that (2.3) is ``e = u - (b + depth)``. Sums are per row
first, so that they lose nothing on large grids.
"""

from __future__ import annotations

from app.base.numba_cache import njit
from app.parallel.reductions import add_tuples, njit_reassoc


@njit()
def gap(u, b, depth):
    """e = h + u of a cell. In this order: near contact b + depth is exact, u - b is not."""
    return u - (b + depth)


@njit_reassoc
def _defect_row(b, depth, u, contact, factor, out):
    for i in range(b.size):
        r = -factor * gap(u[i], b[i], depth)
        out[i] = r if contact[i] else 0.0


@njit_reassoc
def defect(b, depth, u, contact, factor, out):
    """out = -(h + u) on C, times a factor, 0 elsewhere."""
    for j in range(b.shape[0]):
        _defect_row(b[j], depth, u[j], contact[j], factor, out[j])


@njit_reassoc
def _numbers_row(p, contact):
    total, highest, cells = 0.0, 0.0, 0
    for i in range(p.size):
        total += p[i]
        highest = max(highest, p[i])
        cells += contact[i] & (p[i] > 0)
    return total, highest, cells


@njit()
def numbers(p, contact):
    """Sum of p, its largest value or 0, and the number of cells in C with p > 0."""
    total, highest, cells = 0.0, 0.0, 0
    for j in range(p.shape[0]):
        row = _numbers_row(p[j], contact[j])
        total += row[0]
        highest = max(highest, row[1])
        cells += row[2]
    return total, highest, cells


@njit()
def compensated_sum(x, mask):
    """Sum over a mask, and what it loses by rounding."""
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
    """Sum of squares of x - shift over a mask."""
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
def gap_on(b, depth, u, mask, overlapping):
    """Sum of squares and sum of h + u over a mask, and where it is not positive over another; number of these cells.

    The same mask twice: over that alone.
    """
    sums = 0.0, 0.0, 0
    for j in range(b.shape[0]):
        sums = add_tuples(sums, _gap_row(b[j], depth, u[j], mask[j], overlapping[j]))
    return sums


@njit_reassoc
def _unlike(row, other):
    count = 0
    for i in range(row.size):
        count += row[i] != other[i]
    return count


@njit()
def faces(contact, before, periodic):
    """Faces in x and in y between contact and no contact; without the last rows' upper ones."""
    in_x, in_y = 0, 0
    for j in range(contact.shape[0]):
        row = contact[j]
        in_x += _unlike(row[1:], row[:-1])
        in_x += row[0] != row[-1] if periodic else int(row[0]) + int(row[-1])
        in_y += _unlike(row, contact[j - 1] if j else before)
    return in_x, in_y
