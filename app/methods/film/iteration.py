"""The active set iteration on one grid, with a prescribed load as constraint."""

from functools import partial
from math import sqrt

from app.contact.active_set import CONVERGED, NO_CONTACT, failure_reason, start_grid
from app.contact.history import Outcome
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.film.cg import ConstrainedCG
from app.methods.progress import HalvingTest
from app.methods.safeguard import solve_safeguarded
from app.methods.stopping import UNPROVED

MAX_CHANGED_FRACTION = 0.005  # largest fraction of C that changes on the last contact set of a coarse grid
MAX_LOAD_RATIO = 2.0  # largest factor by which p is scaled to the load; otherwise CG adds the missing load


def interpolate_pressure(transfer, coarse, state):
    """Set pressure and contact set from the coarser grid; the pressure is interpolated. Collective."""
    p, bounds = state.values, state.bounds
    transfer.interpolate(coarse.p, p)
    state.contact[...] = state.admissible
    bounds.project(p, state.contact, p)
    state.contact[...] = state.admissible & bounds.between(p)
    return True


def solve_film(hierarchy, number, state, solver, loading, stop, history, first=False):
    """Solve on one grid; if this fails, by the safeguard. Collective.

    Parameters and result are as in `active_set`; `number` is the number of the level in the hierarchy. If `first` is
    true, this is the first grid. A prescribed load then starts from contact of all cells below the mean height.
    """
    solve = partial(constrained_active_set, state, solver, stop=stop, history=history)
    if first and loading.approach_is_known:
        outcome = loading.first_solve(state, solve)
    else:
        if first:
            state.depth = state.distance.statistics.mean
            state.start_from_interpenetration()
        outcome = solve(loading)
    if outcome.converged or outcome.to_rounding or outcome.reason == NO_CONTACT:
        return outcome
    return solve_safeguarded(hierarchy, number, state, loading, stop, history).after(outcome)


def constrained_active_set(state, solver, loading, stop, history):
    """Solve the contact problem (2.8)-(2.10) on one grid.

    Collective. Parameters and result are as in `active_set`. With a KSP other than ConstrainedCG, the loading changes
    the approach.
    """
    if not start_grid(state, solver, loading, history):
        return Outcome(loading.allows_no_contact, NO_CONTACT)
    progress, fewest = HalvingTest(), float("inf")
    for k in range(1, stop.max_it + 1):
        constrain = bool(_constrained_cg(solver)) and not loading.approach_is_known
        constrain = constrain and state.cells_in_contact() > 0
        if not constrain:  # with the constraint A is regular in full contact, too
            state.before_iteration(k)
        solver.set_contact()  # makes a new KSP after an interrupt
        if cg := _constrained_cg(solver):
            cg.total = _missing_sum(state, loading) if constrain else None
        correction, its, failure = solver.solve(state.defect(), stop.allowed(state))
        state.add(correction)
        if constrain:
            state.depth -= cg.shift
        state.release_tensile()
        state.compute_displacement()
        if not constrain:
            loading.update(state)
        update = state.activate_penetrating()
        history.add(state, solver, update, its)
        residual = update.residual / state.distance.norm()
        if reason := failure_reason(failure, residual):
            return Outcome(False, reason, k, residual)
        few = 0 if stop.final else MAX_CHANGED_FRACTION * update.cells
        if update.changed <= few and update.residual <= stop.allowed(state, update.h_on_contact):
            update = loading.settle(state, update) if stop.final else update
            if update.changed <= few and update.residual <= stop.allowed(state, update.h_on_contact):
                if stop.certified(state):
                    return Outcome(True, CONVERGED, k, residual)
                stop, progress = stop.tighter(0.1), HalvingTest()
                if stop.at_rounding:
                    return Outcome(False, UNPROVED, k, residual)
        progress.update(update.residual, otherwise=update.changed < fewest)
        fewest = min(fewest, update.changed)
        if progress.stagnates:
            # If the cells in contact are flat, the displacement by the mean pressure replaces h.
            flat = sqrt(update.cells) * state.operator.diagonal * state.load / state.grid.area
            size = max(update.h_on_contact, flat)
            if not update.changed and update.residual <= ROUNDING_RESIDUAL * size:
                loading.settle(state, update)
                return Outcome(False, BELOW_ROUNDING, k, residual, to_rounding=True)
            return Outcome(False, "the residual stagnates", k, residual)
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


def _constrained_cg(solver):
    """Return the context of the solver's KSP if it is a ConstrainedCG, else None."""
    cg = solver.ksp.getPythonContext() if solver.ksp.getType() == "python" else None
    return cg if isinstance(cg, ConstrainedCG) else None


def _missing_sum(state, loading):
    """Scale p to the load if they differ little; return the sum of p that is then missing. Collective."""
    present = state.load
    ratio = loading.load / present if present > 0 else float("inf")
    if 1 / MAX_LOAD_RATIO <= ratio <= MAX_LOAD_RATIO and not state.plastic_cells():
        state.scale(ratio)
        return 0.0
    return (loading.load - present) / state.grid.cell_area
