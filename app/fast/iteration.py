"""The active set iteration of the default method: contact sets solved a little, u = A p carried along.

The same steps as `app.contact.iteration.active_set`, with six differences:

- *Inexact sets.* Each system is solved until its residual is smaller by the forcing term (``-ksp_rtol``) only.
- *Carried displacement.* u follows p by its changes, which are multiplied by levels (`app.fast.levels`), nearly by A.
- *Defect correction.* Where the residual has become so small that this counts, u is computed anew, by a product.
- *Predictor.* Far from the solution cells enter C by the displacement to be expected when the residual is gone.
- *Verification.* Nothing counts as solved before a product in double precision has said so. Where that is dear it is
  rehearsed: the same steps by the carried displacement, which costs nothing, must pass first.
- *Coarse grids are left early*: when the residual is small enough for one, next to no pressure is negative and a load
  is nearly met, though the contact set may still change.

Where it makes no progress it gives up (`NeedsSafeguard`), and `app.fast.safeguard` takes over.
"""

from __future__ import annotations

import numpy as np

from app.contact.history import Outcome
from app.contact.iteration import CONVERGED, NO_CONTACT, begin, what_is_wrong
from app.contact.state import Displacement
from app.fast.progress import NeedsSafeguard, Progress

RELEASED = 0.01  # share of the load that may be released on a coarse grid without asking what that does to u
NEAR = 3.0  # times its tolerance may the approach to a load still be off on a coarse grid
SINGLE = 1e-6  # of ||h|| on C: a smaller residual is not for single precision to compute
FALLEN = 0.01  # of the largest load since u was computed: below, rounding of that is too much in u


def inexact_active_set(state, solver, loading, stop, history):
    """Solve (2.8)-(2.10) on one grid from the contact set and pressure in `state`.

    Collective over the ranks of `state`. Parameters and result as of `active_set`; the solver is a TrackingSolver.

    Raises
    ------
    NeedsSafeguard
        If the residual stagnates, or the linear solver fails.
    """
    if not begin(state, solver, loading, history):
        return Outcome(not loading.prescribes_load, NO_CONTACT)
    sets = _ContactSets(state, solver, loading, stop)
    for k in range(1, stop.max_it + 1):
        its, failure = sets.solve()  # 2. and 3. (2.11) on C^k, a little
        update, done = sets.exchange()  # 4. p < 0 leaves C, e < 0 enters; 5. and 6. on the last one
        history.add(state, solver, update, its)
        residual = update.residual / state.distance.norm()
        if wrong := what_is_wrong(failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if done and sets.stop.certified(state):
            return Outcome(True, CONVERGED, k, residual)
        sets.learn_from(update, too_loose=done)
        if sets.progress.iterations.stalls:
            raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, residual))
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


class _ContactSets:
    """The contact sets of one grid, and what each tells the next. All methods are collective.

    Attributes
    ----------
    stop : InexactStop
        Becomes tighter where the certificate says that (5.1) was too loose.
    progress : Progress
    """

    def __init__(self, state, solver, loading, stop):
        self.state, self.solver, self.loading, self.stop = state, solver, loading, stop
        solver.begin(by_levels=stop.defect_correction > 0)
        gaps = state.on_contact()  # of C^k; later the last update knows
        self._h_on_contact, self._norm, self._cells = gaps.h, gaps.residual, max(gaps.cells, 1)
        self.progress = Progress(self._norm)
        self._rehearsal_failed = False  # the last verification was one, and did not pass
        self._load = self._heaviest = 0.0

    def solve(self):
        """Steps 2 and 3, until the residual is small enough, or levels tell no more; return iterations and failure."""
        stop, by_product = self.stop, self.progress.by_product
        self._allowed = self._goal = stop.allowed(self.state, self._h_on_contact)
        self._levels_may_leave = max(self._allowed, 0.5 * by_product)
        self._by_levels = self.solver.by_levels
        if (
            stop.final and self._by_levels
        ):  # on coarse grids what levels leave is no worse than the grid itself
            self._goal = max(self._allowed, stop.defect_correction * by_product)
        self.solver.set_contact()
        its, failure, self._norm = self.solver.improve(self.state, self._goal, self._norm)
        return its, failure

    def exchange(self):
        """Step 4, in one of three ways; return the Update, and whether the grid is done but for the certificate."""
        state, solver, stop = self.state, self.solver, self.stop
        self._computed = self._too_loose = False
        self._fallen = self._load < FALLEN * self._heaviest
        tension = solver.tension(state) if self._norm <= self._allowed else None
        # The system is solved, and on the target grid next to no pressure is negative: is it the last contact set?
        ready = tension is not None and (not stop.final or tension.share <= stop.rtol)
        if ready and stop.says_little(state, self._h_on_contact):
            solver.carry(state)
            self._too_loose = not stop.certified(state)
        if ready and stop.final and not self._too_loose:
            return self._verify(tension)
        if ready and not (stop.final or self._fallen):
            return self._leave_coarse(tension)
        return self._go_on(), False

    def learn_from(self, update, too_loose):
        """Hear what came of the set; `too_loose`: all but the certificate was content. Not collective."""
        if self._computed and self._by_levels:
            self.progress.after_product(update.residual)
            self.solver.by_levels &= not self.progress.products.stalls
        self.progress.iterations.after(update.residual)
        self._load = update.load
        self._heaviest = update.load if self._computed else max(update.load, self._heaviest)
        self._h_on_contact, self._cells, self._norm = (
            update.h_on_contact,
            max(update.cells, 1),
            update.residual,
        )
        if too_loose or self._too_loose:
            self.stop = self.stop.tighter(0.1)

    def _go_on(self):
        """Step 4 before the last set: u computed anew where levels tell no more, else carried along."""
        state, solver = self.state, self.solver
        levels_tell_no_more = self._allowed < self._goal and self._norm <= self._goal
        self._computed = levels_tell_no_more or self._fallen
        released = solver.release(state, carry=not self._computed)  # (4.a), and u along with it
        if self._computed:
            state.compute_displacement(exact=self._allowed < SINGLE * self._h_on_contact)
            if not released:
                solver.check_levels(state, self._levels_may_leave)
        self.loading.update(state)
        expected = solver.predict(state, self.stop.predictor) if self._norm > self._allowed else None
        return state.activate_penetrating(expected)  # (4.b)

    def _verify(self, tension):
        """Steps 4 to 6 on the target grid by a product in double precision, the load met exactly.

        Where it pays they are rehearsed by the carried displacement; if that does not pass the product is not made.
        """
        state, solver, loading, rehearsal = self.state, self.solver, self.loading, None
        carried = state.u_is is not Displacement.EXACT and not (self._rehearsal_failed or self._fallen)
        # By approach a release of next to no pressure is not rehearsed. By load it is: the approach may move by it.
        if carried and (loading.prescribes_load or not tension.some):
            solver.release(state, tension)  # (4.a), and u along with it
            loading.update(state)
            rehearsal = state.activate_penetrating()
            allowed = self.stop.allowed(state, rehearsal.h_on_contact)
            self._rehearsal_failed = bool(rehearsal.added) or rehearsal.residual > allowed
            if self._rehearsal_failed:
                return rehearsal, False
        else:
            state.release_tensile(tension.some)  # (4.a)
        self._rehearsal_failed, self._computed = False, True
        solver.rest()
        if state.u_is is not Displacement.EXACT:
            state.compute_displacement(exact=True)
            solver.check_levels(state, self._levels_may_leave)
        loading.update(state)
        update = state.activate_penetrating()  # (4.b)
        if rehearsal is not None:
            update = update.after(rehearsal)
        if self._solved(update):
            update = loading.settle(state, update)
        return update, self._solved(update)

    def _solved(self, update):
        """5. and 6. (5.1). Not collective."""
        return not update.changed and update.residual <= self.stop.allowed(self.state, update.h_on_contact)

    def _leave_coarse(self, tension):
        """Step 4 on a coarse grid whose system is solved well enough.

        What little the last release does to u is for the finer grid to find out, if the load is nearly met.
        """
        state, solver, loading = self.state, self.solver, self.loading
        little = tension.share <= RELEASED
        if little:
            solver.carry(state)
        enough = little and loading.update(state) <= NEAR * self._allowed / np.sqrt(self._cells)
        if enough:
            state.release_tensile(tension.some)  # (4.a)
        else:
            solver.release(state, tension)  # (4.a), and u along with it
            if not little:  # else the approach has moved by this pressure already
                loading.update(state)
        return state.activate_penetrating(), enough  # (4.b)
