"""The active set iteration of the default method: contact sets solved a little, u = A p carried along.

The same steps as `app.contact.active_set.active_set`, with six differences:

- *Inexact sets.* Each system is solved until its residual is smaller by the forcing term (``-ksp_rtol``) only.
- *Carried displacement.* u follows p by its changes, which are multiplied by levels
(`app.methods.multilevel_operators`), nearly by A.
- *Defect correction.* Where the residual has become so small that this counts, u is computed anew, by a product.
- *Predictor.* Far from the solution cells enter C by the displacement to be expected when the residual is gone.
- *Verification.* Nothing counts as solved before a product in double precision has said so. Where that is dear it is
  rehearsed: the same steps by the carried displacement, which costs nothing, must pass first.
- *Coarse grids are left early*: when the residual is small enough for one, next to no pressure is negative and a load
  is nearly met, though the contact set may still change.

Where it makes no progress it gives up (`NeedsSafeguard`), and `app.methods.safeguard` takes over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.contact.active_set import CONVERGED, NO_CONTACT, failure_reason, start_grid
from app.contact.history import Outcome
from app.contact.state import Displacement, Update
from app.methods.progress import NeedsSafeguard, ResidualProgress

MAX_RELEASED_SHARE = (
    0.01  # share of the load that may be released on a coarse grid without asking what that does to u
)
MAX_COARSE_LOAD_MISS = (
    3.0  # on a coarse grid the approach to a load may still be off by so many times its tolerance
)
MIN_SINGLE_RESIDUAL = 1e-6  # a residual below this share of ||h|| on C is noise in single precision
MIN_LOAD_FRACTION = (
    0.01  # a load below this share of the largest since u was computed is lost in the rounding left in u
)


def inexact_active_set(state, solver, loading, stop, history):
    """Solve (2.8)-(2.10) on one grid from the contact set and pressure in `state`.

    Collective over the ranks of `state`. Parameters and result as of `active_set`; the solver is a TrackingSolver.

    Raises
    ------
    NeedsSafeguard
        If the residual stagnates, or the linear solver fails.
    """
    if not start_grid(state, solver, loading, history):
        return Outcome(loading.allows_no_contact, NO_CONTACT)
    sets = _ContactSets(state, solver, loading, stop)
    for k in range(1, stop.max_it + 1):
        solved = sets.solve()  # 2. and 3. (2.11) on C^k, a little
        found = sets.exchange(solved)  # 4. p < 0 leaves C, e < 0 enters; 5. and 6. on the last one
        history.add(state, solver, found.update, solved.iterations)
        residual = found.update.residual / state.distance.norm()
        if wrong := failure_reason(solved.failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if found.done and sets.stop.certified(state):
            return Outcome(True, CONVERGED, k, residual)
        sets.learn_from(solved, found)
        if sets.progress.iterations.stalls:
            raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, residual))
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


class _Solved(NamedTuple):
    """How far the system of a contact set has been solved."""

    iterations: int
    failure: str
    norm: float  # of the residual, as the solver has it [mm]
    allowed: float  # norm that is small enough [mm]
    goal: float  # that was aimed at: larger where a product has to tell what levels leave [mm]
    by_levels: bool


class _Exchanged(NamedTuple):
    """What step 4 has found."""

    update: Update
    done: bool = False  # all but the certificate is content
    computed: bool = False  # u is that of a product
    too_loose: bool = False  # the certificate says so before a product is spent


class _ContactSets:
    """The contact sets of one grid, and what each tells the next. All methods are collective.

    Attributes
    ----------
    stop : InexactStop
        Becomes tighter where the certificate says that (5.1) was too loose.
    progress : ResidualProgress
    """

    def __init__(self, state, solver, loading, stop):
        self.state, self.solver, self.loading, self.stop = state, solver, loading, stop
        solver.begin(by_levels=stop.defect_correction > 0)
        gaps = state.on_contact(with_h=True)  # of C^k; later the last update knows
        self._h_on_contact, self._norm, self._cells = gaps.h, gaps.residual, max(gaps.cells, 1)
        self.progress = ResidualProgress(self._norm)
        self._rehearsal_failed = False  # the last verification was one, and did not pass
        self._heaviest, self._load_has_fallen = 0.0, False

    def _levels_may_leave(self, allowed):
        """Largest error of a product by levels with which they go on [mm]. Not collective."""
        return max(allowed, 0.5 * self.progress.by_product)

    def solve(self):
        """Steps 2 and 3, until the residual is small enough, or levels tell no more."""
        stop, by_levels = self.stop, self.solver.by_levels
        goal = allowed = stop.allowed(self.state, self._h_on_contact)
        if stop.final and by_levels:  # on coarse grids what levels leave is no worse than the grid itself
            goal = max(allowed, stop.defect_correction * self.progress.by_product)
        self.solver.set_contact()
        return _Solved(*self.solver.improve(self.state, goal, self._norm), allowed, goal, by_levels)

    def exchange(self, solved):
        """Step 4, in one of three ways."""
        state, solver, stop = self.state, self.solver, self.stop
        tension = state.tension() if solved.norm <= solved.allowed else None
        # The system is solved, and on the target grid next to no pressure is negative: is it the last contact set?
        ready = tension is not None and (not stop.final or tension <= stop.rtol)
        too_loose = False
        if ready and stop.says_little(state, self._h_on_contact):
            solver.carry(state)
            too_loose = not stop.certified(state)
        if ready and stop.final and not too_loose:
            return self._verify(solved, tension)
        if ready and not (stop.final or self._load_has_fallen):
            return self._leave_coarse(solved, tension)
        return self._go_on(solved)._replace(too_loose=too_loose)

    def learn_from(self, solved, found):
        """Hear what came of the set. Not collective."""
        update = found.update
        if found.computed and solved.by_levels:
            self.progress.after_product(update.residual)
            self.solver.by_levels &= not self.progress.products.stalls
        self.progress.iterations.after(update.residual)
        self._heaviest = update.load if found.computed else max(update.load, self._heaviest)
        self._load_has_fallen = update.load < MIN_LOAD_FRACTION * self._heaviest
        self._h_on_contact, self._cells, self._norm = (
            update.h_on_contact,
            max(update.cells, 1),
            update.residual,
        )
        if found.done or found.too_loose:
            self.stop = self.stop.tighter(0.1)

    def _go_on(self, solved):
        """Step 4 before the last set: u computed anew where levels tell no more, else carried along."""
        state, solver, allowed = self.state, self.solver, solved.allowed
        levels_tell_no_more = allowed < solved.goal and solved.norm <= solved.goal
        computed = levels_tell_no_more or self._load_has_fallen
        released = solver.release(state, carry=not computed)  # (4.a), and u along with it
        if computed:
            state.compute_displacement(exact=allowed < MIN_SINGLE_RESIDUAL * self._h_on_contact)
            if not released:
                solver.check_levels(state, self._levels_may_leave(allowed))
        self.loading.update(state)
        expected = solver.predict(state, self.stop.predictor) if solved.norm > allowed else None
        return _Exchanged(state.activate_penetrating(expected), computed=computed)  # (4.b)

    def _verify(self, solved, tension):
        """Steps 4 to 6 on the target grid by a product in double precision, the load met exactly.

        Where it pays they are rehearsed by the carried displacement; if that does not pass the product is not made.
        """
        state, solver, loading, rehearsal = self.state, self.solver, self.loading, None
        if self._is_worth_a_rehearsal(tension):
            rehearsal = self._rehearse(tension)
            if self._rehearsal_failed:
                return _Exchanged(rehearsal)
        else:
            state.release_tensile(tension > 0)  # (4.a)
        self._rehearsal_failed = False
        solver.rest()
        if state.displacement_status is not Displacement.EXACT:
            state.compute_displacement(exact=True)
            solver.check_levels(state, self._levels_may_leave(solved.allowed))
        loading.update(state)
        update = state.activate_penetrating()  # (4.b)
        if rehearsal is not None:
            update = update.after(rehearsal)
        done = self._meets_the_test(update)
        if done:
            update = loading.settle(state, update)
            done = self._meets_the_test(update)
        return _Exchanged(update, done, computed=True)

    def _is_worth_a_rehearsal(self, tension):
        """Whether the carried displacement may tell that the product would be in vain. Not collective.

        By approach a release of next to no pressure is not rehearsed. By load it is: the approach may move by it.
        """
        if (
            self.state.displacement_status is Displacement.EXACT
            or self._rehearsal_failed
            or self._load_has_fallen
        ):
            return False
        return not (self.loading.approach_is_known and tension)

    def _rehearse(self, tension):
        """Step 4 by the carried displacement; return the update. It fails if cells enter, or the residual grows."""
        self.solver.release(self.state, tension)  # (4.a), and u along with it
        self.loading.update(self.state)
        update = self.state.activate_penetrating()  # (4.b)
        allowed = self.stop.allowed(self.state, update.h_on_contact)
        self._rehearsal_failed = bool(update.added) or update.residual > allowed
        return update

    def _meets_the_test(self, update):
        """5. and 6. (5.1). Not collective."""
        return not update.changed and update.residual <= self.stop.allowed(self.state, update.h_on_contact)

    def _leave_coarse(self, solved, tension):
        """Step 4 on a coarse grid whose system is solved well enough.

        What little the last release does to u is for the finer grid to find out, if the load is nearly met.
        """
        state, solver, loading = self.state, self.solver, self.loading
        if tension > MAX_RELEASED_SHARE:
            solver.release(state, tension)  # (4.a), and u along with it
            loading.update(state)
            return _Exchanged(state.activate_penetrating())  # (4.b)
        solver.carry(state)
        met = loading.update(state) <= MAX_COARSE_LOAD_MISS * solved.allowed / np.sqrt(self._cells)
        if met:
            state.release_tensile(tension > 0)  # (4.a)
        else:  # the approach has moved by this pressure already
            solver.release(state, tension)
        return _Exchanged(state.activate_penetrating(), done=met)  # (4.b)
