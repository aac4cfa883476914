"""A prescribed mean gap of a periodic patch.

The displacements have no mean, so the mean gap gives the approach. If cells have a compliance of their own, the mean
displacement is unknown, and the approach is found by a search.
"""

from math import ulp

import numpy as np

from app.base.errors import InputError, format_exact
from app.contact.approach_search import SearchedLoading
from app.contact.loading import ROUNDING_ULPS, PrescribedApproach, full_contact, without_rounding

_MIN_GAP = 1e-3  # least mean gap that the search distinguishes, over the prescribed one
_RTOL, _MAX_RTOL = 1e-5, 1e-2  # largest error of the mean gap, over that at first touch, and over itself
_MIN_TARGET = 1e-3  # of a coarser grid, on which the bodies may not touch at the prescribed mean gap


class PrescribedMeanGap(PrescribedApproach):
    """Prescribed mean gap: mean undeformed distance minus approach.

    The mean undeformed distance depends on the grid, and so does the approach.

    Parameters
    ----------
    distance : UndeformedDistance
        Undeformed distance on the target grid.
    depth : float
        Depth on the target grid [mm].
    mean_gap : float
        Mean gap as the user gave it [mm]; negative only with a hardness.
    """

    name = kind = "mean_gap"
    meaning, exact, falls = "mean gap of a periodic patch without holes", (), True

    def __init__(self, distance, depth, mean_gap):
        super().__init__(distance.approach_at(depth), depth)
        self._mean, self._mean_gap = distance.statistics.mean, max(mean_gap, 0.0)

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        """Return the loading; see `Loading.create`.

        On a periodic patch displacements have no mean: mean(gap) = mean(undeformed distance) - approach. The mean gap
        must not be negative unless a hardness lets plastic cells overlap.
        """
        text, (full, rounding) = f"mean_gap {format_exact(value)}", full_contact(distance)
        if holes := grid.n - distance.statistics.cells:
            doubt = f"contact is impossible in {holes} cells (NaN), whose gap is unknown"
            raise InputError(f"{text}: {doubt}; use approach, load or mean_pressure")
        if not distance.is_singular:
            return cls._search(value, text, distance)
        if value < -rounding and distance.max_depth < np.inf:
            limit = "it must be at least 0 mm without a hardness"
            raise InputError(f"{text}: the bodies do not penetrate each other; {limit}")
        # Plastic cells overlap: the mean of e is negative by more than the rounding of the approach.
        size, mean = max(abs(full), abs(distance.reference)), distance.statistics.mean
        overlaps = distance.max_depth == np.inf and -value > ROUNDING_ULPS * ulp(size)
        value = value if overlaps else max(value, 0.0)
        # Without the reference, which would cost digits.
        depth = (mean - value) + distance.statistics.mean_rest
        return cls(distance, without_rounding(depth, mean, distance, np.inf), value)

    @staticmethod
    def _search(value, text, distance):
        """Return the loading for cells with a compliance of their own, whose displacements have a mean."""
        if value <= 0:
            raise InputError(f"{text}: must be above 0 mm with a surface compliance that varies")
        if value >= distance.statistics.mean - distance.touching:
            return PrescribedApproach(distance.approach_at(distance.statistics.mean - value))
        return SearchedMeanGap(value)

    @classmethod
    def check_grid(cls, grid):
        """Raise InputError unless the patch is periodic in x and y; see `Loading.check_grid`."""
        if not grid.doubly_periodic:
            doubt = "only on a periodic patch, in x and y, does it determine the approach"
            raise InputError(f"mean_gap: {doubt}; use approach, load or mean_pressure")

    @staticmethod
    def part_of_indentation(depth):
        """Return the mean depth; see `Loading.part_of_indentation`.

        The displacements of a periodic patch have no mean: the mean gap follows from the mean shape.
        """
        return depth

    def restore_prescribed(self, measures):
        """Restore the mean gap, at least 0; see `Loading.restore_prescribed`.

        The prescribed number is the mean of the gap e. The mean of max(e, 0) is larger if plastic cells overlap.
        """
        return measures if measures.mean_plastic_depth else measures._replace(mean_gap=self._mean_gap)

    def depth_on(self, distance):
        """Return the depth for the mean gap; see `Loading.depth_on`."""
        return self._depth + (distance.statistics.mean - self._mean)

    def begin(self, state):
        """Set the depth on this grid; see `Loading.begin`."""
        self.set_depth(state)

    def set_depth(self, state):
        """Set the depth, whose rounding error is an error of the mean gap; see `Loading.set_depth`."""
        super().set_depth(state)
        state.neglected_gap = ulp(state.depth)


class SearchedMeanGap(SearchedLoading):
    """Prescribed mean gap of cells with a compliance of their own.

    The number of the search is the mean gap at first touch over the mean gap, minus 1: it grows from 0.

    Parameters
    ----------
    mean_gap : float
        Mean of the gap e, above 0 and less than at first touch [mm].
    """

    name = kind = "mean_gap"
    is_geometric = True

    def __init__(self, mean_gap):
        super().__init__(_MIN_TARGET)
        self._mean_gap = mean_gap

    def _at_first_touch(self, state):
        return state.distance.statistics.mean - state.first_touch()

    def measure(self, state):
        """Return the number of a solved state; see `SearchedLoading.measure`."""
        gap = float(state.sum([state.total_gap()])[0]) / state.distance.statistics.cells
        return self._at_first_touch(state) / max(gap, _MIN_GAP * self._mean_gap) - 1

    def search(self, state, solve, rtol, step=None):
        """Find the approach; see `SearchedLoading.search`."""
        self.target = max(self._at_first_touch(state) / self._mean_gap - 1, _MIN_TARGET)
        return super().search(state, solve, rtol, step)

    @property
    def result_rtol(self):
        """Relative accuracy with which solutions have the number; residuals limit that of small gaps."""
        return min(_RTOL * (self.target + 1), _MAX_RTOL)
