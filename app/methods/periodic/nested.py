"""Nested iteration (Sec. 4.3) of the periodic method."""

import numpy as np

from app.contact.active_set import NO_CONTACT
from app.contact.grid_errors import compute_grid_numbers, pressure_difference
from app.contact.grid_sequence import GridSequence
from app.contact.history import Outcome
from app.contact.periodic_state import PeriodicState
from app.methods.periodic.capped_state import primal_state
from app.methods.periodic.iteration import primal_active_set
from app.methods.periodic.operator import InverseOperator
from app.methods.progress import NeedsSafeguard
from app.methods.safeguard import solve_safeguarded
from app.options.solver_options import temporary_options
from app.parallel.communicator import propagate_errors

# CG for pressures, preconditioned by the exact inverse of A
_SAFEGUARD = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "python",
    "pc_python_type": "app.methods.free.circulant.Circulant",
}


def primal_iteration(
    hierarchy, distances, loading, stop, history, cache, start=None, lists=None, use_all_cells=None
):  # fmt: skip
    """Solve on all periodic grids, from the coarsest to the target.

    Collective. Parameters and result are as in `app.methods.free.nested.nested_iteration`, but the cache contains
    PrimalSolvers. If `start`, a Solution on the target grid, is given, the iteration starts from it, and coarser grids
    are left out. If the DiluteContact `lists` does not solve the fine grids, ``use_all_cells()`` is called before
    they are solved on all cells.
    """
    last, comm, nested = len(hierarchy.levels) - 1, hierarchy.comm, stop.settings.nested
    grids = GridSequence(hierarchy, distances, loading, nested, only_target=not nested or start is not None)
    if lists and grids.only_target:  # lists begin with the contact on a coarser grid
        lists = None
        use_all_cells()
    if loading.misses_contact(distances[last]):  # rounding would find a pressure in cells that just touch
        state = PeriodicState(hierarchy.target, distances[last])
        loading.set_depth(state)
        history.start(state, cache.solver(last, hierarchy.target))
        state.start_from_interpenetration()
        return state, Outcome(True, NO_CONTACT)
    coarse, coarse_pressure, difference = None, None, float("nan")
    for number in grids:
        if lists and coarse is not None and lists.suit(number, loading):
            if solved := lists.solve(number, coarse.loaded_cells(), loading, stop, history, grids):
                coarse.destroy()
                state, difference, numbers = solved
                return state, grids.result(state, difference, numbers=numbers)
            lists = None
            use_all_cells()
        level, coarser = hierarchy.levels[number], grids.grid_numbers
        solver = cache.solver(number, level) if level.active else None
        inverse = solver.inverse if level.active else InverseOperator(level)
        primal = primal_state(level, distances[number], inverse, loading)
        if start is not None:
            primal.continue_from(start)
        elif coarse is None:
            primal.w[...] = primal.distance.b  # full contact
        else:
            primal.interpolate_from(coarse, hierarchy.transfers[number])
            if coarser:  # else there are no rows here yet
                primal.shift_to_depth(coarser[-1].depth, loading.predict(coarser[-1].depth))
            coarse_pressure = coarse.p
            coarse.destroy()
            coarse = None
        if level.active:
            with propagate_errors(grids.waiting_ranks(level)):
                outcome = _solve_on(hierarchy, number, primal, solver, grids.stopping_test(stop), history)
            cache.release_solver(level)
            if not grids.at_target:
                coarser.append(compute_grid_numbers(primal, primal.comm)._replace(load=primal.load))
            grids.record(outcome, primal.solution.depth if grids.at_target else coarser[-1].depth)
        primal.mean_pressure = grids.broadcast_to_next(level, primal.mean_pressure)
        if grids.at_target and coarse_pressure is not None:
            difference = pressure_difference(comm, hierarchy.transfers[number], coarse_pressure, primal)
        coarse = primal
    coarse.destroy()
    return primal.solution, grids.result(primal.solution, difference)


def _solve_on(hierarchy, number, primal, solver, stop, history):
    """Solve on one grid, and return the Outcome.

    If the iteration stagnates, the safeguard solves. With a layer, the iteration is first repeated without
    extrapolation.
    """
    start, failed = primal.copy_start() if primal.operator.kernel.layers else None, None
    try:
        if start is not None:
            try:
                return primal_active_set(primal, solver, stop, history)
            except NeedsSafeguard as stagnation:
                failed = stagnation.outcome
            primal.restart(start)
        outcome = primal_active_set(primal, solver, stop, history)
        return outcome if failed is None else outcome.after(failed)
    except NeedsSafeguard as stagnation:
        primal.reset_for_safeguard()
        primal.meet_load(primal.project(solver.scratch))
        primal.solution = state = primal.hand_out()
        with temporary_options(hierarchy.prefix, {}, _SAFEGUARD):
            rest = solve_safeguarded(hierarchy, number, state, primal.loading, stop, history)
        np.subtract(state.u, state.depth, out=primal.w)
        primal.mean_pressure = primal.mean(state.p)
        return rest.after(stagnation.outcome)
    finally:
        solver.end()
