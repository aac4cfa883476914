"""Compiled loops of `app.contact.certificate`.

Arrays are as in `app.contact.kernels`. In inadmissible cells the gap e counts as zero.
"""

import math

import numpy as np

from app.base.numba_cache import njit
from app.contact.bounds_kernels import violation
from app.contact.kernels import gap
from app.parallel.reductions import add_tuples, njit_reassoc


@njit_reassoc
def _gaps_row(b, depth, u, p, admissible, diagonal):
    gaps, excess, to_p, pressures, squares, total_u, free = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        near = p[i] / diagonal
        g = max(e - near, 0.0)
        gaps += g
        excess += max(-near, -e)
        to_p += p[i] * g
        pressures += p[i]
        squares += p[i] * p[i]
        total_u += u[i]
        free += 0.0 if p[i] > 0 else 1.0
    return gaps, excess, to_p, pressures, squares, total_u, free


@njit()
def gaps(b, depth, u, p, admissible, diagonal):
    """Return the sums that certify a pressure on a periodic patch.

    The summed fields are: g = max(e - p / B_II, 0), g - e, p g, p, p p, and u. The last number counts the cells without
    pressure. `diagonal` is B_II, where B is the inverse of A.
    """
    sums = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(b.shape[0]):
        sums = add_tuples(sums, _gaps_row(b[j], depth, u[j], p[j], admissible[j], diagonal))
    return sums


@njit_reassoc
def _move_row(b, depth, u, p, admissible, diagonal, stretch, constant, elsewhere, scale, field):
    squares, product = 0.0, 0.0
    for i in range(b.size):
        e, near = gap(u[i], b[i], depth), p[i] / diagonal
        w = max(-near, -e) + (stretch * max(e - near, 0.0) + constant)
        w = w if admissible[i] else elsewhere
        squares += w * w
        if field.size:
            product += w * field[i]
            field[i] = scale * w
    return squares, product


@njit()
def move(b, depth, u, p, admissible, diagonal, stretch, constant, elsewhere, scale, field):
    """Return w.w and w.field; set `field` to scale*w.

    w is the change from the gap e to the dual feasible gap, by the numbers of `certificate._gap_with_mean`.
    If `field` has no columns, only w.w is computed.
    """
    sums = 0.0, 0.0
    for j in range(b.shape[0]):
        row = b[j], depth, u[j], p[j], admissible[j]
        sums = add_tuples(sums, _move_row(*row, diagonal, stretch, constant, elsewhere, scale, field[j]))
    return sums


@njit_reassoc
def _scan_row(b, depth, u, p, admissible):
    penetration, deepest, highest, u_squares = 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        h = b[i] + depth if admissible[i] else 0.0
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        penetration = max(penetration, -e)
        deepest = max(deepest, abs(h))
        highest = max(highest, abs(p[i]))
        u_squares += u[i] * u[i]
    return penetration, deepest, highest, u_squares


@njit_reassoc
def _survey_row(b, depth, u, p, admissible, smallest):
    tension, product, highest = -np.inf, 0.0, -np.inf
    energy, defect, to_p, moved, p_squares = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        tension = max(tension, violation(p[i], admissible[i]))
        product = max(product, abs(p[i] * e))
        highest = max(highest, p[i])
        energy += p[i] * u[i]
        defect += p[i] * e
        near = smallest * p[i]
        to_p += p[i] * max(e - near, 0.0)
        change = min(near, e)
        moved += change * change
        p_squares += p[i] * p[i]
    return tension, product, highest, energy, defect, to_p, moved, p_squares


@njit_reassoc
def _lift_row(b, depth, u, admissible):
    lift = 0.0
    for i in range(b.size):
        penetration = -gap(u[i], b[i], depth)
        if penetration > lift * u[i] and u[i] > 0 and admissible[i]:
            lift = penetration / u[i]  # a division only where the maximum grows
    return lift


_NO_CONTACT = (0.0,) * 8  # result of `_survey_row` without pressure and overlap


@njit()
def survey(b, depth, u, p, admissible, smallest, lifts, penetrates, largest, sums):
    """Update maxima and sums of gaps and pressures.

    `largest` gets the maxima of: -e / u, -e, |h|, the violation of p >= 0, |p e|, and p. `sums` gets the sums of: u u,
    p u, p e, p g, w w, and p p. Here g = max(e - p times the smallest eigenvalue, 0) and w = g - e. In inadmissible
    cells h and e count as zero. Rows without pressure and penetration are only scanned. ``penetrates[j]`` is set if e <
    0 in row j. -e / u is computed only if `lifts` is true.
    """
    for j in range(b.shape[0]):
        penetration, deepest, highest, u_squares = _scan_row(b[j], depth, u[j], p[j], admissible[j])
        penetrates[j] = penetration > 0
        lift = _lift_row(b[j], depth, u[j], admissible[j]) if lifts and penetration > 0 else 0.0
        row = _NO_CONTACT
        if not (penetration <= 0 and highest <= 0):  # or NaN
            row = _survey_row(b[j], depth, u[j], p[j], admissible[j], smallest)
        for k, value in enumerate((lift, penetration, deepest) + row[:3]):
            largest[k] = max(largest[k], value)
        for k, value in enumerate((u_squares,) + row[3:]):
            sums[k] += value


@njit()
def lift(b, depth, u, admissible, most, penetrates, sums):
    """Sum products of e and u over penetrating cells, for several t.

    Trial k has t = most / 2^k; the last trial has t = 0. A cell belongs to the first trial for which
    ``w = max(-(e + t u), 0)`` is positive. Column k of `sums` has the sums of -e u, e e and u u over the cells of trial
    k. Sums over columns up to k give the sums of w u and w w. Rows that do not penetrate are skipped.
    """
    trials = sums.shape[1] - 1
    for j in range(b.shape[0]):
        if not penetrates[j]:
            continue
        for i in range(b.shape[1]):
            value = u[j, i]
            e = gap(value, b[j, i], depth)
            if e < 0 and admissible[j, i]:
                first = 0
                if most * value > -e:
                    first = min(math.frexp(most * value / -e)[1], trials)
                sums[0, first] -= e * value
                sums[1, first] += e * e
                sums[2, first] += value * value
