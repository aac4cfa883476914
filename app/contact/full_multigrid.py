"""Full multigrid: the active set iteration in a nested iteration (Sec. 4.3).

If only the target grid is used, the method is the active set iteration alone (Sec. 3 and 4.1).
"""

from functools import partial

import numpy as np

from app.contact.active_set import active_set_or_search
from app.contact.grid_sequence import GridSequence
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.multigrid.direct import starts_directly
from app.parallel.communicator import propagate_errors


def full_multigrid(hierarchy, distances, loading, stop, history, nested, beta, prolong, cache, iterate=None):
    """Solve on the grids from coarsest to target.

    Collective. The ranks of a grid solve on it, and broadcast the result to the ranks that join on the next grid.

    Parameters
    ----------
    hierarchy : Hierarchy
    distances : list of UndeformedDistance
        Undeformed distances on all levels, coarsest first.
    loading : Loading
    stop : StoppingTest
    history : History
    nested : bool
        True for a nested iteration. Otherwise only the target grid is used, from C = {h <= 0}.
    beta : float
        Option -lcp_beta: tolerance (4.1) of a grid's first contact set, divided by the largest displacement.
    prolong : callable or None
        Function used instead of the prolongation by copy; see `prolongate`.
    cache : SolverCache
        Linear solvers of the grids.
    iterate : callable, optional
        Function ``iterate(number, state, solver, loading, stop, history, first)`` that solves on a grid instead of
        `active_set_or_search`; `first` is true on the first grid.

    Returns
    -------
    ContactState, Outcome
        Solution and outcome on the target grid.
    """
    grids, coarse = GridSequence(hierarchy, distances, loading, nested), None
    for number in grids:  # Sec. 4.3, 4
        level = hierarchy.levels[number]
        state = contact_state(level, distances[number])
        if coarse is not None:
            state.depth = loading.predict(grids.depth)
            if nested:
                prolongate(hierarchy.transfers[number], coarse, state, beta, prolong)  # Sec. 4.3, 2
            else:
                state.start_from_interpenetration()
            coarse.destroy()
        if level.active:
            is_direct = coarse is None and not iterate and starts_directly(hierarchy, number)
            solver = (cache.direct if is_direct else cache.solver)(number, level)
            test = grids.stopping_test(stop)
            solve = partial(active_set_or_search, state, solver, stop=test, history=history)
            with propagate_errors(grids.waiting_ranks(level)):
                if iterate:
                    outcome = iterate(number, state, solver, loading, test, history, coarse is None)
                elif coarse is None:
                    outcome = loading.first_solve(state, solve)  # Sec. 4.3, 1
                else:
                    outcome = loading.next_solve(state, solve)  # Sec. 4.3, (3.b)
            grids.record(outcome, state.depth)
            cache.release_solver(level)
        grids.broadcast_to_next(level)
        coarse = state
    return state, grids.outcome


def prolongate(transfer, coarse, state, beta, prolong):
    """Set contact, p and u from the coarser grid. Collective.

    The function ``prolong(transfer, coarse, state)`` sets C and p. If `prolong` is None or returns false,
    `copy_prolongation` sets them.
    """
    transfer.interpolate(coarse.u, state.u)
    state.displacement_status = Displacement.STALE
    if not (prolong and prolong(transfer, coarse, state)):
        copy_prolongation(transfer, coarse, state, beta)


def copy_prolongation(transfer, coarse, state, beta):
    """Set contact by the tolerance (4.1), and p by copying. Collective.

    Let u be the displacement interpolated from the coarser grid, and e = h + u the gap. C has the admissible cells with
    e <= beta max(u); `beta` is the option -lcp_beta. With an upper bound of p, a local Jacobi step first finds the
    plastic cells.
    """
    max_u = -float(state.minimum(-state.u.max(initial=-np.inf)))
    # Sec. 4.3, (3.a)
    gap, p = state.gap(), state.values
    np.less_equal(gap, beta * max_u, out=state.contact)  # (4.1)
    state.contact &= state.admissible
    transfer.copy(coarse.p, p)
    plastic = state.bounds.plastic_after(p, gap, state.operator.diagonal)
    state.bounds.project_sets(p, state.contact, plastic)
