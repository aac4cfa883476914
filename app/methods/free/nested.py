"""The nested iteration of the default method (Sec. 4.3 with lifted pressures and windows)."""

from __future__ import annotations

from functools import partial

from app.contact.active_set import active_set
from app.contact.full_multigrid import prolongate
from app.contact.grid_errors import compute_grid_numbers, pressure_difference
from app.contact.grid_sequence import GridSequence
from app.contact.stopping import StoppingTest
from app.methods.free.iteration import inexact_active_set
from app.methods.free.lift import lift
from app.methods.free.windows import WindowedLevel
from app.methods.progress import NeedsSafeguard
from app.methods.safeguard import projected_newton
from app.multigrid.direct import starts_directly
from app.multigrid.linear_solver import LinearSolver
from app.parallel.communicator import propagate_errors

# The difference of the pressures on two grids says something if coarser ones are solved to this share of it.
MAX_COARSE_ERROR = 0.02


def nested_iteration(
    hierarchy, distances, loading, stop, history, nested, beta, lifted, coarse_minimum, kept
):
    """Solve on the target grid of a hierarchy, from the coarsest grid on.

    Collective. A grid is solved by the ranks that share it, or its window, and they tell those that join on the next.

    Parameters
    ----------
    hierarchy, distances, loading, stop, history, nested, beta
        See `app.contact.full_multigrid.full_multigrid`; `stop` is an InexactStop.
    lifted : bool
        Pressures of finer grids by `lift`, else by copy.
    coarse_minimum : ndarray or None
        See `Hierarchy.coarse_minimum`.
    kept : WindowCache
        Solvers, and operators of windows.

    Returns
    -------
    ContactState, Outcome
        On the target grid.
    """
    grids, comm = GridSequence(hierarchy, distances, loading, nested), hierarchy.comm
    coarse = boxes = None
    difference = float("nan")
    for number in grids:
        stage = WindowedLevel(hierarchy, kept, number, distances[number], coarse if nested else None, boxes)
        state, first, target = stage.state, coarse is None, grids.at_target
        if not first:
            state.depth = loading.predict(coarse.depth)
            if nested:
                prolongate(stage.transfer, stage.coarse, state, beta, lift if lifted else None)
                coarse_pressure, stage.coarse = stage.coarse.p, None
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        coarse = state  # for the next grid; the arrays of the coarser one go
        if state.operator.active:
            with propagate_errors(grids.waiting_ranks(state)):
                solved = solve_level(
                    hierarchy, number, state, loading, grids.stopping_test(stop), history, first, kept
                )
            grids.record(solved, state.depth)
            if not target:
                boxes = stage.boxes_for_next(coarse_minimum, loading.predict(state.depth))
                if nested:
                    grids.grid_numbers.append(compute_grid_numbers(state, state.comm))
        stage.end_verification()
        boxes = grids.broadcast_to_next(state, boxes)
        if nested and target and not first:
            difference = pressure_difference(comm, stage.transfer, coarse_pressure, state)
        stage.close()
        if target and stage.windowed:
            coarse = None  # the window's arrays go
            state, complete = stage.expand_to_grid(grids.outcome.converged)
            if not complete:
                rest = solve_level(hierarchy, number, state, loading, stop, history, False, kept)
                grids.outcome = rest.after(grids.outcome)
    if stop.coarse_rtol > MAX_COARSE_ERROR * difference:
        difference = float("nan")
    return state, grids.result(state, difference)


def solve_level(hierarchy, number, state, loading, stop, history, first, kept):
    """Solve on one grid. Collective over the ranks of `state`."""
    operator = state.operator
    if first and starts_directly(hierarchy, number):
        test = StoppingTest(max_it=stop.max_it).for_coarse_grid()
        solve = partial(active_set, state, kept.direct(number, operator), stop=test, history=history)
    else:
        solve = partial(inexact_active_set, state, kept.solver(number, operator), stop=stop, history=history)
    try:
        return loading.first_solve(state, solve) if first else solve(loading)
    except NeedsSafeguard as stagnation:
        outcome = stagnation.outcome
    finally:
        kept.release_solver(operator)
    return solve_safeguarded(hierarchy, number, state, loading, stop, history).after(outcome)


def solve_safeguarded(hierarchy, number, state, loading, stop, history):
    """Solve on one grid by the safeguard, from what is there. Collective over the ranks of `state`."""
    operator = state.operator
    with operator.double_precision():
        solver = LinearSolver(hierarchy, number, operator=operator)

        def solve(_, stop):  # the state has the approach
            return projected_newton(state, solver, stop, history)

        try:
            step = state.on_contact_or_overlap().rms
            outcome = loading.solve_by_search(state, solve, stop, 0.1, 0.1 * stop.rtol, step)
        finally:
            solver.destroy()
    return outcome._replace(fallbacks=outcome.fallbacks + 1)
