"""Checks that a pressure can balance a load with a prescribed centre.

There must be cells on all sides of the centre. With a hardness H the load must not be too large, either: the moments
about the centre of all pressures ``0 <= p <= H`` with the load F form a convex set in the plane. Bodies that tilt have
a solution if the set contains 0 in its interior. In each direction the set's farthest point is due to the pressure that
fills the cells in this direction first, up to the load F. So the set is explored by some of these points: they surround
0, or one of them does not lie beyond 0, which proves that no point of the set does.
"""

import numpy as np

from app.parallel.reductions import sum_over

_MOMENT_ROUNDING = 1e-12  # of a moment, over load and size of the patch
_ANGLE_ROUNDING = 1e-9  # of an angle, over half a turn
_PLACE_ROUNDING = 1e-12  # of a place, over the longer side of the patch
_MAX_DIRECTIONS = 100  # each halves the part of the widest angle that exceeds half a turn
_LEVEL_ROUNDING = 1e-14  # of a coordinate, over the largest one
_LEAST_STEP = 1e-11  # of the search for the largest load [rad]


def surrounds(distance, place, comm):
    """Return whether there are admissible cells on all sides of a place (x, y). Collective over `comm`.

    The first and last admissible cells of all rows have the same convex hull as all admissible cells.
    """
    grid, rows, admissible = *distance.cells, distance.admissible
    ends = np.zeros((3, grid.ny))  # of each row: first and last cell, and whether there is any
    if len(admissible):
        last = grid.nx - 1 - admissible[:, ::-1].argmax(axis=1)
        ends[:, rows] = admissible.argmax(axis=1), last, admissible.any(axis=1)
    first, last, some = np.asarray(sum_over(comm, ends)).astype(int)
    x = grid.x()[np.append(first[some > 0], last[some > 0])] - place[0]
    y = np.tile(grid.y()[some > 0], 2) - place[1]
    away = np.hypot(x, y) > _PLACE_ROUNDING * max(grid.sides)
    return _surround(x[away], y[away])[0]


def _surround(x, y):
    """Return whether places surround (0, 0), and the middle of the widest angle without any of them, from there."""
    angles = np.sort(np.arctan2(y, x))
    gaps = np.diff(np.append(angles, angles[:1] + 2 * np.pi))
    if not gaps.size:
        return False, 0.0
    widest = gaps.argmax()
    return bool(gaps[widest] < np.pi * (1 - _ANGLE_ROUNDING)), angles[widest] + gaps[widest] / 2


def _direction(angle):
    return np.array([np.cos(angle), np.sin(angle)])


class CentredLoad:
    """Test whether pressures up to the hardness carry a load with a centre. Collective over `comm`.

    Parameters
    ----------
    distance : UndeformedDistance
        Distance with a hardness, on the target grid.
    load : float
        Largest load that is tested [N].
    centre : (float, float)
        Centre of the load [mm].
    comm : Communicator
    """

    def __init__(self, distance, load, centre, comm):
        grid, self._comm, self._load = distance.patch, comm, load
        rows, length = distance.cells[1], max(grid.sides)
        self._x, self._y = (grid.x() - centre[0]) / length, (grid.y(rows) - centre[1]) / length
        strength = np.where(
            distance.admissible, np.minimum(distance.bounds.upper * grid.cell_area, load), 0.0
        )
        # Sums of the load and of its moment over the first cells of each row.
        self._sums = np.zeros((2, len(self._y), len(self._x) + 1))
        np.cumsum(strength, axis=1, out=self._sums[0, :, 1:])
        np.cumsum(strength * self._x, axis=1, out=self._sums[1, :, 1:])
        ends = np.abs(grid.x() - centre[0]).max(), np.abs(grid.y() - centre[1]).max()
        self._reach = 2 * np.hypot(*ends) / length

    def largest(self):
        """Return the largest load up to `load` that pressures can carry [N]."""
        angle = self._find_separating()
        if angle is None:
            return self._load
        # The angles at which less than a given load is reached are an interval: a search by steps to both sides.
        least, step = self._reached(angle), np.pi / 2
        while step > _LEAST_STEP:
            lower, other = min((self._reached(other), other) for other in (angle - step, angle + step))
            if lower < least:
                least, angle = lower, other
            step /= 2
        return min(least, self._load)

    def _reached(self, angle):
        """Return the largest load that has a moment of at least 0 in a direction [N]."""
        direction = _direction(angle)
        return self._fill(direction, 0.0, lambda sums: sums[1:] @ direction)[0]

    def _find_separating(self):
        """Return the angle of a direction in which all pressures with the load have a moment below 0, or None.

        If 0 is on the boundary of their moments, no moment in the direction may exceed 0.
        """
        points, angle, rounding = np.empty((0, 2)), 0.0, _MOMENT_ROUNDING * self._load
        for _ in range(_MAX_DIRECTIONS):
            direction = _direction(angle)
            carried, *moment = self._fill(direction, self._reach, lambda sums: self._load - sums[0])
            lacks = carried < self._load - rounding
            if lacks or moment @ direction < -rounding or np.hypot(*moment) <= rounding:
                break
            points = np.vstack([points, moment])
            surrounded, following = _surround(*points.T)
            if surrounded:
                return None
            angle = following
        return angle

    def _fill(self, direction, high, lack):
        """Fill the cells beyond `high` in a direction, then the next ones until nothing lacks; return the sums.

        The sums are load and moments, and ``lack(sums)`` is a linear function of them.
        """
        low = -self._reach
        outside, inside = self._beyond(high, *direction), self._beyond(low, *direction)
        if lack(inside) > 0 or lack(outside) <= 0:
            return inside if lack(inside) > 0 else outside
        while low < (middle := (low + high) / 2) < high and high - low > _LEVEL_ROUNDING * self._reach:
            sums = self._beyond(middle, *direction)
            if lack(sums) > 0:
                high, outside = middle, sums
            else:
                low, inside = middle, sums
        # The rest is of cells that are equally far.
        return outside + lack(outside) / (lack(outside) - lack(inside)) * (inside - outside)

    def _beyond(self, level, in_x, in_y):
        """Return the sums over the cells with ``in_x x + in_y y > level`` of load and moments."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (level - in_y * self._y) / in_x
        rows, (first, whole) = np.arange(len(ends)), (self._sums, self._sums[:, :, -1])
        if in_x >= 0:
            load, moment = whole - first[:, rows, np.searchsorted(self._x, ends, "right")]
        else:
            load, moment = first[:, rows, np.searchsorted(self._x, ends, "left")]
        return np.asarray(sum_over(self._comm, [load.sum(), moment.sum(), load @ self._y]))
