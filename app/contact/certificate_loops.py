"""Compiled loops of `app.contact.certificate`.

Arrays are as in `app.contact.bounds_loops`. In inadmissible cells the gap e counts as zero.

A change of p by w / slope moves the gap by w. The *reduced gap* of a cell is the g that minimises
``p max(g, 0) + (H - p) max(-g, 0) + (g - e)^2 / (2 slope)``. So e is moved towards zero, by at most slope p from above,
and by at most slope (H - p) from below. Without a hardness g >= 0.
"""

import math

import numpy as np

from app.base.numba_cache import njit
from app.contact.bounds_loops import is_plastic, violation
from app.contact.loops import gap
from app.parallel.reductions import add_tuples, njit_reassoc


@njit_reassoc
def _reduce(e, p, upper, j, i, slope):
    """Return the reduced gap, and its difference from the gap without cancellation."""
    above = slope * p
    if upper is None:
        return max(e - above, 0.0), max(-above, -e)
    below = slope * (upper[j, i] - p)
    if e > above:
        return e - above, -above
    if e < -below:
        return e + below, below
    return 0.0, -e


@njit_reassoc
def _price(g, p, upper, j, i):
    """Return the contribution of a gap g to the duality gap.

    An open gap contributes p g, an overlap (H - p) |g|; without a hardness every gap contributes p g.
    """
    if upper is None:
        return p * g
    return p * g if g >= 0 else -(upper[j, i] - p) * g


@njit_reassoc
def _gaps_row(b, depth, u, p, upper, j, admissible, slope):
    gaps, depths, excess, open_price, plastic_price = 0.0, 0.0, 0.0, 0.0, 0.0
    pressures, squares, total_u, free = 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        g, w = _reduce(e, p[i], upper, j, i, slope)
        price = _price(g, p[i], upper, j, i)
        gaps += max(g, 0.0)
        open_price += price if g > 0 else 0.0
        if upper is not None:
            depths += max(-g, 0.0)
            plastic_price += price if g < 0 else 0.0
        excess += w
        pressures += p[i]
        squares += p[i] * p[i]
        total_u += u[i]
        free += 0.0 if (p[i] > 0) & (not is_plastic(p[i], upper, j, i)) else 1.0
    return gaps, depths, excess, open_price, plastic_price, pressures, squares, total_u, free


@njit()
def gaps(b, depth, u, p, upper, admissible, slope):
    """Return the sums that certify a pressure on a periodic patch.

    The summed fields are: the reduced gap g where it is open, -g where it overlaps, g minus the gap, `_price` of open
    gaps, `_price` of overlaps, p, p p, and u. The last result is the number of cells with p at a bound.
    """
    sums = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(b.shape[0]):
        sums = add_tuples(sums, _gaps_row(b[j], depth, u[j], p[j], upper, j, admissible[j], slope))
    return sums


@njit_reassoc
def _move_row(
    b, depth, u, p, upper, j, admissible, slope, stretch, deepen, constant, elsewhere, scale, field
):
    squares, product = 0.0, 0.0
    for i in range(b.size):
        g, w = _reduce(gap(u[i], b[i], depth), p[i], upper, j, i, slope)
        w += (stretch if g > 0 else deepen) * g + constant
        w = w if admissible[i] else elsewhere
        squares += w * w
        if field.size:
            product += w * field[i]
            field[i] = scale * w
    return squares, product


@njit()
def move(b, depth, u, p, upper, admissible, slope, stretch, deepen, constant, elsewhere, scale, field):
    """Return w.w and w.field; set `field` to scale*w.

    w is the change from the gap e to the dual feasible gap. The dual feasible gap is the reduced gap, times 1 +
    `stretch` where it is open and 1 + `deepen` where it overlaps, plus a constant. In inadmissible cells w is
    `elsewhere`. If `field` has no columns, only w.w is computed.
    """
    sums, numbers = (0.0, 0.0), (slope, stretch, deepen, constant, elsewhere, scale)
    for j in range(b.shape[0]):
        row = b[j], depth, u[j], p[j], upper, j, admissible[j]
        sums = add_tuples(sums, _move_row(*row, *numbers, field[j]))
    return sums


@njit_reassoc
def _scan_row(b, depth, u, p, upper, j, admissible):
    penetration, deepest, highest, u_squares = 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        h = b[i] + depth if admissible[i] else 0.0
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        penetration = max(penetration, 0.0 if is_plastic(p[i], upper, j, i) else -e)
        deepest = max(deepest, abs(h))
        highest = max(highest, abs(p[i]))
        u_squares += u[i] * u[i]
    return penetration, deepest, highest, u_squares


@njit_reassoc
def _survey_row(b, depth, u, p, upper, j, admissible, smallest):
    outside, product, highest = 0.0, 0.0, 0.0
    energy, defect, to_p, moved, p_squares = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        e = gap(u[i], b[i], depth) if admissible[i] else 0.0
        outside = max(outside, violation(p[i], upper, j, i, admissible[i]))
        highest = max(highest, p[i])
        price = _price(e, p[i], upper, j, i)
        if upper is None:
            product = max(product, abs(price))
        else:  # an overlap of a cell without hardness has no finite price
            product = max(product, price if price < np.inf else 0.0)
        g, w = _reduce(e, p[i], upper, j, i, smallest)
        energy += p[i] * u[i]
        defect += price
        to_p += _price(g, p[i], upper, j, i)
        moved += w * w
        p_squares += p[i] * p[i]
    return outside, product, highest, energy, defect, to_p, moved, p_squares


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
def survey(b, depth, u, p, upper, admissible, smallest, lifts, penetrates, largest, sums):
    """Update maxima and sums of gaps and pressures.

    `largest` gets the maxima of: -e / u, -e of the cells with p < H, |h|, the violation of the bounds, |`_price`| of
    the gap, and p. `sums` gets the sums of: u u, p u, `_price` of the gap e, `_price` of the reduced gap g, (g - e)^2,
    and p p. `smallest`, the smallest eigenvalue of A, is the slope of the reduced gap. Rows without pressure and
    penetration are only scanned. ``penetrates[j]`` is set if row j penetrates. -e / u is computed only if `lifts` is
    true.
    """
    for j in range(b.shape[0]):
        fields = b[j], depth, u[j], p[j], upper, j, admissible[j]
        penetration, deepest, highest, u_squares = _scan_row(*fields)
        penetrates[j] = penetration > 0
        lift = _lift_row(b[j], depth, u[j], admissible[j]) if lifts and penetration > 0 else 0.0
        row = _NO_CONTACT
        if not (penetration <= 0 and highest <= 0):  # or NaN
            row = _survey_row(*fields, smallest)
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
