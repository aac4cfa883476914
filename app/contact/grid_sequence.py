"""Loop over the grids of nested iteration (Sec. 4.3)."""

import itertools

from app.contact.grid_errors import UNKNOWN, compute_grid_numbers, estimate_errors
from app.contact.tilt import NO_TILT
from app.multigrid.direct import can_start_on


class GridSequence:
    """Levels of a nested iteration, from coarse to fine, and their results.

    Collective. An iteration yields the numbers of the levels. The ranks that share a grid have its results, and
    broadcast them to the ranks that join on the next grid. For the parameters see
    `app.contact.full_multigrid.full_multigrid`. If `only_target` is true, only the target grid is used.

    Attributes
    ----------
    following : int
        Number of the level that is solved after the present level.
    only_target : bool
        True if no coarser grid is used.
    at_target : bool
        True on the target grid, which is the last one.
    outcome : Outcome or None
        Outcome of the grid solved last, with the fallbacks of all grids.
    depth, tilt : float, Tilt
        Final depth [mm] and tilt on this grid.
    grid_numbers : list of GridNumbers
        Numbers of the coarser grids, from coarse to fine, if the method appends them.
    """

    def __init__(self, hierarchy, distances, loading, nested, only_target=False):
        self.hierarchy, self._loading = hierarchy, loading
        self._last = len(hierarchy.levels) - 1
        self._route = [self._last] if only_target else _route(hierarchy, distances, loading, nested)
        self.only_target = self._route[0] == self._last
        self.outcome, self.depth, self.grid_numbers, self.at_target = None, 0.0, [], False
        self.tilt = distances[-1].tilt

    def __iter__(self):
        for number, following in itertools.pairwise([*self._route, self._last]):
            self.following, self.at_target = following, number == self._last
            yield number

    def stopping_test(self, stop):
        """Return the current grid's stopping test, from the target's, `stop`."""
        return stop if self.at_target else stop.for_coarse_grid()

    def record(self, outcome, depth, tilt=NO_TILT):
        """Record the outcome, and the final depth [mm] and tilt of a grid."""
        self.depth, self.tilt = depth, tilt
        coarser = self.outcome.fallbacks if self.outcome else 0
        self.outcome = outcome._replace(fallbacks=coarser + outcome.fallbacks)
        self._loading.record(depth)

    def waiting_ranks(self, operator):
        """Return the communicator of rank 0 and idle ranks; elsewhere None.

        `operator` is that of the grid or of a window of it.
        """
        return self.hierarchy.ranks.idle_comm(operator.slabs.size)

    def broadcast_to_next(self, operator, extra=None):
        """Broadcast the results to ranks that join on the next grid. Collective.

        These ranks receive the results so far, and `extra`. `operator` is as in `waiting_ranks`. Return `extra`, which
        may be any object.
        """
        if self.hierarchy.gains_ranks(operator, self.following) and (comm := self.waiting_ranks(operator)):
            return self.share(comm, extra)
        return extra

    def share(self, comm, extra=None):
        """Give all ranks of `comm` the results and `extra` of its rank 0; return `extra`. Collective."""
        loading = self._loading
        results = self.depth, self.tilt, loading.shared_state, self.outcome, self.grid_numbers, extra
        results = comm.bcast_or_raise(results)
        self.depth, self.tilt, loading.shared_state, self.outcome, self.grid_numbers, extra = results
        return extra

    def result(self, state, difference=float("nan"), least=0.0, numbers=None):
        """Return the outcome with estimated errors and a pressure `difference`. Collective.

        The outcome has no difference below `least`, which the coarser grid's tolerance may cause. `numbers` are the
        GridNumbers of `state`, if known.
        """
        errors = UNKNOWN
        if self.grid_numbers:
            numbers = numbers or compute_grid_numbers(state, self.hierarchy.comm)
            grids = [*self.grid_numbers, numbers]
            errors = estimate_errors(grids, state.first_touch(), self._loading.exact, difference)
        known = difference if difference >= least else float("nan")
        return self.outcome._replace(discretisation_error=known, grid_errors=errors)


def _route(hierarchy, distances, loading, nested):
    """Return the numbers of the levels to solve on.

    A nested iteration begins on the coarsest level such that it and all finer levels have admissible cells, and cells
    that are small enough for the layer. Without nested iteration there is one solve on the target grid, after a solve
    on a small grid if the approach is unknown. If the bodies do not overlap, only the target grid is used: on a coarser
    grid they might overlap, and the pressure would then vanish only up to rounding.
    """
    last = len(hierarchy.levels) - 1
    if loading.misses_contact(distances[last]):
        return [last]
    usable = [number for number, distance in enumerate(distances) if distance.statistics.cells]
    usable = [number for number in usable if hierarchy.kernel.is_resolved(hierarchy.levels[number].grid)]
    if nested:
        return range(max(set(range(last)).difference(usable), default=-1) + 1, last + 1)
    small = [number for number in usable if can_start_on(hierarchy, number)]
    return [last] if loading.approach_is_known else [*small[-1:], last]
