"""The full multigrid scheme: the active set iteration inside a nested iteration over the grids (Sec. 4.3)."""

from __future__ import annotations

import numpy as np

from app.contact.iteration import active_set
from app.contact.state import ContactState, Displacement
from app.multigrid.direct import DirectSolver, solves_directly
from app.multigrid.linear_solver import LinearSolver


def full_multigrid(hierarchy, distances, loading, stop, history, beta=0.003, prolong=None, target_solver=None):
    """Solve on the target grid of a hierarchy, from the coarsest grid on.

    Collective. Replicated grids are solved by rank 0, which tells the others.

    Parameters
    ----------
    hierarchy : Hierarchy
    distances : list of UndeformedDistance
        On every level, coarsest first.
    loading : PrescribedApproach or PrescribedLoad
    stop : StoppingTest
    history : History
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
    for number in range(first_sighted(distances), last + 1):
        level, target = hierarchy.levels[number], number == last
        state = ContactState(level, distances[number])
        if coarse is not None:
            transfer = hierarchy.transfers[number]
            state.approach = loading.predict(coarse.approach)
            transfer.interpolate(coarse.u, state.u)  # 2. of Sec. 4.3: u bilinear
            state.u_is = Displacement.STALE
            if not (prolong and prolong(transfer, coarse, state)):
                copy_prolongation(transfer, coarse, state, beta)
            coarse.destroy()
        if target or level.comm is not None or hierarchy.comm.rank == 0:
            solver = target_solver if target and target_solver else solver_on(hierarchy, number, coarse is None)

            def solve(loading, state=state, solver=solver, target=target):
                """(3.b): until the contact area is unchanged, and on the target grid (5.1)."""
                test = stop if target else stop.for_coarse_grid()
                return active_set(state, solver, loading, test, history)

            # 1. the coarsest grid, directly if it is small; 3. and 4.: the others
            outcome = loading.first_solve(state, solve) if coarse is None else solve(loading)
            if solver is not target_solver:
                solver.destroy()
        if not target:
            tell(hierarchy, level, state, loading)
        coarse = state
    return state, outcome


def copy_prolongation(transfer, coarse, state, beta):
    """Steps 2 and (3.a): p by copy, C = {e <= beta max(u)} (4.1), p = 0 outside. u is interpolated already. Collective."""
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    np.less_equal(state.u - state.distance.b, beta * highest, out=state.contact)  # (4.1)
    state.contact &= state.admissible
    with state.pressure as values:
        p = values.reshape(state.u.shape)
        transfer.copy(coarse.p, p)
        np.copyto(p, 0.0, where=~state.contact)


def single_grid(hierarchy, distances, loading, stop, history, target_solver=None):
    """MG + active set, and NORM: the target grid alone, from C = {h <= 0} (Sec. 4.1). Collective.

    A prescribed load is met on a grid that is solved directly first, which is where the approach comes from.
    """
    last = len(hierarchy.levels) - 1
    if loading.prescribes_load:
        first = first_sighted(distances)
        small = [l for l in range(first, last) if solves_directly(hierarchy.levels[l])]
        if small:
            level = hierarchy.levels[small[-1]]
            coarse = ContactState(level, distances[small[-1]])
            if hierarchy.comm.rank == 0:
                solver = DirectSolver(level, small[-1])
                test = stop.for_coarse_grid()
                loading.first_solve(coarse, lambda inner: active_set(coarse, solver, inner, test, history))
                solver.destroy()
            tell(hierarchy, level, coarse, loading)
    state = ContactState(hierarchy.target, distances[-1])
    solver = target_solver or solver_on(hierarchy, last)

    def solve(inner):
        return active_set(state, solver, inner, stop, history)

    if loading.prescribes_load and small:
        state.approach = coarse.approach
        coarse.destroy()
        state.start_from_interpenetration()
        outcome = solve(loading)
    else:
        outcome = loading.first_solve(state, solve)
    if solver is not target_solver:
        solver.destroy()
    return state, outcome


def first_sighted(distances):
    """First level with a cell where contact is possible: coarser grids say nothing. Not collective."""
    return next(number for number, distance in enumerate(distances) if distance.statistics.cells)


def solver_on(hierarchy, number, coarsest=False):
    """Make the solver of a level: directly if it is the first and small enough. Collective over its ranks."""
    operator = hierarchy.levels[number]
    if coarsest and number < len(hierarchy.levels) - 1 and solves_directly(operator):
        return DirectSolver(operator, number)
    return LinearSolver(hierarchy, number, operator.petsc_comm)


def tell(hierarchy, level, state, loading):
    """Give all ranks what rank 0 has found on a replicated grid. Collective."""
    comm = hierarchy.comm
    if level.comm is not None or comm.size == 1:
        return
    with state.pressure as p:
        comm.Bcast(p)
    comm.Bcast(state.u)
    comm.Bcast(state.contact)
    state.approach, loading.slope = comm.bcast((state.approach, loading.slope))
