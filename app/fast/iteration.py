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
    solver.begin(by_levels=stop.defect_correction > 0)
    h_on_contact, norm, cells = state.norms_on_contact()  # of C^k; later the last update knows
    progress, rehearsal_failed = Progress(norm), False  # the last verification was one, and did not pass
    load = heaviest = 0.0
    for k in range(1, stop.max_it + 1):
        allowed, done, computed = stop.allowed(state, h_on_contact), False, False
        levels_may_leave, by_levels = max(allowed, 0.5 * progress.by_product), solver.by_levels
        # On coarse grids what levels leave is no worse than the grid itself.
        goal = (
            max(allowed, stop.defect_correction * progress.by_product)
            if stop.final and by_levels
            else allowed
        )
        solver.set_contact()  # 2. (2.11) on C^k
        its, failure, norm = solver.improve(state, goal, norm)  # 3. a little
        tension = solver.tension(state) if norm <= allowed else None
        # The system is solved, and on the target grid next to no pressure is negative: is it the last contact set?
        ready = tension is not None and (not stop.final or tension.share <= stop.rtol)
        too_loose = False
        if ready and stop.says_little(state, h_on_contact):
            solver.carry(state)
            too_loose = not stop.certified(state)
        fallen = load < FALLEN * heaviest
        if ready and not (stop.final or fallen):
            update, done = _leave_coarse(state, solver, tension, loading, NEAR * allowed / np.sqrt(cells))
        elif ready and stop.final and not too_loose:
            rehearse = not (rehearsal_failed or fallen)
            update, done, rehearsal_failed = _verify(
                state, solver, tension, loading, stop, levels_may_leave, rehearse
            )
            computed = not rehearsal_failed
        else:
            computed = (allowed < goal and norm <= goal) or fallen
            released = solver.release(state, carry=not computed)  # (4.a), and u along with it
            if computed:
                state.compute_displacement(exact=allowed < SINGLE * h_on_contact)
                if not released:
                    solver.check_levels(state, levels_may_leave)
            loading.update(state)
            expected = solver.predict(state, stop.predictor) if norm > allowed else None
            update = state.activate_penetrating(expected)  # (4.b)
        if computed and by_levels:
            progress.after_product(update.residual)
            solver.by_levels &= not progress.products.stalls
        load = update.load
        heaviest = load if computed else max(load, heaviest)
        history.add(state, solver, update, its)
        h_on_contact, cells, norm = update.h_on_contact, max(update.cells, 1), update.residual
        residual = update.residual / state.distance.norm()
        if wrong := what_is_wrong(failure, residual):
            raise NeedsSafeguard(Outcome(False, wrong, k, residual))
        if done and stop.certified(state):
            return Outcome(True, CONVERGED, k, residual)
        if done or too_loose:
            stop = stop.tighter(0.1)
        progress.iterations.after(update.residual)
        if progress.iterations.stalls:
            raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, residual))
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, residual)


def _verify(state, solver, tension, loading, stop, levels_may_leave, rehearse):
    """Steps 4 to 6 on the target grid by a product in double precision, the load met exactly. Collective.

    `rehearse`: do them by the carried displacement first; if that does not pass the product is not made.

    Returns
    -------
    Update, bool, bool
        Of the contact set; whether the problem is solved; whether it was a rehearsal only.
    """
    rehearsal = None
    # By approach a release of next to no pressure is not rehearsed. By load it is: the approach may move by it.
    if rehearse and (loading.prescribes_load or not tension.some) and state.u_is is not Displacement.EXACT:
        solver.release(state, tension)  # (4.a), and u along with it
        loading.update(state)
        rehearsal = state.activate_penetrating()
        if rehearsal.added or rehearsal.residual > stop.allowed(state, rehearsal.h_on_contact):
            return rehearsal, False, True
    else:
        state.release_tensile(tension.some)  # (4.a)
    solver.rest()
    if state.u_is is not Displacement.EXACT:
        state.compute_displacement(exact=True)
        solver.check_levels(state, levels_may_leave)
    loading.update(state)
    update = state.activate_penetrating()  # (4.b)
    if rehearsal is not None:
        update = update.after(rehearsal)
    if _solved(state, update, stop):
        update = loading.settle(state, update)
    return update, _solved(state, update, stop), False


def _solved(state, update, stop):
    """5. and 6. (5.1). Not collective."""
    return not update.changed and update.residual <= stop.allowed(state, update.h_on_contact)


def _leave_coarse(state, solver, tension, loading, near):
    """Step 4 on a coarse grid whose system is solved well enough; as `_verify`.

    What little the last release does to u is for the finer grid to find out, if the load is met but for `near` [mm].
    """
    little = tension.share <= RELEASED
    if little:
        solver.carry(state)
    enough = little and loading.update(state) <= near
    if enough:
        state.release_tensile(tension.some)  # (4.a)
    else:
        solver.release(state, tension)  # (4.a), and u along with it
        if not little:  # else the approach has moved by this pressure already
            loading.update(state)
    return state.activate_penetrating(), enough  # (4.b)
