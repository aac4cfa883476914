"""Tables that list points or a line scan instead of a map."""

import numpy as np

from app.base.errors import format_distinct, format_exact

MAX_OFFSET = 0.1  # of a spacing, between a point and its place in the lattice
MAX_PLACES = 2  # of the lattice, for each point; more are taken for scattered points
MAX_MAP_ROWS = 9  # rows of two or three numbers in a map; more rows are a list
MAX_POINT_NUMBERS = 8  # numbers of a point: x, y, z, and colours or errors
MIN_SCAN_POINTS = 4  # fewer numbers of a map may increase by chance
POINTS = "points x, y, z"


def detect_list(table):
    """Return what a table's rows list; an empty text for a map.

    A table with three columns is `POINTS` if it has many rows, or if its x and y are all places of a lattice. A table
    with two columns is a line scan if it has many rows. A table with two columns and few rows, or with two rows, is a
    line scan if x always increases or always decreases, and z differs from x.

    Examples
    --------
    >>> detect_list(np.array([[0.0, 2.0], [1.0, 7.0], [1.5, 3.0], [4.0, 2.0]]))
    'x, z of a line scan'
    """
    rows, columns = table.shape
    if 2 in (rows, columns):
        x, z = table.T if columns == 2 else table
        steps = np.diff(x)
        ordered = len(x) >= MIN_SCAN_POINTS and (np.all(steps > 0) or np.all(steps < 0))
        scan = (ordered and not np.array_equal(x, z)) or (columns == 2 and rows > MAX_MAP_ROWS)
        return "x, z of a line scan" if scan else ""
    if columns == 3:
        return POINTS if rows > MAX_MAP_ROWS or _begins_with_lattice(table) else ""
    if 3 < columns <= MAX_POINT_NUMBERS and rows > MAX_MAP_ROWS and _begins_with_lattice(table):
        return f"{POINTS} with more behind z"
    return ""


def _begins_with_lattice(table):
    x, y = (np.unique(table[:, k]).size for k in (0, 1))
    return min(x, y) > 1 and x * y == len(table) == len(np.unique(table[:, :2], axis=0))


def arrange(points):
    """Arrange points x, y, z on their lattice; return heights and spacing.

    Heights have the shape (ny, nx). The first row has the smallest y; heights are NaN where there is no point. Raises
    ValueError if the points do not lie on a regular lattice, or if two points have the same place.

    Examples
    --------
    >>> x, y = np.meshgrid([0.0, 0.5, 1.0], [2.0, 4.0])
    >>> points = np.stack([x, y, 10 * y + x], -1).reshape(-1, 3)
    >>> arrange(points[[4, 0, 5, 1, 3]])
    (array([[20. , 20.5,  nan],
           [40. , 40.5, 41. ]]), (0.5, 2.0))
    """
    if not np.isfinite(points[:, :2]).all():
        raise ValueError("x and y of points must be numbers")
    (i, dx), (j, dy) = (_find_places(name, points[:, k]) for k, name in enumerate("xy"))
    nx, ny = i.max() + 1, j.max() + 1
    if nx * ny > MAX_PLACES * len(points):
        raise ValueError(
            f"{len(points)} points on {nx} x {ny} places: scattered points are not interpolated; must be a regular grid"
        )
    if len(np.unique(j * nx + i)) < len(points):
        raise ValueError("two points lie in the same place")
    heights = np.full((ny, nx), np.nan)
    heights[j, i] = points[:, 2]
    return heights, (dx, dy)


def _merge_clusters(values):
    """Return sorted values, clusters replaced by their means.

    A cluster consists of values that are close to each other.
    """
    steps = np.diff(values)
    sizes = np.sort(steps)
    for size in sizes[:-1][sizes[1:] > 3 * sizes[:-1]][::-1]:
        clusters = np.split(values, np.flatnonzero(steps > size) + 1)
        means = np.array([cluster.mean() for cluster in clusters])
        if max(np.ptp(cluster) for cluster in clusters) <= 2 * MAX_OFFSET * np.diff(means).min():
            return means
    return values


def _find_places(name, values):
    """Return each value's index on an equally spaced axis, and the spacing.

    Raises ValueError if values are not equally spaced; the message contains the `name` of the axis.
    """
    lines = _merge_clusters(np.unique(values))
    first, last = lines[0], lines[-1]
    steps = np.diff(lines)
    steps = steps[steps > 1e-6 * (last - first)]
    if not len(steps):
        raise ValueError(f"all points have the same {name}")
    spacing = np.median(steps[steps < 1.5 * steps.min()])
    spacing = (last - first) / round((last - first) / spacing)
    places = (values - first) / spacing
    nearest = np.rint(places)
    offset = np.abs(places - nearest)
    if offset.max() > MAX_OFFSET:
        worst = values[offset.argmax()]
        raise ValueError(
            f"{name} = {format_exact(worst)} is off the spacing of {format_distinct(spacing, worst, 6)}; "
            "must be a regular grid"
        )
    return nearest.astype(np.int64), float(spacing)
