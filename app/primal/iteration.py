"""The primal active set iteration on one grid.

The steps of Sec. 4.1 with the parts of pressure and gap exchanged: the free cells O take the place of C, the gap that
of p, and p = B w + mean pressure that of e.
"""

from __future__ import annotations

import numpy as np

from app.contact.history import Outcome
from app.contact.iteration import CONVERGED, what_is_wrong
from app.contact.state import Displacement
from app.fast.iteration import ROUNDING
from app.fast.progress import PATIENCE, NeedsSafeguard
from app.primal import kernels

_LOOSE = 0.005  # share of the cells that may still change on a coarse grid
_SLIGHT = 0.3  # of the error aimed at: so much overlap, or what tension displaces a cell by, is left alone
_SURE = 0.5  # of the residual allowed is asked of the preconditioned one, which may be too small
_DOUBT = 0.6  # of what a verification asks for is aimed at after it
_LOWER = 0.1  # of what was reached is aimed at where the load is less than what was left on the free cells
_FLAT = 1e-12  # of the root mean square height: deviation that is rounding
_NO_PRESSURE = "the load is less than rounding leaves of the pressure"


def primal_active_set(primal, solver, stop, history):
    """Solve (2.8)-(2.10) on one grid from w and p.

    Collective over the ranks of the state.

    Parameters
    ----------
    primal : PrimalState
    solver : PrimalSolver
    stop : InexactStop
    history : History

    Returns
    -------
    Outcome

    Raises
    ------
    NeedsSafeguard
        If it makes no progress.
    """
    state, best, fewest, since = primal.state, float("inf"), float("inf"), 0
    aim = _SURE  # share of the residual allowed that is asked of the solver
    doubted = False  # whether a verification has failed
    solver.begin(primal.loading)
    primal.start(exact=stop.final)
    allowed = allowed_gap(primal, stop)
    history.start(state, solver)
    primal.guess(solver)
    for k in range(1, stop.max_it + 1):
        goal = aim * allowed * np.sqrt(primal.cells)
        its, failure, norm = solver.improve(primal, goal)  # 2. and 3. p = 0 on the free cells, a little
        near, slight = norm <= goal * (1 + 1e-6), _SLIGHT * aim * allowed
        # 4. p < 0 leaves C, e < 0 enters
        update = primal.exchange(solver, -slight / solver.preconditioner.weights[0], -slight, norm)
        history.add(state, solver, update, its)
        residual = norm / state.distance.norm()
        if wrong := what_is_wrong(failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if near and not stop.final and update.changed <= _LOOSE * primal.cells:
            return Outcome(True, CONVERGED, k, residual)
        if near and not update.changed:  # 5. and 6. by a product in double precision
            kept = state.contact.copy()
            verified = verify(primal, solver.scratch)
            error, share = float("inf"), _LOWER
            if verified is not None:
                residual = verified.residual / state.distance.norm()
                error = verified.residual / np.sqrt(max(verified.cells, 1))
                share = min(0.5, _DOUBT * allowed / error) if error > 0 else 0.5
            if error <= allowed:
                accept(primal, solver.scratch)
                if stop.certified(state):
                    return Outcome(True, CONVERGED, k, residual)
            # Not yet: aim lower, by as much as the product says that the carried residual was too small.
            reached, lowest = min(1.0, norm / goal) * aim, ROUNDING / stop.rtol
            if verified is None and aim <= lowest:
                raise NeedsSafeguard(Outcome(False, _NO_PRESSURE, k, residual))
            aim = max(share * reached, lowest)
            state.contact[...] = kept  # the free cells are as before
            state.depth = 0.0
            # The second time, or for the certificate: what is carried along may have become inaccurate.
            if error <= allowed or doubted:
                primal.restore_mean(solver)
                primal.refresh(exact=True)
            doubted = True
        elif update.added:
            primal.close(solver)
        since += 1
        if not norm or norm < 0.5 * best or update.changed < fewest:
            best = min(norm or best, best)  # 0: nothing is free
            fewest, since = min(update.changed, fewest), 0
        if since >= PATIENCE:
            raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, residual))
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


def allowed_gap(primal, stop):
    """Root mean square error of the gap that is small enough [mm]. Collective.

    As (5.1), with the deviation of the shape from its mean in place of ||h||, which does not depend on the load; for
    flat surfaces with holes the depth, or as much as the mean pressure displaces a cell, if that is more. On a coarse
    grid the approach beyond first touch, if that is less: what is left of a contact that is small in its patch is large
    there.
    """
    distance, rtol = primal.state.distance, stop.rtol if stop.final else stop.coarse_rtol
    if distance.deviation > _FLAT * distance.norm() / np.sqrt(primal.cells):
        beyond = primal.approach - distance.reference - primal.state.first_touch() if not stop.final else 0.0
        return rtol * (min(beyond, distance.deviation) if beyond > 0 else distance.deviation)
    if primal.loading.prescribes_load:
        of_cell = primal.mean_pressure * primal.state.operator.diagonal
        return rtol * max(of_cell, abs(primal.approach - distance.reference))
    return rtol * abs(primal.mean_displacement)


def verify(primal, found):
    """Step 4 on the target grid: pressure >= 0 with the right load, and u = A p by one product in double precision.

    Collective. Leaves the state at the depth found, and what overlaps in its contact set.

    Parameters
    ----------
    primal : PrimalState
    found : ndarray, shape (local rows, nx)
        Becomes that pressure, for `accept`.

    Returns
    -------
    Update, or None
        If there is no pressure under a load, yet: what is left on the free cells is more.
    """
    state, loading = primal.state, primal.loading
    total = float(state.sum([kernels.positive(state.p, state.contact, found)])[0])
    if loading.prescribes_load:
        if not total > 0:
            return None
        found *= loading.load / (state.grid.cell_area * total)
    state.operator.exact_displacement(found, state.u)
    if loading.prescribes_load:
        state.depth = 0.0
        state.depth = state.mean_in_contact()
    else:
        state.approach = loading.approach
    return state.activate_penetrating()


def accept(primal, found):
    """Take the pressure that `verify` has found. Not collective."""
    with primal.state.pressure as values:
        values[...] = found.reshape(-1)
    primal.state.u_is = Displacement.EXACT
