"""Compiled loops of `app.contact.bounds.PressureBounds`, for p >= 0.

Arrays are as in `app.contact.kernels`.
"""

import numpy as np

from app.base.numba_cache import njit
from app.contact.kernels import gap
from app.parallel.reductions import add_tuples, njit_reassoc, sum_row

NO_CELLS = 0, 0, 0, 0.0, 0.0, 0.0  # result of `activate` without cells


@njit_reassoc
def violation(p, admissible):
    """Return how much a pressure violates p >= 0."""
    return -p if admissible else abs(p)


@njit_reassoc
def projected_displacement(free, closed):
    """Return a cell's displacement, with or without pressure.

    `closed` is the displacement that closes the gap, `free` that without pressure. Return `closed` if it needs p >= 0,
    otherwise `free`.
    """
    return max(free, closed)


@njit_reassoc
def _change_by_release_row(p, contact, change):
    for i in range(p.size):
        change[i] -= p[i] if contact[i] & (p[i] < 0) else 0.0


@njit_reassoc
def _release_row(p, contact, released):
    count = 0
    for i in range(p.size):
        out = contact[i] & (p[i] < 0)
        released[i] = out
        contact[i] &= not out
        count += out
        p[i] = 0.0 if out else p[i]
    return count


@njit()
def release(p, contact, released, change):
    """Remove cells with p < 0 from the contact set C.

    In these cells p is set to zero and `released` to true. Return their number. The change of p is added to `change`,
    unless this array has size 0.
    """
    count = 0
    for j in range(p.shape[0]):
        if change.size:
            _change_by_release_row(p[j], contact[j], change[j])
        count += _release_row(p[j], contact[j], released[j])
    return count


@njit_reassoc
def _tension_row(p, contact):
    total, negative = 0.0, 0.0
    for i in range(p.size):
        total += p[i]
        negative -= p[i] if contact[i] & (p[i] < 0) else 0.0
    return total, negative


@njit()
def tension(p, contact):
    """Return the sum of p, and of -p in tensile contact cells."""
    sums = 0.0, 0.0
    for j in range(p.shape[0]):
        sums = add_tuples(sums, _tension_row(p[j], contact[j]))
    return sums


@njit()
def _overlap_row(b, depth, u, overlap):
    for i in range(b.size):
        overlap[i] = gap(u[i], b[i], depth) <= 0


@njit()
def _predicted_overlap_row(b, depth, u, expected, overlap):
    for i in range(b.size):
        overlap[i] = gap(u[i] + expected[i], b[i], depth) <= 0


@njit_reassoc
def _activate_row(overlap, admissible, contact, released):
    """Add overlapping admissible cells to C; return the counts of `activate`."""
    cells, added, lost = 0, 0, 0
    for i in range(contact.size):
        new = (not contact[i]) & admissible[i] & overlap[i]
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
def enter_row(enters, admissible, contact, released, b, depth, u, p):
    """Add a row's cells marked in `enters` to C; see `activate`."""
    cells, squares = _activate_row(enters, admissible, contact, released), (0.0, 0.0)
    if cells[0]:
        squares = _squares_row(b, depth, u, contact)
    released[:] = False
    return cells + squares + (sum_row(p),)


@njit()
def activate(b, depth, u, p, admissible, contact, released, expected, overlap):
    """Add overlapping cells to the contact set C, and clear `released`.

    Admissible cells overlap if ``h + u + expected <= 0``. `expected` is a predicted change of u; an array of size 0
    stands for no change. `released` marks the cells that were removed from C just before. `overlap` is a work array of
    shape (nx,).

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
            _overlap_row(b[j], depth, u[j], overlap)
        else:
            _predicted_overlap_row(b[j], depth, u[j], expected[j], overlap)
        sums = add_tuples(
            sums, enter_row(overlap, admissible[j], contact[j], released[j], b[j], depth, u[j], p[j])
        )
    return sums


@njit_reassoc
def _project_row(p, cells, out):
    total = 0.0
    for i in range(p.size):
        value = max(p[i], 0.0) if cells[i] else 0.0
        out[i] = value
        total += value
    return total


@njit_reassoc
def project(p, cells, out):
    """Set `out` to max(p, 0) in `cells`, else 0; return its sum."""
    total = 0.0
    for j in range(p.shape[0]):
        total += _project_row(p[j], cells[j], out[j])
    return total


@njit_reassoc
def _exchange_row(p, w, change, b, admissible, contact, slack, least_gap, compliance, far, captured):
    cells, added, removed, total, moves = 0, 0, 0, 0.0, 0.0
    for i in range(p.size):
        inside, new_w = contact[i], w[i] + change[i]
        e = new_w - b[i]
        leaves = inside & (p[i] < -slack)
        enters = (not inside) & admissible[i] & (e < least_gap)
        moved = p[i] * compliance if leaves else (e if enters else 0.0)
        captured[i] = enters
        contact[i] = (inside & (not leaves)) | enters
        added += enters
        removed += leaves
        cells += contact[i]
        total += new_w
        moves += moved * moved if abs(moved) <= far else np.inf
    return cells, added, removed, total, moves


@njit()
def exchange(p, w, change, b, admissible, contact, slack, least_gap, compliance, far, captured):
    """Release and capture cells of the contact set in one pass.

    `w` is u minus the depth, and `change` is added to it later. Cells of the contact set with p < -slack are released
    from it. Other admissible cells with a gap e = w + change - b < least_gap are captured: they enter the contact set,
    and are marked in `captured`.

    Return five numbers:

    1. contact cells;
    2. captured cells;
    3. released cells;
    4. sum of w + change;
    5. sum of squared moves, infinite if a cell moves by more than `far`. A captured cell moves by its gap, a released
       cell by p times `compliance`.
    """
    sums = 0, 0, 0, 0.0, 0.0
    for j in range(p.shape[0]):
        row = _exchange_row(
            p[j], w[j], change[j], b[j], admissible[j], contact[j], slack, least_gap, compliance, far,
            captured[j],
        )  # fmt: skip
        sums = add_tuples(sums, row)
    return sums
