"""Interpolation to finer grids: bilinear, or quintic if periodic.

Values belong to the centres of cells. Bilinear interpolation is as in the paper, step 2 of Sec. 4.3. Quintic
polynomials through six cells in x and y have an error of sixth order. Both interpolations take the same time.
"""

from functools import lru_cache

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.chebyshev import lagrange_weights
from app.parallel.reductions import mix_rows, njit_reassoc, wrap_ends

_POINTS = 6  # coarse cells of a quintic; the loops are written out for six
QUINTIC_MARGIN = _POINTS // 2  # coarse cells that are needed on either side of a fine one


@njit()
def _interpolate_inner(row, fine):
    """Interpolate the inner cells of a coarse row to fine cells."""
    for i in range(1, row.size - 1):
        fine[2 * i] = 0.75 * row[i] + 0.25 * row[i - 1]
        fine[2 * i + 1] = 0.75 * row[i] + 0.25 * row[i + 1]


@njit()
def interpolate_bilinear(coarse, fine, a, b, weight_y, c, d, weight_x, halved, row):
    """Interpolate a coarse field bilinearly to fine cells.

    Fine row j is interpolated from the coarse rows a[j] and b[j], with the weights weight_y[j] and 1 - weight_y[j].
    Likewise, fine column i is interpolated from the coarse columns c[i] and d[i], with weight_x. `halved` is true if
    each coarse column has two fine ones. `row` is work space for a coarse row.
    """
    first, last = (2, 2 * row.size - 2) if halved and row.size > 2 else (0, 0)
    for j in range(fine.shape[0]):
        mix_rows(coarse[a[j]], weight_y[j], coarse[b[j]], row)
        if last:
            _interpolate_inner(row, fine[j])
        for i in range(first):
            fine[j, i] = weight_x[i] * row[c[i]] + (1 - weight_x[i]) * row[d[i]]
        for i in range(last, fine.shape[1]):
            fine[j, i] = weight_x[i] * row[c[i]] + (1 - weight_x[i]) * row[d[i]]


@njit_reassoc
def _mix_six(a, b, c, d, e, f, weights, out):
    wa, wb, wc, wd, we, wf = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for i in range(out.size):
        out[i] = (wa * a[i] + wb * b[i]) + (wc * c[i] + wd * d[i]) + (we * e[i] + wf * f[i])


@njit_reassoc
def _interpolate_halved(row, weights, fine):
    """Interpolate a coarse row to fine cells, two in each coarse cell."""
    wa, wb, wc, wd, we, wf = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for i in range(np.uint64(fine.size // 2)):
        a, b, c, d = row[i], row[i + one], row[i + two], row[i + three]
        e, f, g, k = row[i + two + two], row[i + two + three], row[i + three + three], two * i
        fine[k] = (wa * a + wb * b) + (wc * c + wd * d) + (we * e + wf * f)
        fine[k + one] = (wf * b + we * c) + (wd * d + wc * e) + (wb * f + wa * g)


@njit()
def interpolate_quintic(coarse, fine, rows, weights_y, columns, weights_x, halved, row):
    """Interpolate periodic coarse fields to fine cells, by quintics.

    Fine row j is interpolated from the coarse rows rows[j] to rows[j] + 5, fine column i from columns[i] to columns[i]
    + 5. Columns are counted from `QUINTIC_MARGIN` cells before the first one. Weights have shapes (rows, 6) and
    (columns, 6). `halved` is true if each coarse column has two fine ones. `row` is work space for (coarse columns + 2
    QUINTIC_MARGIN) values.
    """
    nx = coarse.shape[1]
    for j in range(fine.shape[0]):
        k = rows[j]
        _mix_six(
            coarse[k], coarse[k + 1], coarse[k + 2], coarse[k + 3], coarse[k + 4], coarse[k + 5],
            weights_y[j], row[QUINTIC_MARGIN : QUINTIC_MARGIN + nx],
        )  # fmt: skip
        wrap_ends(row, nx, QUINTIC_MARGIN)
        if halved:
            _interpolate_halved(row, weights_x[0], fine[j])
            continue
        for i in range(fine.shape[1]):
            total = 0.0
            for m in range(_POINTS):
                total += weights_x[i, m] * row[columns[i] + m]
            fine[j, i] = total


@lru_cache(maxsize=64)
def bilinear_weights(start, stop, count, factor, place, first=None):
    """Return two coarse cells and a weight for each fine cell.

    The cells are along one axis: fine cells `start` to `stop` - 1, and `count` coarse cells of `factor` fine cells
    each. The weight belongs to the first of the two coarse cells; the second has one minus this weight.

    The two coarse cells are the parent, which contains the fine cell, with weight 3/4, and the nearest neighbour of the
    parent. At the boundary of the grid the two coarse cells are the parent, with weight 5/4, and the neighbour inside.
    If the grid repeats along the axis, the two coarse cells are the cells before and behind the centre of the fine
    cell; `place` comes from `Grid.places_in`. Returned cell numbers are relative to `first`; if `first` is None, they
    are taken modulo `count`.
    """
    index = np.arange(start, stop)
    one = other = index // factor
    weight = np.ones(len(index))
    if place is not None:
        one, share = _before(index, place)
        other, weight = one + 1, 1.0 - share
    elif factor > 1 and count > 1:
        towards = np.where(index % 2, 1, -1)
        inside = (one + towards >= 0) & (one + towards < count)
        other = np.where(inside, one + towards, one - towards)
        weight = np.where(inside, 0.75, 1.25)
    return (one % count, other % count, weight) if first is None else (one - first, other - first, weight)


@lru_cache(maxsize=64)
def quintic_weights(start, stop, place, first):
    """Return coarse cells and weights of quintic interpolation.

    Each fine cell from `start` to `stop` - 1 is interpolated from six successive coarse cells. Return the number of the
    first of the six, relative to `first`, and the six weights. `place` comes from `Grid.places_in`, for this axis.
    """
    before, share = _before(np.arange(start, stop), place)
    left = QUINTIC_MARGIN - 1
    return before - left - first, lagrange_weights(share, np.arange(_POINTS) - left)


def _before(index, place):
    """Return the coarse centre before each fine one, and the distance [cells]."""
    centre = place[0] * index + place[1]
    before = np.floor(centre).astype(int)
    return before, centre - before
