"""The way of a nested iteration through the grids (Sec. 4.3), whatever solves on them."""

from __future__ import annotations

import itertools

from app.contact.grid_errors import estimated_errors
from app.multigrid.direct import can_start_on


class GridSequence:
    """The levels that a nested iteration goes through, from coarse to fine, and what is found on the way.

    Iterate over it for their numbers. What is found, ranks that share a grid know; when it is left they tell those
    that join on the next. Collective.

    Parameters
    ----------
    hierarchy, distances, loading, nested
        See `app.contact.full_multigrid.full_multigrid`.
    only_target : bool
        Leave out all others.

    Attributes
    ----------
    following : int
        Number of the level after this one.
    at_target : bool
        Whether this is the last one.
    outcome : Outcome or None
        Of the grid solved last; fallbacks of all.
    grid_numbers : list of GridNumbers
        Of the grids left behind, from coarse to fine, if whoever solves adds them.
    """

    def __init__(self, hierarchy, distances, loading, nested, only_target=False):
        self.hierarchy, self._loading = hierarchy, loading
        self._last = len(hierarchy.levels) - 1
        self._route = [self._last] if only_target else _route(hierarchy, distances, loading, nested)
        self.outcome, self.grid_numbers, self.at_target = None, [], False

    def __iter__(self):
        for number, following in itertools.pairwise([*self._route, self._last]):
            self.following, self.at_target = following, number == self._last
            yield number

    def stopping_test(self, stop):
        """Return the test to be met on this grid, by that of the target. Not collective."""
        return stop if self.at_target else stop.for_coarse_grid()

    def record(self, outcome, depth):
        """Take note of the outcome on a grid, and of its depth [mm]. Not collective."""
        self.outcome = outcome.add_fallbacks(self.outcome)
        self._loading.record(depth)

    def waiting_ranks(self, state):
        """Communicator of rank 0 and those that wait while a grid is solved, or None. Collective over these."""
        return self.hierarchy.ranks.idle_comm(state.operator.slabs.size)

    def broadcast_to_next(self, state, found=None):
        """Go on to the next grid.

        Collective.

        Parameters
        ----------
        state : ContactState
            On the grid solved, or a window of it. Gets its depth on ranks that had no part in it.
        found : any
            More that the ranks of the grid know.

        Returns
        -------
        any
            That, on all ranks of the next grid.
        """
        if self.hierarchy.gains_ranks(state.operator, self.following) and (comm := self.waiting_ranks(state)):
            known = comm.bcast_or_raise(
                (state.depth, self._loading.shared, self.outcome, self.grid_numbers, found)
            )
            state.depth, self._loading.shared, self.outcome, self.grid_numbers, found = known
        return found

    def result(self, state, difference=float("nan")):
        """Return the outcome with what grids tell of errors, `difference` that of the pressures. Collective."""
        loading = self._loading
        errors = estimated_errors(self.grid_numbers, state, self.hierarchy.comm, loading.kind)
        return self.outcome._replace(discretisation_error=difference, grid_errors=errors)


def _route(hierarchy, distances, loading, nested):
    """Numbers of the levels to visit. Not collective.

    Without nested iteration that is the target alone; a prescribed load is met on a small grid first, which is where
    the approach to begin with comes from. Grids so coarse that no cell is admissible say nothing, and a function may
    have one on a grid and none on the next finer one. At first touch and before it there is no pressure: one from a
    coarser grid, where bodies may overlap, would go down to rounding only.
    """
    last = len(hierarchy.levels) - 1
    if loading.misses_contact(distances[last]):
        return [last]
    sighted = [number for number, distance in enumerate(distances) if distance.statistics.cells]
    if nested:
        return range(max(set(range(last)).difference(sighted), default=-1) + 1, last + 1)
    small = [number for number in sighted if can_start_on(hierarchy, number)]
    return [last] if loading.approach_is_known else [*small[-1:], last]
