"""Compiled loops of `app.contact.bounds.PressureBounds`.

`upper` is the hardness H, of shape (rows, nx), or None for p >= 0. For None numba compiles each loop without the
branches for H; loops about plastic cells need an array. Outside the contact set C a cell with p >= H is plastic; any
other cell is open. Other arrays are as in `app.contact.loops`.
"""

import numpy as np

from app.base.numba_cache import njit
from app.contact.loops import gap
from app.parallel.reductions import add_row, add_tuples, njit_reassoc, sum_row

NO_CELLS = 0, 0, 0, 0.0, 0.0, 0.0  # result of `activate` without cells


@njit_reassoc
def clip(value, upper, j, i):
    """Return a pressure of cell (j, i), limited to its bounds."""
    if upper is None:
        return max(value, 0.0)
    return min(max(value, 0.0), upper[j, i])


@njit_reassoc
def violation(p, upper, j, i, admissible):
    """Return how much a pressure of cell (j, i) violates its bounds."""
    if upper is None:
        return -p if admissible else abs(p)
    return max(-p, p - upper[j, i]) if admissible else abs(p)


@njit_reassoc
def is_plastic(p, upper, j, i):
    """Return whether p is at the upper bound of cell (j, i)."""
    if upper is None:
        return False
    return p >= upper[j, i]


@njit_reassoc
def clipped_displacement(free, closed, room, i):
    """Return the displacement of cell i whose pressure is within bounds.

    `closed` is the displacement that closes the gap. It is limited to the range from `free`, the displacement without
    pressure, to `free + room[i]`, the displacement under the pressure H.
    """
    if room is None:
        return max(free, closed)
    return max(free, min(closed, free + room[i]))


@njit_reassoc
def _change_row(p, upper, j, contact, change):
    for i in range(p.size):
        change[i] += clip(p[i], upper, j, i) - p[i] if contact[i] else 0.0


@njit_reassoc
def _release_row(p, upper, j, contact, released):
    count = 0
    for i in range(p.size):
        value = clip(p[i], upper, j, i)
        out = contact[i] & (value != p[i])
        released[i] = out
        contact[i] &= not out
        count += out
        p[i] = value if out else p[i]
    return count


@njit()
def release(p, upper, contact, released, change):
    """Remove cells that violate a bound from C, with p set to the bound.

    Cells with p < 0 or p > H are removed, and marked in `released`. Return their number. The change of p is added to
    `change`, unless this array has size 0.
    """
    count = 0
    for j in range(p.shape[0]):
        if change.size:
            _change_row(p[j], upper, j, contact[j], change[j])
        count += _release_row(p[j], upper, j, contact[j], released[j])
    return count


@njit_reassoc
def _violations_row(p, upper, j, contact):
    total, outside = 0.0, 0.0
    for i in range(p.size):
        total += p[i]
        outside += abs(p[i] - clip(p[i], upper, j, i)) if contact[i] else 0.0
    return total, outside


@njit()
def tension(p, upper, contact):
    """Return the sum of p, and the sum of its violations of the bounds in C."""
    sums = 0.0, 0.0
    for j in range(p.shape[0]):
        sums = add_tuples(sums, _violations_row(p[j], upper, j, contact[j]))
    return sums


@njit()
def _leave_row(b, depth, u, p, upper, j, leaves):
    for i in range(b.size):
        e = gap(u[i], b[i], depth)
        leaves[i] = e >= 0 if is_plastic(p[i], upper, j, i) else e <= 0


@njit()
def _predicted_leave_row(b, depth, u, p, upper, j, expected, leaves):
    for i in range(b.size):
        e = gap(u[i] + expected[i], b[i], depth)
        leaves[i] = (e >= 0) & (expected[i] < np.inf) if is_plastic(p[i], upper, j, i) else e <= 0


@njit_reassoc
def _activate_row(leaves, admissible, contact, released):
    """Add admissible cells that leave their bound to C; return the counts of `activate`."""
    cells, added, lost = 0, 0, 0
    for i in range(contact.size):
        new = (not contact[i]) & admissible[i] & leaves[i]
        contact[i] |= new
        cells += contact[i]
        added += new & (not released[i])
        lost += released[i] & (not contact[i])
    return cells, added, lost


@njit_reassoc
def _squares_row(b, depth, u, contact):
    """Return sums of gap^2 and h^2 over contact cells."""
    gaps, distances = 0.0, 0.0
    for i in range(b.size):
        e, h = gap(u[i], b[i], depth), b[i] + depth
        gaps += e * e if contact[i] else 0.0
        distances += h * h if contact[i] else 0.0
    return gaps, distances


@njit()
def activate(b, depth, u, p, upper, admissible, contact, released, expected, leaves):
    """Add cells to C that would leave their bound, and clear `released`.

    Open cells enter C if they overlap, ``h + u + expected <= 0``, plastic cells if they have a gap, ``h + u + expected
    >= 0``. `expected` is a predicted change of u; an array of size 0 stands for no change. `released` marks the cells
    that were removed from C just before. `leaves` is a work array of shape (nx,).

    Return six numbers:

    1. cells in C;
    2. added cells that were not in `released`;
    3. cells in `released` that were not added again;
    4. sum of (h + u)^2 over the new C;
    5. sum of h^2 over the new C;
    6. sum of p.
    """
    sums = NO_CELLS
    for j in range(b.shape[0]):
        if not expected.size:
            _leave_row(b[j], depth, u[j], p[j], upper, j, leaves)
        else:
            _predicted_leave_row(b[j], depth, u[j], p[j], upper, j, expected[j], leaves)
        cells, squares = _activate_row(leaves, admissible[j], contact[j], released[j]), (0.0, 0.0)
        if cells[0]:
            squares = _squares_row(b[j], depth, u[j], contact[j])
        released[j, :] = False
        sums = add_tuples(sums, cells + squares + (sum_row(p[j]),))
    return sums


@njit_reassoc
def _project_row(p, upper, j, cells, out):
    total = 0.0
    for i in range(p.size):
        value = clip(p[i], upper, j, i) if cells[i] else 0.0
        out[i] = value
        total += value
    return total


@njit_reassoc
def project(p, upper, cells, out):
    """Store p in `out`, clipped to its bounds; return the sum.

    Outside of `cells` the stored pressure is 0. The sum is over `out`.
    """
    total = 0.0
    for j in range(p.shape[0]):
        total += _project_row(p[j], upper, j, cells[j], out[j])
    return total


@njit_reassoc
def _exchange_row(
    p, upper, j, w, change, b, admissible, contact, plastic, slack, least_gap, compliance, far, captured, shift
):  # fmt: skip
    cells, added, removed, shifted, total, moves = 0, 0, 0, 0, 0.0, 0.0
    for i in range(p.size):
        inside, new_w, value = contact[i], w[i] + change[i], np.float64(p[i])
        e = new_w - b[i]
        leaves = inside & (value < -slack)
        enters = (not inside) & admissible[i] & (e < least_gap)
        moved = value * compliance if leaves else (e if enters else 0.0)
        if upper is not None:
            full, above = plastic[j, i], value - upper[j, i]
            hardens, softens = inside & (above > slack), full & (e > -least_gap)
            enters = softens | (enters & (not full))
            moved = above * compliance if hardens else (moved if leaves else (e if enters else 0.0))
            leaves |= hardens
            shift[i] = upper[j, i] if softens else (-upper[j, i] if hardens else 0.0)
            plastic[j, i] = (full & (not softens)) | hardens
            shifted += softens | hardens
        captured[i] = enters
        contact[i] = (inside & (not leaves)) | enters
        added += enters
        removed += leaves
        cells += contact[i]
        total += new_w
        moves += moved * moved if abs(moved) <= far else np.inf
    return cells, added, removed, shifted, total, moves


@njit()
def exchange(
    p, stored, upper, w, change, b, admissible, contact, plastic, slack, least_gap, compliance, far, captured, shift
):  # fmt: skip
    """Exchange cells of the contact set C with open and plastic cells, in one pass.

    `w` is u minus the depth, and `change` is added to it later. Cells of C with p < -slack become open, cells with p >
    H + slack become plastic. Open admissible cells with a gap e = w + change - b below `least_gap`, and plastic cells
    with a gap above -`least_gap`, enter C and are marked in `captured`.

    In `plastic` cells, `p` is the pressure minus H; elsewhere `p` is the pressure. `stored` is an earlier `p`. H is
    added to `p` and `stored` where cells cease to be plastic, and subtracted where they become plastic. `shift` is a
    work array of shape (nx,). Without H, `stored`, `plastic` and `shift` are None.

    Return five numbers:

    1. contact cells;
    2. captured cells;
    3. released cells;
    4. sum of w + change;
    5. sum of squared moves, infinite if a cell moves by more than `far`. A captured cell moves by its gap, a released
       cell by its violation of the bound times `compliance`.
    """
    sums = 0, 0, 0, 0, 0.0, 0.0
    for j in range(p.shape[0]):
        row = _exchange_row(
            p[j], upper, j, w[j], change[j], b[j], admissible[j], contact[j], plastic, slack, least_gap, compliance,
            far, captured[j], shift,
        )  # fmt: skip
        sums = add_tuples(sums, row)
        if upper is not None and row[3]:
            add_row(p[j], 1.0, shift)
            add_row(stored[j], 1.0, shift)
    return sums[:3] + sums[4:]


@njit_reassoc
def _count_row(p, upper, admissible, factor):
    plastic = 0
    for i in range(p.size):
        plastic += admissible[i] & (factor * p[i] >= upper[i])
    return plastic


@njit()
def count_plastic(p, upper, admissible, factor):
    """Count admissible cells with `factor` * p >= H."""
    cells = 0
    for j in range(p.shape[0]):
        cells += _count_row(p[j], upper[j], admissible[j], factor)
    return cells


@njit_reassoc
def _nearest_bound_row(p, upper, admissible):
    total = 0.0
    for i in range(p.size):
        total += upper[i] if admissible[i] & (2 * p[i] > upper[i]) else 0.0
    return total


@njit()
def sum_at_nearest_bound(p, upper, admissible):
    """Return the sum of H over the admissible cells with p > H / 2."""
    total = 0.0
    for j in range(p.shape[0]):
        total += _nearest_bound_row(p[j], upper[j], admissible[j])
    return total


@njit_reassoc
def _room_row(p, upper, contact, up):
    cells = 0
    if up:
        for i in range(p.size):
            cells += contact[i] & (p[i] < upper[i])
    else:
        for i in range(p.size):
            cells += contact[i] & (p[i] > 0)
    return cells


@njit()
def room(p, upper, contact, step):
    """Count the cells of C where p has not reached a bound.

    The bound is the upper one if `step` is positive, otherwise the lower one.
    """
    cells = 0
    for j in range(p.shape[0]):
        cells += _room_row(p[j], upper[j], contact[j], step > 0)
    return cells


@njit()
def add_constant(p, upper, contact, step):
    """Add the constant `step` to p on C, within the bounds.

    Return the sum of the changes of p.
    """
    total = 0.0
    for j in range(p.shape[0]):
        for i in range(p.shape[1]):
            if contact[j, i]:
                value = clip(p[j, i] + step, upper, j, i)
                total += value - p[j, i]
                p[j, i] = value
    return total


@njit_reassoc
def _local_load_row(b, depth, u, p, upper, j, admissible, t, compliance):
    total, free = 0.0, 0
    for i in range(b.size):
        value = p[i] - (gap(u[i], b[i], depth) - t) / compliance
        free += admissible[i] & (value > 0) & (value < upper[j, i])
        total += clip(value, upper, j, i) if admissible[i] else 0.0
    return total, free


@njit()
def local_load(b, depth, u, p, upper, admissible, t, compliance):
    """Return the sum of pressures after all cells have approached by t.

    Return also the number of cells whose pressure is then between its bounds. Cells do not act on each other: p changes
    by (t - gap) / `compliance`, within the bounds.
    """
    sums = 0.0, 0
    for j in range(b.shape[0]):
        row = _local_load_row(b[j], depth, u[j], p[j], upper, j, admissible[j], t, compliance)
        sums = add_tuples(sums, row)
    return sums
