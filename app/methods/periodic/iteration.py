"""The periodic method's active set iteration on one grid.

The steps are as in Sec. 4.1, with pressure and gap exchanged: the free cells O replace the contact set C, the gap e
replaces p, and the pressure p = B w + mean pressure replaces e. B is the inverse of A on fields without mean, and w is
the displacement minus the approach.
"""

from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from app.contact.active_set import CONVERGED, failure_reason
from app.contact.history import Outcome
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.progress import STAGNATES, TOO_MANY, HalvingTest, NeedsSafeguard

MAX_CHANGED_FRACTION = 0.005  # largest fraction of cells that change on the last contact set of a coarse grid
AIM_FRACTION = 0.5  # aim over allowed error: the preconditioned residual underestimates the error
# Multiples of the aim, the error that the solver tries to reach:
NEGLIGIBLE_OVERLAP = 0.3  # overlap, or displacement by tension, up to which a cell keeps its state
MAX_MULTILEVEL_ERROR = 0.5  # largest error of p by multilevel products when p is verified
MAX_GAP_CHANGE = 10.0  # change of the gap of a cell above which the contact set is not final
MIN_RELATIVE_AIM = 1e-15  # smallest aim over the largest displacement
# After a failed verification:
MAX_ERROR_RATIO = 100.0  # true error over residual beyond which p has drifted and is recomputed
FAILED_AIM_FRACTION = 0.6  # of the residual that the verification requires is aimed at
NO_PRESSURE_AIM_FRACTION = 0.1  # reduction of the aim if the load is less than the pressure left free
MIN_DEVIATION = 1e-12  # of the root mean square height: smaller deviations are rounding
MIN_SHAPE_SHARE = 1e-4  # of a displacement: smallest deviation of a surface with holes that matters
REST_NEGLIGIBLE = "residual small enough, and so is what the contact area still changes by"
NO_PRESSURE = "the load is less than rounding leaves of the pressure"


def primal_active_set(primal, solver, stop, history):
    """Solve the contact problem (2.8)-(2.10) on one grid.

    Collective over the ranks of the PrimalState `primal`, which has the initial displacement and pressure. `solver` is
    a PrimalSolver; the other parameters and the result are as in `active_set`. On the target grid ``primal.solution``
    is the solution. Raises `NeedsSafeguard` if there is no progress.
    """
    progress, fewest_changed = HalvingTest(), float("inf")
    solver.begin(primal, stop.settings.defect_correction)
    primal.start(solver)
    accuracy = _Accuracy(allowed_gap(primal, stop))
    history.start(primal, solver)
    primal.guess(solver, exact=stop.final)
    for k in range(1, stop.max_it + 1):
        goal, overlap = accuracy.aim * np.sqrt(primal.cells), NEGLIGIBLE_OVERLAP * accuracy.aim
        its, failure, norm = solver.improve(primal, goal)
        accurate = norm <= goal
        # The error of multilevel products must be small. After a failed verification p has to be by FFT.
        max_uncertainty = 0 if accuracy.verification_failed else MAX_MULTILEVEL_ERROR * goal
        p_is_trusted = not primal.pending or solver.uncertainty <= max_uncertainty
        tension, far = overlap * solver.preconditioner.stiffness, MAX_GAP_CHANGE * accuracy.aim
        update = primal.exchange(solver, tension, -overlap, far, norm)
        with primal.shown(solver) if history.listeners else nullcontext():
            history.add(primal, solver, update, its)
        residual = norm / primal.h_norm  # not of the stopping test: about the error of w
        if wrong := failure_reason(failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if accurate and not stop.final and update.changed <= MAX_CHANGED_FRACTION * primal.cells:
            primal.finish(solver)
            return Outcome(True, CONVERGED, k, residual)
        # No cell changes, or the changes and the residual are negligible.
        set_is_final = accurate and not update.changed
        negligible = stop.final and not accuracy.verification_failed and np.hypot(norm, update.moves) <= goal
        if (set_is_final or negligible) and p_is_trusted:
            primal.commit(solver)
            verdict = _judge(primal, solver.scratch, stop, accuracy.allowed)
            if np.isfinite(verdict.residual):
                residual = verdict.residual / primal.h_norm
            if verdict.solved:
                return Outcome(True, REST_NEGLIGIBLE if update.changed else CONVERGED, k, residual)
            aim = accuracy.aim
            _continue(verdict, primal, solver, accuracy, norm / np.sqrt(primal.cells), update.added > 0)
            if accuracy.aim <= 0.5 * aim:
                progress = HalvingTest()
            if accuracy.exhausted:
                raise NeedsSafeguard(Outcome(False, NO_PRESSURE, k, residual))
        elif update.added or norm <= solver.uncertainty or (accurate and not p_is_trusted):
            primal.close_captured_gaps(solver)  # p by a product
        progress.update(norm or progress.best, otherwise=not norm or update.changed < fewest_changed)
        fewest_changed = min(update.changed, fewest_changed)
        if progress.stagnates:
            if stop.final and norm <= ROUNDING_RESIDUAL * primal.largest() * np.sqrt(primal.cells):
                residual = _finish_unsolved(primal, solver)
                if stop.certified(primal.solution):
                    return Outcome(False, BELOW_ROUNDING, k, residual)
            raise NeedsSafeguard(Outcome(False, STAGNATES, k, residual))
    if stop.final:
        residual = _finish_unsolved(primal, solver)
    else:
        primal.finish(solver)
    return Outcome(False, TOO_MANY.format(stop.max_it), stop.max_it, residual)


def _finish_unsolved(primal, solver):
    """Set a valid pressure and displacement after a failed solve. Collective.

    Without pressure in contact, the load is spread evenly over the contact set. Return the relative residual of (5.1).
    """
    primal.commit(solver)
    state, update = verify(primal, solver.scratch)
    if state is None:
        primal.spread_load()
        state, update = verify(primal, solver.scratch)
    primal.solution = state
    return update.residual / state.h_norm


class _Accuracy:
    """Accuracy of the displacement that the solver aims at.

    Attributes
    ----------
    allowed : float
        Root mean square gap on contact that a verification allows [mm].
    aim : float
        Error that the solver tries to reach, by its preconditioned residual [mm].
    verification_failed : bool
        True after a failed verification. Then p is recomputed before the next one.
    exhausted : bool
        True if a verification has failed at the smallest possible aim.
    """

    def __init__(self, allowed):
        self.allowed, self.aim = allowed, AIM_FRACTION * allowed
        self.verification_failed = self.exhausted = False

    def lower(self, reached, error, lowest):
        """Lower the error that the solver aims at.

        `reached` is the error estimated by the preconditioned residual, `error` the error found by the verification
        (NaN without pressure), and `lowest` the rounding error [mm].
        """
        no_pressure = np.isnan(error)
        self.exhausted = no_pressure and self.aim <= lowest
        share = NO_PRESSURE_AIM_FRACTION if no_pressure else 0.5
        if error > 0:
            share = min(share, FAILED_AIM_FRACTION * self.allowed / error)
        self.aim = max(share * min(self.aim, reached), lowest)


class _Verdict(NamedTuple):
    """Result of the verification of a pressure."""

    residual: float  # norm over the contact set [mm]; NaN: no pressure under the load
    error: float  # root mean square of the gap on contact [mm], or NaN
    passed: bool  # the error is small enough
    solved: bool  # the error is small enough, and the certificate agrees


def _judge(primal, spare, stop, allowed):
    """Verify the pressure, and return whether it solves the problem.

    Collective. This is step 6 of Sec. 4.1. The pressure passes (5.1) if the root mean square gap on contact is at most
    `allowed` [mm]. It solves the problem if the certificate, a bound of its error, is also small enough. A pressure
    that does not pass is left as it was. `spare` is the solver's scratch field: the solver must not hold an unapplied
    change in it.
    """
    state, update = verify(primal, spare)
    if state is None:
        return _Verdict(np.nan, np.nan, False, False)
    error = update.residual / np.sqrt(max(update.cells, 1))
    if passed := error <= allowed:
        primal.solution = state
    else:
        state.destroy()
        primal.values[...] = spare
    return _Verdict(update.residual, error, passed, passed and stop.certified(state, spare))


def _continue(verdict, primal, solver, accuracy, reached, captured):
    """Make the solver more accurate after a failed verification.

    Collective. p is recomputed, the error at which the solver stops is lowered, or both. `reached` is the error [mm]
    estimated by the solver's residual; `captured` is true if the last exchange added cells to contact.
    """
    primal.restore_contact()
    drifted = verdict.error > MAX_ERROR_RATIO * reached
    if captured:
        primal.touch_captured()
    # Also the second time, or for the certificate: the updated p may have become inaccurate.
    if captured or verdict.passed or accuracy.verification_failed or primal.approximate or drifted:
        primal.restore_mean(solver)
        primal.refresh(exact=True)
    if accuracy.verification_failed or not drifted:
        accuracy.lower(reached, verdict.error, MIN_RELATIVE_AIM * primal.largest())
    accuracy.verification_failed = True


def allowed_gap(primal, stop):
    """Return the largest rms gap on contact that is accepted [mm]. Collective.

    The limit is rtol times a length. In (5.1) this length is the root mean square of h, which depends on the load.
    Instead this function uses these lengths:

    - *In general*, the length is the standard deviation of the shape, which does not depend on the load.
    - *On a coarse grid*, the length is the approach beyond first touch if that is smaller, because a small contact on a
      large patch needs a smaller error.
    - *On flat surfaces with holes*, the length is the depth, or the displacement of a cell by the mean pressure if that
      is larger.
    """
    distance = primal.distance
    rtol = stop.rtol if stop.final else max(stop.settings.coarse_rtol, ROUNDING_RESIDUAL)
    flat, displaced = MIN_DEVIATION * primal.h_norm / np.sqrt(primal.cells), 0.0
    if distance.deviation <= flat or distance.statistics.cells < primal.cells:
        displaced = max(abs(primal.depth), primal.loading.least_displacement(primal.operator))
    if distance.deviation <= max(flat, MIN_DEVIATION * displaced):
        return rtol * displaced
    beyond = primal.depth - primal.first_touch() if not stop.final else 0.0
    shape = min(beyond, distance.deviation) if beyond > 0 else distance.deviation
    return rtol * max(shape, MIN_SHAPE_SHARE * displaced)


def verify(primal, before):
    """Verify the pressure by one exact product.

    Collective. p is made valid: without tension, and with the prescribed load. `before` receives p as it was. Return
    the ContactState with this p, overlapping cells in its contact set, and the Update. If a load is prescribed, but the
    pressure in contact is smaller than the error on the free cells, return None twice, and leave p as it was.
    """
    if not primal.meet_load(primal.project(before)):
        primal.values[...] = before
        return None, None
    state = primal.hand_out()
    return state, state.activate_penetrating()
