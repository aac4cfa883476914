"""Filling of missing points of a height map, by harmonic functions."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from app.problems.surfaces.moments import Moments, add_polynomial

# Largest mean square step at the end of a wave's period, in that which remains after subtracting the best plane.
MAX_WAVE_STEP = 0.5


def fill_missing(heights, around=(False, False)):
    """Return heights for the missing points, row by row.

    First the best plane is subtracted. Then each missing point gets the mean of its neighbours up, down, left and
    right. At the end the plane is added again, so the heights of a tilted map are continued with its slope.

    `heights`, of shape (ny, nx), are NaN where missing. At least one height must be known. `around` has two values: the
    first is true if the map is periodic in x, the second if it is periodic in y. In a periodic direction, a surface
    may look like a wave: its heights return to the first value at the end of a period. Then the plane is subtracted
    without its slope in this direction.

    Examples
    --------
    >>> heights = np.arange(5.0) + 10 * np.arange(1.0, 5.0)[:, None]
    >>> heights[1:3, 2] = heights[0, :2] = np.nan
    >>> fill_missing(heights).round(12).tolist()
    [10.0, 11.0, 22.0, 32.0]
    """
    plane = Moments("", lambda *rows: heights[slice(*rows)], heights.shape).fit("plane")
    for axis, slope in enumerate(((1, 0), (0, 1))):
        if around[axis] and _is_wave(heights if axis else heights.T, plane[slope]):
            plane[slope] = 0.0
    rest = add_polynomial(heights.copy(), plane, 0, len(heights), sign=-1)
    missing = np.isnan(rest)
    rest[missing] = _solve_laplace(rest, missing, around)
    return add_polynomial(rest, plane, 0, len(rest))[missing]


def _is_wave(columns, slope):
    """Return whether columns look like periodic waves, not like a plane.

    `slope` is the slope of the best plane along the columns, with the ends of a column at -1 and 1.
    """
    columns = columns[:, ~np.isnan(columns).all(axis=0)]
    known, n, i = ~np.isnan(columns), len(columns), np.arange(columns.shape[1])
    first, last = known.argmax(axis=0), n - 1 - known[::-1].argmax(axis=0)
    width = n + first - last  # of the gap between the ends
    reach = np.minimum(np.maximum(width // 2, 1), last - first)
    low, after, before, high = (columns[row, i] for row in (first, first + reach, last - reach, last))
    with np.errstate(invalid="ignore"):
        step = low - high - width * (after - low + high - before) / (2 * reach)
    rise = 2 * slope  # over a period
    return np.nansum((step / width) ** 2) < MAX_WAVE_STEP * np.nansum(((step + rise) / width) ** 2)


def _solve_laplace(heights, missing, around):
    """Return missing heights, each the mean of four neighbours."""
    rows, columns = np.nonzero(missing)
    number = np.full(heights.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    neighbours, right = np.zeros(len(rows)), np.zeros(len(rows))
    entries = []
    for down, along in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        j, i = rows + down, columns + along
        if around[0]:
            i %= heights.shape[1]
        if around[1]:
            j %= heights.shape[0]
        inside = np.flatnonzero((j >= 0) & (j < heights.shape[0]) & (i >= 0) & (i < heights.shape[1]))
        j, i = j[inside], i[inside]
        neighbours[inside] += 1
        known = ~missing[j, i]
        right[inside[known]] += heights[j[known], i[known]]
        entries.append((inside[~known], number[j[~known], i[~known]]))
    coupled = tuple(np.concatenate(parts) for parts in zip(*entries, strict=True))
    matrix = sparse.diags(neighbours) - sparse.coo_matrix(
        (np.ones(len(coupled[0])), coupled), (len(rows),) * 2
    )
    return np.atleast_1d(spsolve(matrix.tocsc(), right))
