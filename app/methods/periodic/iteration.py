"""The primal active set iteration on one grid.

The steps of Sec. 4.1 with the parts of pressure and gap exchanged: the free cells O take the place of C, the gap that
of p, and p = B w + mean pressure that of e.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from app.contact.active_set import CONVERGED, failure_reason
from app.contact.history import Outcome
from app.contact.state import Displacement
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.progress import HalvingTest, NeedsSafeguard

MAX_CHANGED_FRACTION = 0.005  # share of the cells that may still change on a coarse grid
NEGLIGIBLE_OVERLAP = (
    0.3  # of the error aimed at: overlap, or displacement by tension, below which a cell stays where it is
)
AIM_FRACTION = 0.5  # of the allowed error is aimed at, because the preconditioned residual underestimates it
MAX_MULTILEVEL_ERROR = 0.5  # of the error aimed at: what levels may have left in p when it is verified
MAX_GAP_CHANGE = 10.0  # in errors aimed at: the contact set is not final if the gap of a cell changes by more
MAX_ERROR_RATIO = 100.0  # true error over the residual beyond which p itself has drifted and is computed anew
FAILED_AIM_FRACTION = 0.6  # margin below what the verification asks for, after it has failed
MIN_RELATIVE_AIM = 1e-15  # of the largest displacement: error that can be aimed at
NO_PRESSURE_AIM_FRACTION = (
    0.1  # of what was reached is aimed at where the load is less than what was left on the free cells
)
REST_NEGLIGIBLE = "residual small enough, and so is what the contact area still changes by"
MIN_DEVIATION = 1e-12  # of the root mean square height: deviation that is rounding
MIN_SHAPE_SHARE = 1e-4  # of a displacement: deviation of a surface with holes that it hardly depends on
NO_PRESSURE = "the load is less than rounding leaves of the pressure"


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
    state, progress = primal.state, _Progress()
    solver.begin(state, primal.loading, stop.defect_correction)
    primal.start(solver)
    accuracy = _Accuracy(allowed_gap(primal, stop))
    history.start(state, solver)
    primal.guess(solver, exact=stop.final)
    for k in range(1, stop.max_it + 1):
        goal, slight = accuracy.aim * np.sqrt(primal.cells), NEGLIGIBLE_OVERLAP * accuracy.aim
        its, failure, norm = solver.improve(primal, goal)  # 2. and 3. p = 0 on the free cells, a little
        accurate = norm <= goal
        # Levels have left little enough in p; after a failed verification p has to be by FFT.
        p_is_trusted = not primal.lags or solver.doubt <= (
            0 if accuracy.doubted else MAX_MULTILEVEL_ERROR * goal
        )
        # 4. p < 0 leaves C, e < 0 enters
        update = primal.exchange(
            solver, slight * solver.preconditioner.stiffness, -slight, MAX_GAP_CHANGE * accuracy.aim, norm
        )
        with primal.shown(solver) if history.listeners else nullcontext():
            history.add(state, solver, update, its)
        residual = norm / state.distance.norm()  # not (5.1): about the error of w
        if wrong := failure_reason(failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if accurate and not stop.final and update.changed <= MAX_CHANGED_FRACTION * primal.cells:
            primal.commit(solver)
            return Outcome(True, CONVERGED, k, residual)
        # 5. No cell changes, or those that do are, like the residual, too little to matter.
        set_is_final = accurate and not update.changed
        rest_is_negligible = stop.final and not accuracy.doubted and np.hypot(norm, update.moves) <= goal
        if (set_is_final or rest_is_negligible) and p_is_trusted:
            primal.commit(solver)
            verdict = _judge(primal, solver.scratch, stop, accuracy.allowed)  # 6.
            if np.isfinite(verdict.residual):
                residual = verdict.residual / state.distance.norm()
            if verdict.solved:
                return Outcome(True, REST_NEGLIGIBLE if update.changed else CONVERGED, k, residual)
            aim = accuracy.aim
            _go_on_after(verdict, primal, solver, accuracy, norm / np.sqrt(primal.cells), update.added > 0)
            if accuracy.aim <= 0.5 * aim:
                progress.restart()
            if accuracy.exhausted:
                raise NeedsSafeguard(Outcome(False, NO_PRESSURE, k, residual))
        else:
            levels_tell_no_more = norm <= solver.doubt
            if update.added or levels_tell_no_more or (accurate and not p_is_trusted):
                primal.close_captured_gaps(solver)  # the gaps of captured cells, by a product
        progress.after(norm, update.changed)
        if progress.stalls:
            if not (stop.final and norm <= ROUNDING_RESIDUAL * primal.largest() * np.sqrt(primal.cells)):
                raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, residual))
            residual = _end_unsolved(primal, solver)
            return Outcome(False, BELOW_ROUNDING, k, residual)
    primal.commit(solver)
    if stop.final:
        residual = _end_unsolved(primal, solver)
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


def _end_unsolved(primal, solver):
    """Leave the best there is: a pressure >= 0 with the right load, and u = A p.

    Collective. Returns the residual (5.1). Where there is no pressure the contact set bears the load evenly.
    """
    primal.commit(solver)
    state = primal.state
    state.depth = primal.depth
    found = verify(primal, solver.scratch)
    if found is None:
        state.values[...] = state.contact
        found = verify(primal, solver.scratch)
    accept(primal, solver.scratch)
    return found.residual / state.distance.norm()


class _Accuracy:
    """How small an error the solver is to aim at, by its preconditioned residual, for one that is small enough.

    Parameters
    ----------
    allowed : float
        Root mean square error of the gap that is small enough [mm].

    Attributes
    ----------
    allowed : float
    aim : float
        Error to aim at [mm].
    doubted : bool
        A verification has failed.
    exhausted : bool
        One has, though no smaller error can be aimed at.
    """

    def __init__(self, allowed):
        self.allowed, self.aim = allowed, AIM_FRACTION * allowed
        self.doubted = self.exhausted = False

    def keep(self):
        """Aim at the same: not the residual was too small, but p off. From now on a product precedes a verification."""
        self.doubted = True

    def lower(self, reached, error, lowest):
        """Aim lower, by as much as a verification says that the residual was too small.

        Parameters
        ----------
        reached : float
            Error by the residual [mm].
        error : float
            By the verification [mm]; NaN: it found no pressure.
        lowest : float
            What rounding leaves [mm].
        """
        no_pressure = np.isnan(error)
        self.exhausted = no_pressure and self.aim <= lowest
        share = NO_PRESSURE_AIM_FRACTION if no_pressure else 0.5
        if error > 0:
            share = min(share, FAILED_AIM_FRACTION * self.allowed / error)
        self.aim = max(share * min(self.aim, reached), lowest)
        self.doubted = True


class _Progress:
    """Whether the residual is halved, or fewer cells change, from time to time. Not collective."""

    def __init__(self):
        self._residual, self._fewest = HalvingTest(), float("inf")

    def restart(self):
        """Begin anew, where a smaller error is aimed at. Not collective."""
        self._residual = HalvingTest()

    def after(self, norm, changed):
        """Hear of an iteration: the residual [mm], 0 if nothing is free, and the cells that changed."""
        self._residual.after(norm or self._residual.best, otherwise=not norm or changed < self._fewest)
        self._fewest = min(changed, self._fewest)

    @property
    def stalls(self):
        """Whether there is none."""
        return self._residual.stalls


class _Verdict(NamedTuple):
    """On pressure and contact set, by a product in double precision."""

    residual: float  # of (5.1) [mm]; NaN: there is no pressure under the load, yet
    error: float  # root mean square of the gap on contact [mm], or NaN
    passed: bool  # the error is small enough
    solved: bool  # and the certificate agrees


def _judge(primal, found, stop, allowed):
    """Step 6: `verify`, and if the error is `allowed` [mm], `accept` and certify. Collective.

    Nothing may lag: `found` is room that the solver and, once it is accepted, the certificate use for other things.
    """
    update = verify(primal, found)
    if update is None:
        return _Verdict(np.nan, np.nan, False, False)
    error = update.residual / np.sqrt(max(update.cells, 1))
    passed = error <= allowed
    if passed:
        accept(primal, found)
    return _Verdict(update.residual, error, passed, passed and stop.certified(primal.state, found))


def _go_on_after(verdict, primal, solver, accuracy, reached, captured):
    """Go on with the free cells as before: p is made anew where it may be wrong, and not the residual; else aim lower.

    Collective. `reached`: error by the solver's residual [mm]; `captured`: whether cells have just been.
    """
    primal.restore_contact()
    off = verdict.error > MAX_ERROR_RATIO * reached
    if captured:
        primal.touch_captured()
    # The second time, or for the certificate, too: what is carried along may have become inaccurate.
    if captured or verdict.passed or accuracy.doubted or primal.is_nearly or off:
        primal.restore_mean(solver)
        primal.refresh(exact=True)
    if off and not accuracy.doubted:
        accuracy.keep()
    else:
        accuracy.lower(reached, verdict.error, MIN_RELATIVE_AIM * primal.largest())


def allowed_gap(primal, stop):
    """Root mean square error of the gap that is small enough [mm]. Collective.

    As (5.1), with the deviation of the shape from its mean in place of ||h||, which does not depend on the load; for
    flat surfaces with holes the depth, or as much as the mean pressure displaces a cell, if that is more; a share of
    that where they are hardly uneven. On a coarse grid the approach beyond first touch, if that is less: what is left
    of a contact that is small in its patch is large there.
    """
    distance, rtol = (
        primal.state.distance,
        stop.rtol if stop.final else max(stop.coarse_rtol, ROUNDING_RESIDUAL),
    )
    flat, displaced = MIN_DEVIATION * distance.norm() / np.sqrt(primal.cells), 0.0
    if distance.deviation <= flat or distance.statistics.cells < primal.cells:
        displaced = abs(primal.depth)
        displaced = max(displaced, primal.loading.least_displacement(primal.state.operator))
    if distance.deviation <= max(flat, MIN_DEVIATION * displaced):
        return rtol * displaced
    beyond = primal.depth - primal.state.first_touch() if not stop.final else 0.0
    shape = min(beyond, distance.deviation) if beyond > 0 else distance.deviation
    return rtol * max(shape, MIN_SHAPE_SHARE * displaced)


def verify(primal, found):
    """Step 4 for a pressure >= 0 with the right load, whose u = A p is made by one product in double precision.

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
    total = float(state.sum([state.bounds.project(state.p, state.contact, found)])[0])
    if not loading.scale_pressure(found, total, state.grid.cell_area):
        return None
    state.operator.exact_displacement(found, state.u)
    loading.set_depth(state)
    return state.activate_penetrating()


def accept(primal, found):
    """Take the pressure that `verify` has found. Not collective."""
    primal.state.values[...] = found
    primal.state.displacement_status = Displacement.EXACT
