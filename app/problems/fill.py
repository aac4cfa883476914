"""Missing points of a height map, filled by a harmonic function: as a soap film would."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve


def harmonic_fill(heights):
    """Values for the missing points: each the mean of its neighbours up, down, left and right.

    Not collective. Beyond the rim nothing is known and nothing counts. Heights on both sides are met without a step; a
    plane is continued as it is.

    Parameters
    ----------
    heights : ndarray, shape (ny, nx)
        NaN where missing, not everywhere.

    Returns
    -------
    rows, columns : ndarray of int, shape (n,)
        Of the missing points, row by row.
    values : ndarray, shape (n,)

    Examples
    --------
    >>> heights = np.arange(5.0) + 10 * np.arange(4.0)[:, None]
    >>> heights[1:3, 2] = np.nan
    >>> harmonic_fill(heights)[2].round(12).tolist()
    [12.0, 22.0]
    """
    missing = np.isnan(heights)
    rows, columns = np.nonzero(missing)
    number = np.full(heights.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    neighbours, right = np.zeros(len(rows)), np.zeros(len(rows))
    entries = []
    for down, along in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        j, i = rows + down, columns + along
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
    return rows, columns, np.atleast_1d(spsolve(matrix.tocsc(), right))
