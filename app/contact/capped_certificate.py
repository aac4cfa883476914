"""Compiled loops of `app.contact.certificate` for pressures 0 <= p <= H.

`upper` is the hardness H, of shape (rows, nx), infinite in elastic cells. In inadmissible cells the gap e counts as
zero. A change of p by w / slope moves the gap by w. The *reduced gap* of a cell is the g that minimises
``p max(g, 0) + (H - p) max(-g, 0) + (g - e)^2 / (2 slope)``. So e is moved towards zero, by at most slope p from above,
and by at most slope (H - p) from below.
"""

import numpy as np

from app.base.numba_cache import njit
from app.contact.kernels import gap
from app.parallel.reductions import add_tuples, njit_reassoc


@njit_reassoc
def _reduce(e, p, upper, slope):
    """Return the reduced gap, and its difference from the gap without cancellation."""
    above, below = slope * p, slope * (upper - p)
    if e > above:
        return e - above, -above
    if e < -below:
        return e + below, below
    return 0.0, -e


@njit_reassoc
def _price(g, p, upper):
    """Return the contribution of a gap g to the duality gap.

    An open gap contributes p g, an overlap (H - p) |g|.
    """
    if g >= 0:
        return p * g
    return -(upper - p) * g


@njit_reassoc
def _survey_row(b, depth, u, p, upper, admissible, smallest):
    overlap, deepest, outside, product, highest = 0.0, 0.0, 0.0, 0.0, 0.0
    u_squares, energy, plain, reduced, moved, p_squares = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        u_squares += u[i] * u[i]
        if not admissible[i]:
            outside = max(outside, abs(p[i]))
            continue
        e, h = gap(u[i], b[i], depth), b[i] + depth
        overlap = max(overlap, -e if p[i] < upper[i] else 0.0)
        deepest = max(deepest, abs(h))
        outside = max(outside, -p[i], p[i] - upper[i])
        highest = max(highest, p[i])
        price = _price(e, p[i], upper[i])
        if price < np.inf:
            product = max(product, price)
        g, w = _reduce(e, p[i], upper[i], smallest)
        energy += p[i] * u[i]
        plain += price
        reduced += _price(g, p[i], upper[i])
        moved += w * w
        p_squares += p[i] * p[i]
    largest = overlap, deepest, outside, product, highest
    return largest, (u_squares, energy, plain, reduced, moved, p_squares)


@njit()
def survey(b, depth, u, p, upper, admissible, smallest, largest, sums):
    """Update maxima and sums of gaps and pressures.

    `largest` gets the maxima of: the overlap of cells with p < H, |h|, the violation of the bounds, `_price` of the
    gap, and p. `sums` gets the sums of: u u, p u, `_price` of the gap e, `_price` of the reduced gap g, (g - e)^2, and
    p p. `smallest`, the smallest eigenvalue of A, is the slope of the reduced gap.
    """
    for j in range(b.shape[0]):
        most, more = _survey_row(b[j], depth, u[j], p[j], upper[j], admissible[j], smallest)
        for k, value in enumerate(most):
            largest[k] = max(largest[k], value)
        for k, value in enumerate(more):
            sums[k] += value


@njit_reassoc
def _gaps_row(b, depth, u, p, upper, admissible, slope):
    gaps, depths, excess, open_price, plastic_price = 0.0, 0.0, 0.0, 0.0, 0.0
    pressures, squares, total_u, free = 0.0, 0.0, 0.0, 0.0
    for i in range(b.size):
        total_u += u[i]
        free += 0.0 if (p[i] > 0) & (p[i] < upper[i]) else 1.0
        if not admissible[i]:
            continue
        g, w = _reduce(gap(u[i], b[i], depth), p[i], upper[i], slope)
        price = _price(g, p[i], upper[i])
        gaps += max(g, 0.0)
        depths += max(-g, 0.0)
        open_price += price if g > 0 else 0.0
        plastic_price += price if g < 0 else 0.0
        excess += w
        pressures += p[i]
        squares += p[i] * p[i]
    return gaps, depths, excess, open_price, plastic_price, pressures, squares, total_u, free


@njit()
def gaps(b, depth, u, p, upper, admissible, slope):
    """Return the sums that certify a pressure on a periodic patch.

    The summed fields are: the reduced gap g where it is open, -g where it overlaps, g minus the gap, `_price` of open
    gaps, `_price` of overlaps, p, p p, and u. The last result is the number of cells with p at a bound.
    """
    sums = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(b.shape[0]):
        sums = add_tuples(sums, _gaps_row(b[j], depth, u[j], p[j], upper[j], admissible[j], slope))
    return sums


@njit()
def move(b, depth, u, p, upper, admissible, slope, stretch, deepen, constant, elsewhere, scale, field):
    """Return w.w and w.field; set `field` to scale*w.

    w is the change from the gap e to the dual feasible gap. The dual feasible gap is the reduced gap, times 1 +
    `stretch` where it is open and 1 + `deepen` where it overlaps, plus a constant. In inadmissible cells w is
    `elsewhere`. If `field` has no columns, only w.w is computed.
    """
    squares, product = 0.0, 0.0
    for j in range(b.shape[0]):
        for i in range(b.shape[1]):
            w = elsewhere
            if admissible[j, i]:
                g, w = _reduce(gap(u[j, i], b[j, i], depth), p[j, i], upper[j, i], slope)
                w += (stretch if g > 0 else deepen) * g + constant
            squares += w * w
            if field.size:
                product += w * field[j, i]
                field[j, i] = scale * w
    return squares, product
