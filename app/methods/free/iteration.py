"""The default method's active set iteration on one grid.

The steps are as in `app.contact.active_set.active_set`, with six differences:

- *Inexact solves.* Each system is solved until its residual has fallen by the forcing term, a factor (``-ksp_rtol``).
- *Updated displacement.* u is updated by A times the changes of p, by multilevel products
  (`app.methods.multilevel_operators`), which are nearly A.
- *Defect correction.* u is recomputed by FFT when the residual reaches the error of the multilevel products.
- *Predictor.* Far from the solution, and with plastic cells, cells enter C by the displacement that is predicted for
  a zero residual.
- *Verification.* The target grid is accepted by a product in double precision. That product is
  expensive, so a rehearsal comes first: the same steps and test with the updated displacement.
- *Coarse grids* are left early: when the residual is small, almost no pressure is negative, and a load is nearly met.
  The contact set may still change then.

If there is no progress, or no small residual satisfies the certificate, the iteration raises `NeedsSafeguard`, and
`app.methods.safeguard` continues.
"""

from typing import NamedTuple

import numpy as np

from app.contact.active_set import CONVERGED, NO_CONTACT, failure_reason, start_grid
from app.contact.history import Outcome
from app.contact.state import Displacement
from app.contact.updates import Update
from app.methods.progress import STAGNATES, TOO_MANY, HalvingTest, NeedsSafeguard
from app.methods.stopping import UNPROVED

MAX_RELEASED_SHARE = 0.01  # largest share of the load that a coarse grid releases without updating u
MAX_COARSE_LOAD_MISS = 3.0  # largest error of the approach to a load on a coarse grid, in its tolerance
MIN_SINGLE_RESIDUAL = 1e-6  # smaller residuals over ||h|| on C are noise in single precision
MIN_LOAD_FRACTION = 0.01  # of the largest load since u was computed: less is lost in its rounding


def inexact_active_set(state, solver, loading, stop, history):
    """Solve the contact problem (2.8)-(2.10) on one grid.

    Collective over the ranks of `state`, which has the initial contact set and pressure. Parameters and result are as
    in `active_set`; the solver is a TrackingSolver.

    Raises
    ------
    NeedsSafeguard
        If the residual stagnates, or the linear solver fails.
    """
    if not start_grid(state, solver, loading, history):
        return Outcome(loading.allows_no_contact, NO_CONTACT)
    sets = _ContactSets(state, solver, loading, stop)
    for k in range(1, stop.max_it + 1):
        solved = sets.solve()
        exchanged = sets.exchange(solved)
        history.add(state, solver, exchanged.update, solved.iterations)
        residual = exchanged.update.residual / state.h_norm
        if wrong := failure_reason(solved.failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if exchanged.done and sets.stop.certified(state):
            return Outcome(True, CONVERGED, k, residual)
        sets.record(solved, exchanged)
        if sets.progress.stagnates:
            raise NeedsSafeguard(Outcome(False, STAGNATES, k, residual))
        if (exchanged.done or exchanged.too_loose) and sets.stop.at_rounding:
            raise NeedsSafeguard(Outcome(False, UNPROVED, k, residual))
    return Outcome(False, TOO_MANY.format(stop.max_it), stop.max_it, residual)


class _Solved(NamedTuple):
    """Result of the linear solver for a contact set."""

    iterations: int
    failure: str
    norm: float  # of the residual, by the solver's own products [mm]
    allowed: float  # norm of the residual at which the set counts as solved [mm]
    goal: (
        float  # norm at which the solver stops; larger than `allowed` if a product by FFT has to follow [mm]
    )
    multilevel: bool  # products were multilevel ones


class _Exchanged(NamedTuple):
    """Result of an update of the contact set."""

    update: Update
    done: bool = False  # solved, if the certificate agrees
    computed: bool = False  # u was recomputed by FFT
    too_loose: bool = False  # the certificate failed before a verification product


class _ContactSets:
    """Iteration over the contact sets of one grid. Collective.

    Attributes
    ----------
    stop : InexactStop
        Stopping test. It becomes stricter if the certificate shows that (5.1) was not strict enough.
    progress : HalvingTest
        Test that the residual falls.
    """

    def __init__(self, state, solver, loading, stop):
        self.state, self.solver, self.loading, self.stop = state, solver, loading, stop
        solver.begin(multilevel=stop.settings.defect_correction > 0)
        gaps = state.on_contact(with_h=True)  # later of the last update
        self._h_on_contact, self._norm, self._cells = gaps.h, gaps.residual, max(gaps.cells, 1)
        self._computed_norm = gaps.residual  # by the last product by FFT [mm]
        self.progress, self._computed_progress = HalvingTest(), HalvingTest(gaps.residual)
        self._rehearsal_failed = False
        self._largest_load, self._load_has_fallen = 0.0, False

    def _max_multilevel_error(self, allowed):
        """Return the largest allowed error of multilevel products [mm].

        If the residual, once recomputed by FFT, exceeds this number, multilevel products are no longer used.
        """
        return max(allowed, 0.5 * self._computed_norm)

    def solve(self):
        """Solve the contact set's system (2.11) inexactly.

        These are steps 2 and 3 of Sec. 4.1.
        """
        stop, multilevel = self.stop, self.solver.multilevel
        goal = allowed = stop.allowed(self.state, self._h_on_contact)
        if stop.final and multilevel:  # on coarse grids this error is below that of the grid
            goal = max(allowed, stop.settings.defect_correction * self._computed_norm)
        self.solver.set_contact()
        return _Solved(*self.solver.improve(self.state, goal, self._norm), allowed, goal, multilevel)

    def exchange(self, solved):
        """Update the contact set, by steps 4 to 6 of Sec. 4.1.

        A contact set is *ready* if its system is solved and, on the target grid, almost no pressure is negative. On the
        target grid a ready contact set is verified. On a coarse grid it is updated once more, and the iteration ends. A
        contact set that is not ready is updated, and the iteration continues.
        """
        state, solver, stop = self.state, self.solver, self.stop
        tension = state.tension() if solved.norm <= solved.allowed else None
        # Solved, and with next to no negative pressure on the target grid: this may be the last contact set.
        ready = tension is not None and (not stop.final or tension <= stop.rtol)
        too_loose = False
        if ready and stop.is_weak(state, self._h_on_contact):
            solver.update_displacement(state)
            too_loose = not stop.certified(state)
        if ready and stop.final and not too_loose:
            return self._verify(solved, tension)
        if ready and not (stop.final or self._load_has_fallen):
            return self._leave_coarse(solved, tension)
        return self._go_on(solved)._replace(too_loose=too_loose)

    def record(self, solved, exchanged):
        """Record residual and load, for later tests of progress."""
        update = exchanged.update
        if exchanged.computed and solved.multilevel:
            self.progress.best = max(
                self._computed_norm, update.residual
            )  # more if cells entered under a load
            self._computed_norm = update.residual
            self._computed_progress.update(update.residual)
            self.solver.multilevel &= not self._computed_progress.stagnates
        self.progress.update(update.residual)
        self._largest_load = update.load if exchanged.computed else max(update.load, self._largest_load)
        self._load_has_fallen = update.load < MIN_LOAD_FRACTION * self._largest_load
        self._h_on_contact, self._norm = update.h_on_contact, update.residual
        self._cells = max(update.cells, 1)
        if exchanged.done or exchanged.too_loose:
            self.stop = self.stop.tighter(0.1)

    def _go_on(self, solved):
        """Update the contact set, after a solve that was not the last.

        The displacement is updated by the last change of p. If the updated displacement is too inaccurate, it is
        recomputed by FFT.
        """
        state, solver, allowed = self.state, self.solver, solved.allowed
        computed = self._load_has_fallen or (allowed < solved.goal and solved.norm <= solved.goal)
        released = solver.release(state, update=not computed)
        if computed:
            state.compute_displacement(exact=allowed < MIN_SINGLE_RESIDUAL * self._h_on_contact)
            if not released:
                solver.check_multilevel(state, self._max_multilevel_error(allowed))
        self.loading.update(state)
        return _Exchanged(self._activate(solved), computed=computed)

    def _activate(self, solved):
        """Add overlapping cells to the contact set, by a predicted displacement.

        The displacement is predicted for a zero residual. If the residual was small enough, there is no prediction,
        except with plastic cells: they have lost pressure, so the residual is large again.
        """
        state = self.state
        small = solved.norm <= solved.allowed and not state.plastic_cells()
        return state.activate_penetrating(
            None if small else self.solver.predict(state, self.stop.settings.predictor)
        )

    def _verify(self, solved, tension):
        """Verify the last contact set by a product in double precision.

        Only the target grid is verified. In most cases a rehearsal comes first: the same steps and the same test, with
        the updated displacement instead of a recomputed one. If the rehearsal fails, the expensive product is not
        computed. An accepted solution has exactly the prescribed load.
        """
        state, solver, loading, rehearsal = self.state, self.solver, self.loading, None
        # By approach a release of next to no pressure needs no rehearsal. By load the approach may move by it.
        exact = state.displacement_status is Displacement.EXACT
        if (
            exact
            or self._rehearsal_failed
            or self._load_has_fallen
            or (loading.approach_is_known and tension)
        ):
            state.release_tensile(tension > 0)
        else:
            solver.release(state, tension)
            loading.update(state)
            rehearsal = state.activate_penetrating()
            allowed = self.stop.allowed(state, rehearsal.h_on_contact)
            if rehearsal.added or rehearsal.residual > allowed:
                self._rehearsal_failed = True
                return _Exchanged(rehearsal)
        self._rehearsal_failed = False
        solver.free_work()
        if state.displacement_status is not Displacement.EXACT:
            loading.meet(state)
            state.compute_displacement(exact=True)
            solver.check_multilevel(state, self._max_multilevel_error(solved.allowed))
        loading.update(state)
        update = state.activate_penetrating()
        if rehearsal is not None:
            update = update.after(rehearsal)
        done = self._passes(update)
        if done:
            update = loading.settle(state, update)
            done = self._passes(update)
        return _Exchanged(update, done, computed=True)

    def _passes(self, update):
        """Return whether the contact set is unchanged and (5.1) holds."""
        return not update.changed and update.residual <= self.stop.allowed(self.state, update.h_on_contact)

    def _leave_coarse(self, solved, tension):
        """Update the contact set of a coarse grid for the last time.

        If the load is nearly met, u is not updated for the cells released now, because the finer grid recomputes u.
        """
        state, solver, loading = self.state, self.solver, self.loading
        if tension > MAX_RELEASED_SHARE:
            solver.release(state, tension)
            loading.update(state)
            return _Exchanged(self._activate(solved))
        solver.update_displacement(state)
        met = loading.update(state) <= MAX_COARSE_LOAD_MISS * solved.allowed / np.sqrt(self._cells)
        if met:
            state.release_tensile(tension > 0)
        else:  # the approach has moved by this pressure already
            solver.release(state, tension)
        return _Exchanged(state.activate_penetrating(), done=met)
