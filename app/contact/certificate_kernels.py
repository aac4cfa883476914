"""The loops of the certificate, compiled.

Arrays are (rows, nx) of a rank; `b` is -h at no depth, so that the gap is ``e = u - (b + depth)``; inadmissible cells
count as e = 0. Sums are per row first, so that they lose nothing on large grids.
"""

from __future__ import annotations

import math

import numpy as np

from app.base.numba_cache import njit
from app.contact.bounds_kernels import violation
from app.contact.kernels import gap
from app.parallel.reductions import add_tuples, njit_reassoc


@njit_reassoc
def _gaps_row(b, depth, u, p, admissible, diagonal):
    gaps, excess, to_p, pressures, squares, of_u, free = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        near = p[i] / diagonal
        g = max(e - near, 0.0)
        gaps += g
        excess += max(-near, -e)
        to_p += p[i] * g
        pressures += p[i]
        squares += p[i] * p[i]
        of_u += u[i]
        free += 0.0 if p[i] > 0 else 1.0
    return gaps, excess, to_p, pressures, squares, of_u, free


@njit()
def gaps(b, depth, u, p, admissible, diagonal):
    """Sums of the gap g that is to be reached, of g - e, of p g, p, p p and u; and cells without pressure."""
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
    """Return w.w, w what e moves by to the gap that is to be reached, and w.field; `field` becomes w times a scale.

    Both only if it has columns.
    """
    sums = 0.0, 0.0
    for j in range(b.shape[0]):
        row = b[j], depth, u[j], p[j], admissible[j]
        sums = add_tuples(sums, _move_row(*row, diagonal, stretch, constant, elsewhere, scale, field[j]))
    return sums


@njit_reassoc
def _glance_row(b, depth, u, p, admissible):
    penetration, deepest, highest, of_u = 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        h = b[i] + depth if admissible[i] else 0.0
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        penetration = max(penetration, -e)
        deepest = max(deepest, abs(h))
        highest = max(highest, abs(p[i]))
        of_u += u[i] * u[i]
    return penetration, deepest, highest, of_u


@njit_reassoc
def _survey_row(b, depth, u, p, admissible, smallest):
    tension, product, highest = -np.inf, 0.0, -np.inf
    energy, defect, to_p, moved, of_p = 0.0, 0.0, 0.0, 0.0, 0.0
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
        of_p += p[i] * p[i]
    return tension, product, highest, energy, defect, to_p, moved, of_p


@njit_reassoc
def _lift_row(b, depth, u, admissible):
    lift = 0.0
    for i in range(b.size):
        penetration = -gap(u[i], b[i], depth)
        if penetration > lift * u[i] and u[i] > 0 and admissible[i]:
            lift = penetration / u[i]  # divided where it grows only, which is seldom
    return lift


_NOTHING = (0.0,) * 8  # what `_survey_row` finds where there is no pressure and no overlap


@njit()
def survey(b, depth, u, p, admissible, smallest, lifts, penetrates, largest, sums):
    """Largest of -e / u, -e, |h|, -p, |p e|, p; sums of u u, p u, p e, p g, w w, p p: added to what is there.

    h and e are zero in inadmissible cells; g and w by the smallest eigenvalue. Most rows have gaps and no pressure: a
    glance is enough. `penetrates` is told which rows have e < 0. -e / u is divided if it `lifts` alone.
    """
    for j in range(b.shape[0]):
        penetration, deepest, highest, of_u = _glance_row(b[j], depth, u[j], p[j], admissible[j])
        penetrates[j] = penetration > 0
        lift = _lift_row(b[j], depth, u[j], admissible[j]) if lifts and penetration > 0 else 0.0
        row = _NOTHING
        if not (penetration <= 0 and highest <= 0):  # or NaN
            row = _survey_row(b[j], depth, u[j], p[j], admissible[j], smallest)
        for k, value in enumerate((lift, penetration, deepest) + row[:3]):
            largest[k] = max(largest[k], value)
        for k, value in enumerate((of_u,) + row[3:]):
            sums[k] += value


@njit()
def lift(b, depth, u, admissible, most, penetrates, sums):
    """Sums of w u and w w for ``w = max(-(e + t u), 0)`` where e < 0, for t = most / 2^k; other rows are left out.

    A cell counts from the first k on for which w is positive, in the last one for t = 0: so the cells of each first k
    are summed: -e u, e e and u u of them.
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
