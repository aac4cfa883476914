"""Compiled loops of `app.contact.bounds.CappedBounds`: 0 <= p <= H.

The loops correspond to the loops in `app.contact.bounds_kernels`, which are for p >= 0. `upper` is the hardness H, of
shape (rows, nx). Outside the contact set C a cell with p >= H is plastic; any other cell is open.
"""

import numpy as np

from app.base.numba_cache import njit
from app.contact.bounds_kernels import NO_CELLS, enter_row
from app.contact.kernels import gap
from app.parallel.reductions import add_row, add_tuples, njit_reassoc


@njit_reassoc
def clipped_displacement(free, closed, room):
    """Return the displacement of a cell whose pressure is within bounds.

    `closed` is the displacement that closes the gap. It is limited to the range from `free`, the displacement without
    pressure, to `free + room`, the displacement under the pressure H.
    """
    return max(free, min(closed, free + room))


@njit_reassoc
def _release_row(p, upper, contact, released):
    count = 0
    for i in range(p.size):
        value = min(max(p[i], 0.0), upper[i])
        out = contact[i] & (value != p[i])
        released[i] = out
        contact[i] &= not out
        count += out
        p[i] = value if out else p[i]
    return count


@njit_reassoc
def _change_row(p, upper, contact, change):
    for i in range(p.size):
        above = p[i] - upper[i]
        change[i] -= p[i] if contact[i] & (p[i] < 0) else 0.0
        change[i] -= above if contact[i] & (above > 0) else 0.0


@njit()
def release(p, upper, contact, released, change):
    """Remove cells that violate a bound, with p set to the bound.

    Cells with p < 0 or p > H are removed from C, and marked in `released`. Return their number. The change of p is
    added to `change`, unless this array has size 0.
    """
    count = 0
    for j in range(p.shape[0]):
        if change.size:
            _change_row(p[j], upper[j], contact[j], change[j])
        count += _release_row(p[j], upper[j], contact[j], released[j])
    return count


@njit()
def _leave_row(b, depth, u, p, upper, leaves):
    for i in range(b.size):
        e = gap(u[i], b[i], depth)
        leaves[i] = (e >= 0) if p[i] >= upper[i] else (e <= 0)


@njit()
def _predicted_leave_row(b, depth, u, p, upper, expected, leaves):
    for i in range(b.size):
        e = gap(u[i], b[i], depth) + expected[i]
        leaves[i] = ((e >= 0) if p[i] >= upper[i] else (e <= 0)) & (expected[i] < np.inf)


@njit()
def activate(b, depth, u, p, upper, admissible, contact, released, expected, leaves):
    """Add cells outside C that would leave their bound, and clear `released`.

    Open cells enter C if their gap h + u + expected <= 0, plastic cells if their gap >= 0. Parameters and result are as
    in `app.contact.bounds_kernels.activate`; `leaves` is a work array of shape (nx,).
    """
    sums = NO_CELLS
    for j in range(b.shape[0]):
        if not expected.size:
            _leave_row(b[j], depth, u[j], p[j], upper[j], leaves)
        else:
            _predicted_leave_row(b[j], depth, u[j], p[j], upper[j], expected[j], leaves)
        sums = add_tuples(
            sums, enter_row(leaves, admissible[j], contact[j], released[j], b[j], depth, u[j], p[j])
        )
    return sums


@njit_reassoc
def _project_row(p, upper, cells, out):
    total = 0.0
    for i in range(p.size):
        value = min(max(p[i], 0.0), upper[i]) if cells[i] else 0.0
        out[i] = value
        total += value
    return total


@njit()
def project(p, upper, cells, out):
    """Store p in `out`, clipped to its bounds; return the sum.

    Outside of `cells` the stored pressure is 0. The sum is over `out`.
    """
    total = 0.0
    for j in range(p.shape[0]):
        total += _project_row(p[j], upper[j], cells[j], out[j])
    return total


@njit_reassoc
def _violations_row(p, upper, contact):
    total, outside = 0.0, 0.0
    for i in range(p.size):
        total += p[i]
        violation = abs(p[i] - min(max(p[i], 0.0), upper[i]))
        outside += violation if contact[i] else 0.0
    return total, outside


@njit()
def violations(p, upper, contact):
    """Return the sum of p, and the sum of its violations of 0 <= p <= H in C."""
    sums = 0.0, 0.0
    for j in range(p.shape[0]):
        sums = add_tuples(sums, _violations_row(p[j], upper[j], contact[j]))
    return sums


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
                value = min(max(p[j, i] + step, 0.0), upper[j, i])
                total += value - p[j, i]
                p[j, i] = value
    return total


@njit_reassoc
def _exchange_row(
    p, upper, w, change, b, admissible, contact, plastic, slack, least_gap, compliance, far, captured, shift
):  # fmt: skip
    cells, added, removed, shifted, total, moves = 0, 0, 0, 0, 0.0, 0.0
    for i in range(p.size):
        inside, full, new_w, value = contact[i], plastic[i], w[i] + change[i], np.float64(p[i])
        e, above = new_w - b[i], value - upper[i]
        opens, hardens = inside & (value < -slack), inside & (above > slack)
        softens = full & (e > -least_gap)
        enters = softens | ((not inside) & (not full) & admissible[i] & (e < least_gap))
        leaves = opens | hardens
        moved = value * compliance if opens else (above * compliance if hardens else (e if enters else 0.0))
        shift[i] = upper[i] if softens else (-upper[i] if hardens else 0.0)
        captured[i] = enters
        contact[i] = (inside & (not leaves)) | enters
        plastic[i] = (full & (not softens)) | hardens
        cells += contact[i]
        added += enters
        removed += leaves
        shifted += softens | hardens
        total += new_w
        moves += moved * moved if abs(moved) <= far else np.inf
    return cells, added, removed, shifted, total, moves


@njit()
def exchange(
    p, stored, upper, w, change, b, admissible, contact, plastic, slack, least_gap, compliance, far, captured, shift
):  # fmt: skip
    """Exchange cells of the contact set C with open and plastic cells.

    In `plastic` cells, `p` is the pressure minus H; elsewhere `p` is the pressure. `stored` is an earlier `p`. H is
    added to `p` and `stored` where cells cease to be plastic, and subtracted where they become plastic. Cells of C with
    p < -slack become open, cells with p > H + slack become plastic. Open cells with a gap below `least_gap`, and
    plastic cells with a gap above -`least_gap`, enter C and are marked in `captured`. `shift` is a work array of shape
    (nx,). Other parameters and the result are as in `app.contact.bounds_kernels.exchange`.
    """
    sums = 0, 0, 0, 0, 0.0, 0.0
    for j in range(p.shape[0]):
        row = _exchange_row(
            p[j], upper[j], w[j], change[j], b[j], admissible[j], contact[j], plastic[j], slack, least_gap, compliance,
            far, captured[j], shift,
        )  # fmt: skip
        sums = add_tuples(sums, row)
        if row[3]:
            add_row(p[j], 1.0, shift)
            add_row(stored[j], 1.0, shift)
    return sums[:3] + sums[4:]


@njit_reassoc
def _local_load_row(b, depth, u, p, upper, admissible, t, compliance):
    total, free = 0.0, 0
    for i in range(b.size):
        value = p[i] - (gap(u[i], b[i], depth) - t) / compliance
        free += admissible[i] & (value > 0) & (value < upper[i])
        value = min(max(value, 0.0), upper[i])
        total += value if admissible[i] else 0.0
    return total, free


@njit()
def local_load(b, depth, u, p, upper, admissible, t, compliance):
    """Return the sum of pressures after all cells have approached by t.

    Return also the number of cells whose pressure is then between its bounds. Cells do not act on each other: p changes
    by (t - gap) / `compliance`, within the bounds.
    """
    sums = 0.0, 0
    for j in range(b.shape[0]):
        row = _local_load_row(b[j], depth, u[j], p[j], upper[j], admissible[j], t, compliance)
        sums = add_tuples(sums, row)
    return sums
