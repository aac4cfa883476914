"""Lists of points x, y, z on a regular lattice, in any order, put back into rows of cells; line scans."""

from __future__ import annotations

import numpy as np

from app.base.errors import format_distinct, format_exact

_OFF = 0.1  # of a spacing by which a point may miss its place: printed digits
_SPARSE = 2  # places for each point, at most
_FEW = 9  # rows of two or three numbers that may well be a map
_WIDEST = 8  # numbers of a point: x, y, z, colours or errors
_SHORT = 3  # numbers of a map that may increase by chance


def looks_like_points(table):
    """Whether a table is taken for points rather than rows of cells. Not collective.

    Three columns are, if there are many rows, or if the first two are all places of a lattice.
    """
    rows, columns = table.shape
    return columns == 3 and (rows > _FEW or _begins_with_lattice(table))


def _begins_with_lattice(table):
    x, y = (np.unique(table[:, k]).size for k in (0, 1))
    return min(x, y) > 1 and x * y == len(table) == len(np.unique(table[:, :2], axis=0))


def listed(table):
    """Return what the lines of a table list if they are no rows of cells; else an empty text.

    Not collective. Two columns are a line scan, if there are many rows. So are fewer, and two rows, if the first one
    increases or decreases and the second one is another one.

    Examples
    --------
    >>> listed(np.array([[0.0, 2.0], [1.0, 7.0], [1.5, 3.0], [4.0, 2.0]]))
    'x, z of a line scan'
    """
    rows, columns = table.shape
    if 2 in (rows, columns):
        x, z = table.T if columns == 2 else table
        steps = np.diff(x)
        ordered = len(x) > _SHORT and (np.all(steps > 0) or np.all(steps < 0)) and not np.array_equal(x, z)
        return "x, z of a line scan" if ordered or (columns == 2 and rows > _FEW) else ""
    if 3 < columns <= _WIDEST and rows > _FEW and _begins_with_lattice(table):
        return "points x, y, z with more behind z"
    return ""


def gridded(points):
    """Put points of a regular lattice into rows.

    Not collective.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        x, y, z, in any order; places without a point are missing.

    Returns
    -------
    heights : ndarray, shape (ny, nx)
        First row at the smallest y; NaN where there is no point.
    spacing : tuple of float
        dx, dy.

    Raises
    ------
    ValueError
        If they lie on no regular lattice, or two of them in one place.

    Examples
    --------
    >>> x, y = np.meshgrid([0.0, 0.5, 1.0], [2.0, 4.0])
    >>> points = np.stack([x, y, 10 * y + x], -1).reshape(-1, 3)
    >>> gridded(points[[4, 0, 5, 1, 3]])
    (array([[20. , 20.5,  nan],
           [40. , 40.5, 41. ]]), (0.5, 2.0))
    """
    if not np.isfinite(points[:, :2]).all():
        raise ValueError("x and y of points must be numbers")
    (i, dx), (j, dy) = (_places(name, points[:, k]) for k, name in enumerate("xy"))
    nx, ny = i.max() + 1, j.max() + 1
    if nx * ny > _SPARSE * len(points):
        raise ValueError(
            f"{len(points)} points on {nx} x {ny} places: scattered points are not interpolated; needed: a regular grid"
        )
    place = j * nx + i
    if len(np.unique(place)) < len(place):
        raise ValueError("two points lie in the same place")
    heights = np.full(nx * ny, np.nan)
    heights[place] = points[:, 2]
    return heights.reshape(ny, nx), (dx, dy)


def _lines(values):
    """Means of sorted values that lie in heaps far apart, as where points miss their places; else the values."""
    steps = np.diff(values)
    sizes = np.sort(steps)
    for size in sizes[:-1][sizes[1:] > 3 * sizes[:-1]][::-1]:
        starts = np.flatnonzero(np.append(True, steps > size))
        ends = np.append(starts[1:], len(values))
        means = np.add.reduceat(values, starts) / (ends - starts)
        if (values[ends - 1] - values[starts]).max() <= 2 * _OFF * np.diff(means).min():
            return means
    return values


def _places(name, values):
    """Numbers of equally spaced places from 0, and their distance."""
    lines = _lines(np.unique(values))
    first, last = lines[0], lines[-1]
    steps = np.diff(lines)
    steps = steps[steps > 1e-6 * (last - first)] if last > first else steps[:0]
    if not len(steps):
        raise ValueError(f"all points have the same {name}")
    least = np.median(steps[steps < 1.5 * steps.min()])
    count = round((last - first) / least)
    spacing = (last - first) / count
    places = (values - first) / spacing
    nearest = np.rint(places)
    off = np.abs(places - nearest)
    if off.max() > _OFF:
        worst = values[off.argmax()]
        raise ValueError(
            f"{name} = {format_exact(worst)} is off the spacing of {format_distinct(spacing, worst, 6)}; "
            "needed: a regular grid"
        )
    return nearest.astype(np.int64), float(spacing)
