"""The full multigrid scheme: the active set iteration inside a nested iteration over the grids (Sec. 4.3).

With one grid to visit, the target, it is the active set iteration alone (Sec. 3 and 4.1).
"""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from app.contact.grid_errors import estimated_errors
from app.contact.iteration import active_set_or_search
from app.contact.state import ContactState, Displacement
from app.multigrid.direct import DirectSolver, begins_directly
from app.multigrid.linear_solver import LinearSolver


def full_multigrid(
    hierarchy, distances, loading, stop, history, nested=True, beta=0.003, prolong=None, target_solver=None
):
    """Solve on the target grid of a hierarchy, from the coarsest grid on.

    Collective. A grid is solved by the ranks that share it, and they tell those that join them on the next.

    Parameters
    ----------
    hierarchy : Hierarchy
    distances : list of UndeformedDistance
        On every level, coarsest first.
    loading : PrescribedApproach or PrescribedLoad
    stop : StoppingTest
    history : History
    nested : bool
        Nested iteration; else the target grid alone, from C = {h <= 0}.
    beta : float
        (4.1).
    prolong : callable, optional
        See `prolongate`.
    target_solver : LinearSolver, optional
        Of the target grid, if there is one already.

    Returns
    -------
    ContactState, Outcome
        On the target grid.
    """
    visits, coarse = Visits(hierarchy, distances, loading, nested), None
    for number in visits:
        level = hierarchy.levels[number]
        state = ContactState(level, distances[number])
        if coarse is not None:
            state.depth = loading.predict(coarse.depth)
            if nested:
                prolongate(hierarchy.transfers[number], coarse, state, beta, prolong)
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        if level.active:
            solver = target_solver if visits.at_target else None
            solver = solver or _solver_on(hierarchy, number, first=coarse is None)
            # (3.b): until the contact area is unchanged, and on the target grid (5.1)
            test = stop if visits.at_target else stop.for_coarse_grid()
            solve = partial(active_set_or_search, state, solver, stop=test, history=history)
            # Sec. 4.3, 1: the coarsest grid, directly if it is small; Sec. 4.3, 3 and 4: the others, to the target
            found = loading.first_solve(state, solve) if coarse is None else solve(loading)
            visits.solved(found, state.depth)
            if solver is not target_solver:
                solver.destroy()
        visits.leave(state)
        coarse = state
    return state, visits.outcome


class Visits:
    """The levels that a nested iteration goes through, from coarse to fine, and what is found on the way.

    Iterate over it for their numbers. What is found, ranks that share a grid know; when it is left they tell those
    that join on the next. Collective.

    Parameters
    ----------
    hierarchy, distances, loading, nested
        See `full_multigrid`.
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
        self._route = [self._last] if only_target else route(hierarchy, distances, loading, nested)
        self.outcome, self.grid_numbers, self.at_target = None, [], False

    def __iter__(self):
        for number, following in itertools.pairwise([*self._route, self._last]):
            self.following, self.at_target = following, number == self._last
            yield number

    def solved(self, outcome, depth):
        """Take note of the outcome on a grid, and of its depth [mm]. Not collective."""
        self.outcome = outcome.on_from(self.outcome)
        self._loading.solved(depth)

    def leave(self, state, found=None):
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
        if not self.hierarchy.joined(state.operator, self.following):
            return found
        known = state.depth, self._loading.known, self.outcome, self.grid_numbers, found
        depth, loading, self.outcome, self.grid_numbers, found = self.hierarchy.comm.bcast(known)
        if not state.operator.active:
            self._loading.known, state.depth = loading, depth
        return found

    def result(self, state, difference=float("nan")):
        """Return the outcome with what grids tell of errors, `difference` that of the pressures. Collective."""
        loading = self._loading
        errors = estimated_errors(self.grid_numbers, state, self.hierarchy.comm, loading.prescribes_load)
        return self.outcome._replace(discretisation_error=difference, grid_errors=errors)


def route(hierarchy, distances, loading, nested):
    """Numbers of the levels to visit. Not collective.

    Without nested iteration that is the target alone; a prescribed load is met on a grid that is solved directly first,
    which is where the approach to begin with comes from. Grids so coarse that no cell is admissible say nothing, and a
    function may have one on a grid and none on the next finer one.
    """
    last = len(hierarchy.levels) - 1
    sighted = [number for number, distance in enumerate(distances) if distance.statistics.cells]
    if nested:
        return range(max(set(range(last)).difference(sighted), default=-1) + 1, last + 1)
    small = [number for number in sighted if begins_directly(hierarchy, number)]
    return [*small[-1:], last] if loading.prescribes_load else [last]


def prolongate(transfer, coarse, state, beta, prolong=None):
    """Sec. 4.3, 2 and (3.a): u bilinear, then C and p by ``prolong(transfer, coarse, state)``, or if false by copy.

    Collective.
    """
    transfer.interpolate(coarse.u, state.u)
    state.u_is = Displacement.STALE
    if not (prolong and prolong(transfer, coarse, state)):
        copy_prolongation(transfer, coarse, state, beta)


def copy_prolongation(transfer, coarse, state, beta):
    """Sec. 4.3, 2 and (3.a): p by copy, C = {e <= beta max(u)} (4.1), p = 0 outside; u is there already. Collective."""
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    np.less_equal(state.u - state.distance.b, beta * highest, out=state.contact)  # (4.1)
    state.contact &= state.admissible
    with state.pressure as values:
        p = values.reshape(state.u.shape)
        transfer.copy(coarse.p, p)
        np.copyto(p, 0.0, where=~state.contact)


def _solver_on(hierarchy, number, first):
    """Make the solver of a level: directly if it is the first and small enough. Collective over its ranks."""
    operator = hierarchy.levels[number]
    if first and begins_directly(hierarchy, number):
        return DirectSolver(operator, number)
    return LinearSolver(hierarchy, number, operator.petsc_comm)
