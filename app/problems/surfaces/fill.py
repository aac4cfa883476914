"""Missing points of a height map, filled by a harmonic function about the best plane, as by a soap film."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from app.problems.surfaces.moments import Moments, take_off

# Mean square cliff at the sides of a period, in that less the best plane: below, the plane is a wave's.
_WAVE = 0.5


def fill_missing(heights, around=(False, False)):
    """Fill missing points: heights less the best plane are the mean of their neighbours.

    Not collective. Neighbours are those up, down, left and right that lie on the map. A plane is continued as it is.
    What is filled lies between the other heights less the plane. A wave around a period has a best plane, too; it stays
    if its ends meet much better without.

    Parameters
    ----------
    heights : ndarray, shape (ny, nx)
        NaN where missing, not everywhere.
    around : pair of bool
        Whether the map goes on at its other side, in x and in y.

    Returns
    -------
    ndarray, shape (n,)
        Heights of the missing points, row by row.

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
    rest = take_off(plane, heights.copy(), 0, len(heights))
    missing = np.isnan(rest)
    rest[missing] = _harmonic(rest, missing, around)
    return take_off({term: -value for term, value in plane.items()}, rest, 0, len(rest))[missing]


def _is_wave(columns, slope):
    """Whether columns continue around the period much better than they do less a plane."""
    columns = columns[:, ~np.isnan(columns).all(axis=0)]
    known, n, here = ~np.isnan(columns), len(columns), np.arange(columns.shape[1])
    first, last = known.argmax(axis=0), n - 1 - known[::-1].argmax(axis=0)
    width = n + first - last  # of the gap between the ends
    reach = np.minimum(np.maximum(width // 2, 1), last - first)
    low, after, before, high = (columns[row, here] for row in (first, first + reach, last - reach, last))
    with np.errstate(invalid="ignore"):
        cliff = low - high - width * (after - low + high - before) / (2 * reach)
    in_plane = 2 * slope  # its rise over a period
    return np.nansum((cliff / width) ** 2) < _WAVE * np.nansum(((cliff + in_plane) / width) ** 2)


def _harmonic(heights, missing, around):
    """Values for the missing points, each the mean of its neighbours."""
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
    to, of = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    matrix = sparse.diags(neighbours) - sparse.coo_matrix(
        (np.ones(len(to)), (to, of)), shape=(len(rows),) * 2
    )
    return np.atleast_1d(spsolve(matrix.tocsc(), right))
