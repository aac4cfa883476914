"""Filling of missing points of a height map, by harmonic functions."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from app.problems.surfaces.moments import Moments, add_polynomial


def fill_missing(heights, around=(False, False)):
    """Return heights for the missing points, row by row.

    First the best plane is subtracted. Then each missing point gets the mean of its neighbours up, down, left and
    right. At the end the plane is added again, so the heights of a tilted map are continued with its slope.

    `heights`, of shape (ny, nx), are NaN where missing. At least one height must be known. `around` has two values: the
    first is true if the map is periodic in x, the second if it is periodic in y. The plane has no slope in a periodic
    direction.

    Examples
    --------
    >>> heights = np.arange(5.0) + 10 * np.arange(1.0, 5.0)[:, None]
    >>> heights[1:3, 2] = heights[0, :2] = np.nan
    >>> fill_missing(heights).round(12).tolist()
    [10.0, 11.0, 22.0, 32.0]
    """
    plane = Moments("", lambda *rows: heights[slice(*rows)], heights.shape).fit("plane")
    for axis, slope in enumerate(((1, 0), (0, 1))):
        if around[axis]:
            plane[slope] = 0.0
    rest = add_polynomial(heights.copy(), plane, 0, len(heights), sign=-1)
    missing = np.isnan(rest)
    rest[missing] = _solve_laplace(rest, missing, around)
    return add_polynomial(rest, plane, 0, len(rest))[missing]


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
