"""The full multigrid scheme: the active set iteration inside a nested iteration over the grids (Sec. 4.3).

With one grid to visit, the target, it is the active set iteration alone (Sec. 3 and 4.1).
"""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from app.contact.iteration import active_set_or_search
from app.contact.state import ContactState, Displacement
from app.multigrid.direct import DirectSolver, solves_directly
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
        ``prolong(transfer, coarse_state, state) -> bool``, in place of step 2 and (4.1) where it returns true.
    target_solver : LinearSolver, optional
        Of the target grid, if there is one already.

    Returns
    -------
    ContactState, Outcome
        On the target grid.
    """
    last = len(hierarchy.levels) - 1
    coarse = outcome = None
    for number, following in pairs(route(hierarchy, distances, loading, nested)):
        level, target = hierarchy.levels[number], number == last
        state = ContactState(level, distances[number])
        if coarse is not None:
            state.depth = loading.predict(coarse.depth)
            if nested:
                transfer = hierarchy.transfers[number]
                transfer.interpolate(coarse.u, state.u)  # Sec. 4.3, 2: u bilinear
                state.u_is = Displacement.STALE
                if not (prolong and prolong(transfer, coarse, state)):
                    copy_prolongation(transfer, coarse, state, beta)
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        if level.active:
            solver = target_solver if target else None
            solver = solver or solver_on(hierarchy, number, coarse is None)
            # (3.b): until the contact area is unchanged, and on the target grid (5.1)
            test = stop if target else stop.for_coarse_grid()
            solve = partial(active_set_or_search, state, solver, stop=test, history=history)
            # Sec. 4.3, 1: the coarsest grid, directly if it is small; Sec. 4.3, 3 and 4: the others, to the target
            found = loading.first_solve(state, solve) if coarse is None else solve(loading)
            outcome = found.on_from(outcome)
            loading.solved(state.depth)
            if solver is not target_solver:
                solver.destroy()
        [outcome] = tell(hierarchy, following, state, loading, outcome)
        coarse = state
    return state, outcome


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
    small = [number for number in sighted if number < last and solves_directly(hierarchy.levels[number])]
    return [*small[-1:], last] if loading.prescribes_load else [last]


def pairs(numbers):
    """Each number and the next one, the last and itself. Not collective."""
    return itertools.pairwise([*numbers, numbers[-1]])


def copy_prolongation(transfer, coarse, state, beta):
    """Sec. 4.3, 2 and (3.a): p by copy, C = {e <= beta max(u)} (4.1), p = 0 outside; u is there already. Collective."""
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    np.less_equal(state.u - state.distance.b, beta * highest, out=state.contact)  # (4.1)
    state.contact &= state.admissible
    with state.pressure as values:
        p = values.reshape(state.u.shape)
        transfer.copy(coarse.p, p)
        np.copyto(p, 0.0, where=~state.contact)


def solver_on(hierarchy, number, coarsest=False):
    """Make the solver of a level: directly if it is the first and small enough. Collective over its ranks."""
    operator = hierarchy.levels[number]
    if coarsest and number < len(hierarchy.levels) - 1 and solves_directly(operator):
        return DirectSolver(operator, number)
    return LinearSolver(hierarchy, number, operator.petsc_comm)


def tell(hierarchy, following, state, loading, *facts):
    """Give what is known after a grid to the ranks that join on the next one. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    following : int
        Number of the level of that.
    state : ContactState
        On the grid solved, or a window of it: gets its depth.
    loading : PrescribedApproach or PrescribedLoad
        Gets what was found out about it.
    *facts
        More that the ranks of the grid know.

    Returns
    -------
    tuple
        These.
    """
    if hierarchy.joined(state.operator, following):
        depth, known, facts = hierarchy.comm.bcast((state.depth, loading.known, facts))
        if not state.operator.active:
            loading.known = known
            state.depth = depth
    return facts
