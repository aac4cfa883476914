"""Nested iteration (Sec. 4.3) with lifted pressures and windows around contact."""

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
from app.methods.safeguard import solve_safeguarded
from app.multigrid.direct import starts_directly
from app.parallel.communicator import propagate_errors

MAX_COARSE_ERROR = 0.02  # of coarser grids, over the difference of pressures that estimates the grid error


def nested_iteration(hierarchy, distances, loading, stop, history, coarse_minimum, cache, lists=None):
    """Solve on all grids, from coarsest to target.

    Collective. Only the ranks that own rows of a grid or window solve on it. They broadcast the results to the ranks
    that join on the next grid.

    Parameters
    ----------
    hierarchy, distances, loading, stop, history
        See `app.contact.full_multigrid.full_multigrid`; `stop` is an InexactStop, with the settings.
    coarse_minimum : ndarray or None
        Smallest undeformed distance within each cell of the finest grid that is solved without a window, over the cells
        of the target grid (`Hierarchy.coarse_minimum`).
    cache : WindowCache
        Solvers and window operators.
    lists : DiluteContact, optional
        Solver of fine grids with dilute contact, if it suits the loading.

    Returns
    -------
    ContactState, Outcome
        Solution on the target grid, and how the solve ended.
    """
    settings, comm, level, coarse, boxes = stop.settings, hierarchy.comm, None, None, None
    lifts = settings.prolongation == "lift" and hierarchy.target.compliance is None
    nested, prolong = settings.nested, lift if lifts else None
    grids = GridSequence(hierarchy, distances, loading, nested)
    lists = None if grids.only_target else lists  # they begin with the contact on a coarser grid
    if hierarchy.lists and not lists:
        hierarchy.prepare_target()  # first: it lends its storage
    difference, least_difference = float("nan"), settings.coarse_rtol / MAX_COARSE_ERROR
    for number in grids:
        if lists and coarse is not None and lists.suit(number, loading):
            if solved := lists.solve(number, level.loaded_cells(), loading, stop, history, grids):
                coarse.destroy()
                state, difference, numbers = solved
                return state, grids.result(state, difference, least_difference, numbers)
            lists = None
            hierarchy.prepare_target()
        distances[number].tilt_to(grids.tilt)
        level = WindowedLevel(hierarchy, cache, number, distances[number], coarse if nested else None, boxes)
        state, first, target = level.state, coarse is None, grids.at_target
        if not first:
            state.depth = loading.predict(grids.depth)
            if nested:
                prolongate(level.transfer, level.coarse, state, settings.beta, prolong)
                coarse_pressure, level.coarse = level.coarse.p, None
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        coarse = state  # for the next grid; the arrays of the coarser one are freed
        if state.operator.active:
            test = grids.stopping_test(stop)
            with propagate_errors(grids.waiting_ranks(state.operator)):
                outcome = solve_level(hierarchy, number, state, loading, test, history, first, cache)
            grids.record(outcome, state.depth, state.distance.tilt)
            if not target:
                boxes = level.boxes_for_next(coarse_minimum, loading.predict(state.depth))
                if nested:
                    grids.grid_numbers.append(compute_grid_numbers(state, state.comm))
        if level.verification:
            level.verification.end(state)
        boxes = grids.broadcast_to_next(state.operator, boxes)
        if nested and target and not first:
            difference = pressure_difference(comm, level.transfer, coarse_pressure, state)
        level.close()
        if target and level.windowed:
            coarse = None  # the arrays of the window are freed
            distances[number].tilt_to(grids.tilt)
            state, complete = level.expand_to_grid(grids.depth, grids.outcome.converged)
            if not complete:
                rest = solve_level(hierarchy, number, state, loading, stop, history, False, cache)
                grids.outcome = rest.after(grids.outcome)
    return state, grids.result(state, difference, least_difference)


def solve_level(hierarchy, number, state, loading, stop, history, first, cache):
    """Solve on one grid, by the safeguard if the default method stagnates.

    Collective over the ranks of `state`. `first` is true on the coarsest grid, which is solved directly if it is small.
    """
    operator = state.operator
    if first and loading.tilts:  # the position is unknown
        outcome = solve_safeguarded(hierarchy, number, state, loading, stop, history)
        return outcome._replace(fallbacks=0)
    if first and starts_directly(hierarchy, number):
        test = StoppingTest(max_it=stop.max_it).for_coarse_grid()
        solve = partial(active_set, state, cache.direct(number, operator), stop=test, history=history)
    else:
        solve = partial(inexact_active_set, state, cache.solver(number, operator), stop=stop, history=history)
    try:
        return (loading.first_solve if first else loading.next_solve)(state, solve)
    except NeedsSafeguard as stagnation:
        outcome = stagnation.outcome
    finally:
        cache.release_solver(operator)
    return solve_safeguarded(hierarchy, number, state, loading, stop, history).after(outcome)
