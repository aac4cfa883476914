"""The loops of the bounds on the pressure, compiled: p >= 0, called by `app.contact.bounds.PressureBounds` alone.

Arrays are (rows, nx) of a rank; `b` is -h at no depth, so that (2.3) is ``e = u - (b + depth)``. Sums are per row
first, so that they lose nothing on large grids.
"""

from __future__ import annotations

import numpy as np

from app.base.numba_cache import njit
from app.contact.kernels import gap
from app.parallel.reductions import add_tuples, njit_reassoc


@njit_reassoc
def violation(p, admissible):
    """By how much the pressure of a cell is outside its bounds; negative inside."""
    return -p if admissible else abs(p)


@njit_reassoc
def displaced(without, closed):
    """Displacement of a cell: `closed` if that takes a pressure within its bounds, else as `without` pressure."""
    return max(without, closed)


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
    """(4.a): take cells with p < 0 out of C, set p = 0 there, mark them; return their number.

    The change of p is added to `change`, unless that has no rows.
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
    """Sum of p, and of -p where p < 0 on C."""
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
    gaps, distances = 0.0, 0.0
    for i in range(b.size):
        e, h = gap(u[i], b[i], depth), b[i] + depth
        gaps += e * e if contact[i] else 0.0
        distances += h * h if contact[i] else 0.0
    return gaps, distances


@njit_reassoc
def _sum_row(x):
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total


@njit()
def activate(b, depth, u, p, admissible, contact, released, expected, overlap):
    """(4.b): put cells outside C into it where h + u <= 0, u changed as expected; clear `released`.

    Without rows `expected` is zero. Returns the number of cells in C, of those added, and of those released and not
    added again, the sums of squares of h + u and of h over the new C, and the sum of p. `overlap`: room for a row.
    """
    cells, squares, total = (0, 0, 0), (0.0, 0.0), 0.0
    for j in range(b.shape[0]):
        if not expected.size:
            _overlap_row(b[j], depth, u[j], overlap)
        else:
            _predicted_overlap_row(b[j], depth, u[j], expected[j], overlap)
        here = _activate_row(overlap, admissible[j], contact[j], released[j])
        cells = add_tuples(cells, here)
        if here[0]:
            squares = add_tuples(squares, _squares_row(b[j], depth, u[j], contact[j]))
        total += _sum_row(p[j])
        released[j] = False
    return cells + squares + (total,)


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
    """out = max(p, 0) in some cells, 0 elsewhere; return its sum. In place if they are one."""
    total = 0.0
    for j in range(p.shape[0]):
        total += _project_row(p[j], cells[j], out[j])
    return total


@njit_reassoc
def _exchange_row(p, w, change, b, admissible, contact, slack, least_gap, compliance, far, captured):
    cells, came, left, total, moves = 0, 0, 0, 0.0, 0.0
    for i in range(p.size):
        inside, here = contact[i], w[i] + change[i]
        e = here - b[i]
        leaves = inside & (p[i] < -slack)
        comes = (not inside) & admissible[i] & (e < least_gap)
        moved = p[i] * compliance if leaves else (e if comes else 0.0)
        captured[i] = comes
        contact[i] = (inside & (not leaves)) | comes
        came += comes
        left += leaves
        cells += contact[i]
        total += here
        moves += moved * moved if abs(moved) <= far else np.inf
    return cells, came, left, total, moves


@njit()
def exchange(p, w, change, b, admissible, contact, slack, least_gap, compliance, far, captured):
    """(4.a) and (4.b) in one: release cells of C with p < -slack, capture others with w + change - b < least_gap.

    Returns the number of cells in C, captured and released, the sum of w + change, and the sum of squares of the least
    change of w there: the gap, or p times a compliance. It is infinite if one of these is more than `far`.
    """
    sums = 0, 0, 0, 0.0, 0.0
    for j in range(p.shape[0]):
        row = _exchange_row(
            p[j], w[j], change[j], b[j], admissible[j], contact[j], slack, least_gap, compliance, far,
            captured[j],
        )  # fmt: skip
        sums = add_tuples(sums, row)
    return sums
