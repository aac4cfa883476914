"""The active set iteration of the default method: contact sets solved a little, u = A p carried along (Sec. 4.1 beyond).

The same steps as `app.contact.iteration.active_set`, with three differences: each set is solved only until its residual
is smaller by the forcing term (``-ksp_rtol``); u follows p, so that only what step 4.a changes costs a product; and
nothing is believed to be solved before a product in double precision has said so.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.contact.history import Outcome
from app.contact.iteration import CONVERGED, NO_CONTACT
from app.contact.state import Displacement
from app.contact.stopping import StoppingTest

_IN_CONTACT = 100.0  # (5.1) also with h on C alone and so many times rtol: contact may be small in its patch
_PATIENCE = 8  # iterations that do not halve the residual: the safeguard takes over


@dataclass(frozen=True)
class InexactStop(StoppingTest):
    """(5.1) also with h on C, and what is enough on coarser grids."""

    coarse_rtol: float = 0.0  # ||r|| / ||h||_C that is enough on coarser grids; 0: C unchanged
    correction: float = 0.0

    def allowed(self, state):
        """Norm of the residual that is small enough [mm]. Collective."""
        whole, inside = state.distance.norm(), state.h_on_contact()
        if not self.final:
            return self.coarse_rtol * min(whole, inside)
        return self.rtol * min(whole, _IN_CONTACT * inside if inside else whole)

    def for_coarse_grid(self):
        """See `StoppingTest.for_coarse_grid`."""
        return InexactStop(self.rtol, self.max_it, False, self.coarse_rtol, self.correction)


class NeedsSafeguard(Exception):
    """The iteration makes no progress; `args[0]` is its Outcome so far."""


def inexact_active_set(state, solver, loading, stop, history):
    """Solve (2.8)-(2.10) on one grid from the contact set and pressure in `state`.

    Collective over the ranks of `state`. Parameters and result as of `active_set`.

    Raises
    ------
    NeedsSafeguard
        If a contact set comes back, or the residual stagnates.
    """
    inner, resume = 0, False
    seen, best, since = set(), float("inf"), 0
    loading.begin(state)
    history.start(state, solver)
    if not state.in_contact():
        state.start_from_interpenetration()
        if not state.in_contact():
            return Outcome(True, NO_CONTACT)
    if state.u_is is Displacement.STALE:
        state.compute_displacement()
    for k in range(1, stop.max_it + 1):
        allowed = stop.allowed(state)
        solver.set_contact()  # 2.
        its, failure, norm = solver.improve(state, 0.9 * allowed, resume)  # 3.
        if not stop.final and norm <= allowed and solver.tension(state) <= 0.01:
            # Enough for a grid on the way: what leaves and enters now is the finer grid's to find out.
            released = state.release_tensile()
            update = state.activate_penetrating()
            history.add(state, solver, update, its, released)
            return Outcome(True, CONVERGED, k, inner + its, update.residual / state.distance.norm())
        released = solver.release(state, stop.correction if norm > allowed else 0.0)  # 4.a
        loading.update(state)
        update = state.activate_penetrating()  # 4.b
        inner += its
        if stop.final and not update.changed and update.residual <= allowed:  # 5. and 6.
            update = loading.settle(state, update)
            if state.u_is is not Displacement.EXACT:
                state.compute_displacement(exact=True)
                update = state.activate_penetrating().after(update)
        history.add(state, solver, update, its, released)
        residual = update.residual / state.distance.norm()
        if failure:
            return Outcome(False, f"the linear solver failed: {failure}", k, inner, residual)
        if not residual < float("inf"):
            return Outcome(False, "the residual is not a finite number", k, inner, residual)
        done = update.residual <= allowed and update.changed <= (0 if stop.final else 0.01 * update.cells)
        if done and (state.u_is is Displacement.EXACT or not stop.final):
            return Outcome(True, CONVERGED, k, inner, residual)
        resume = not update.changed and not released and state.u_is is Displacement.CARRIED
        since += 1
        if update.residual <= 0.5 * best:
            best, since = update.residual, 0
        if since >= _PATIENCE:
            raise NeedsSafeguard(Outcome(False, "the residual stagnates", k, inner, residual))
    return Outcome(False, f"{stop.max_it} active set iterations were not enough", stop.max_it, inner, residual)
