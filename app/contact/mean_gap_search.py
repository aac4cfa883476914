"""Search for the approach that gives a mean gap, if displacements have an unknown mean."""

from app.contact.approach_search import SearchedLoading

_MIN_GAP = 1e-3  # least mean gap that the search distinguishes, over the prescribed one
_RTOL, _MAX_RTOL = 1e-5, 1e-2  # largest error of the mean gap, over that at first touch, and over itself
_MIN_TARGET = 1e-3  # of a coarser grid, on which the bodies may not touch at the prescribed mean gap


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
