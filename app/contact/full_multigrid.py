"""The full multigrid scheme: the active set iteration inside a nested iteration over the grids (Sec. 4.3).

With one grid to visit, the target, it is the active set iteration alone (Sec. 3 and 4.1).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from app.contact.active_set import active_set_or_search
from app.contact.grid_sequence import GridSequence
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.multigrid.direct import DirectSolver, starts_directly
from app.multigrid.linear_solver import LinearSolver
from app.parallel.communicator import propagate_errors


def full_multigrid(hierarchy, distances, loading, stop, history, nested, beta, prolong, target_solver):
    """Solve on the target grid of a hierarchy, from the coarsest grid on.

    Collective. A grid is solved by the ranks that share it, and they tell those that join them on the next.

    Parameters
    ----------
    hierarchy : Hierarchy
    distances : list of UndeformedDistance
        On every level, coarsest first.
    loading : Loading
    stop : StoppingTest
    history : History
    nested : bool
        Nested iteration; else the target grid alone, from C = {h <= 0}.
    beta : float
        (4.1).
    prolong : callable or None
        See `prolongate`.
    target_solver : LinearSolver
        Of the target grid.

    Returns
    -------
    ContactState, Outcome
        On the target grid.
    """
    grids, coarse = GridSequence(hierarchy, distances, loading, nested), None
    for number in grids:  # Sec. 4.3, 4: steps 2 and 3 up to the target grid
        level = hierarchy.levels[number]
        state = contact_state(level, distances[number])
        if coarse is not None:
            state.depth = loading.predict(coarse.depth)
            if nested:
                prolongate(hierarchy.transfers[number], coarse, state, beta, prolong)
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        if level.active:
            solver = target_solver
            if not grids.at_target:
                solver = _solver_on(hierarchy, number, first=coarse is None)
            # Sec. 4.3, 3, (3.b): until the contact area is unchanged, and on the target grid (5.1)
            solve = partial(
                active_set_or_search, state, solver, stop=grids.stopping_test(stop), history=history
            )
            # Sec. 4.3, 1: the coarsest grid, directly if it is small
            with propagate_errors(grids.waiting_ranks(state)):
                found = loading.first_solve(state, solve) if coarse is None else solve(loading)
            grids.record(found, state.depth)
            if solver is not target_solver:
                solver.destroy()
        grids.broadcast_to_next(state)
        coarse = state
    return state, grids.outcome


def prolongate(transfer, coarse, state, beta, prolong):
    """Sec. 4.3, 2 and (3.a): u bilinear, then C and p by ``prolong(transfer, coarse, state)``, or if false by copy.

    Collective.
    """
    transfer.interpolate(coarse.u, state.u)
    state.displacement_status = Displacement.STALE
    if not (prolong and prolong(transfer, coarse, state)):
        copy_prolongation(transfer, coarse, state, beta)


def copy_prolongation(transfer, coarse, state, beta):
    """Sec. 4.3, 2 and (3.a): p by copy, C = {e <= beta max(u)} (4.1), p = 0 outside; u is there already. Collective."""
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    np.less_equal(state.gap(), beta * highest, out=state.contact)  # (4.1)
    state.contact &= state.admissible
    p = state.values
    transfer.copy(coarse.p, p)
    state.bounds.project(state.p, state.contact, p)


def _solver_on(hierarchy, number, first):
    """Make the solver of a level: directly if it is the first and small enough. Collective over its ranks."""
    operator = hierarchy.levels[number]
    if first and starts_directly(hierarchy, number):
        return DirectSolver(operator, number)
    return LinearSolver(hierarchy, number)
