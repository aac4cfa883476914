"""The active set iteration of Sec. 3 and 4.1.

Options of the linear solver decide how accurately it solves the system of a contact set: fully by CG (NORM, Sec. 3), or
by one multigrid cycle (MG + active set, Sec. 4.1). The solve for a contact set starts from the pressure of the previous
contact set.
"""

from dataclasses import replace

from app.contact.history import Outcome
from app.contact.state import Displacement
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL

CONVERGED = "contact area unchanged and residual small enough"
NO_CONTACT = "no contact pressure: the bodies do not touch, or only just"
TOO_MANY_ITERATIONS = (
    "{} active set iterations in a row were not enough: more by -lcp_max_it, "
    "or the default method, which has a safeguard"
)


def active_set(state, solver, loading, stop, history):
    """Solve the contact problem (2.8)-(2.10) on one grid (Sec. 3, 4.1).

    Collective over the ranks of `state`, which has the initial contact set and pressure. `solver` is a LinearSolver or
    DirectSolver of the same operator. Return the Outcome.
    """
    return ActiveSetIteration(state, solver, loading, stop).run(history)


class ActiveSetIteration:
    """The paper's iteration on one grid; a subclass may change its steps. Collective.

    The parameters are as in `active_set`.
    """

    too_many = TOO_MANY_ITERATIONS

    def __init__(self, state, solver, loading, stop):
        self.state, self.solver, self.loading, self.stop = state, solver, loading, stop

    def run(self, history):
        """Iterate; return the Outcome."""
        state, solver, loading = self.state, self.solver, self.loading
        if not start_grid(state, solver, loading, history):  # Sec. 4.1, 1
            return Outcome(loading.allows_no_contact, NO_CONTACT)
        for k in range(1, self.stop.max_it + 1):
            correction, its, failure = self.solve()  # steps 2 and 3
            state.add(correction)
            state.release_tensile()  # Sec. 4.1, (4.a)
            state.compute_displacement()  # u = A p, after the release: any other order oscillates
            self.move()
            update = state.activate_penetrating()  # Sec. 4.1, (4.b)
            history.add(state, solver, update, its)
            residual = update.residual / state.h_norm
            if reason := failure_reason(failure, residual):
                return Outcome(False, reason, k, residual)
            if self.passes(update):
                update = loading.settle(state, update) if self.stop.final else update
                if self.passes(update) and self.accepts():
                    return Outcome(True, CONVERGED, k, residual)
            if reason := self.gives_up(update, history):
                if rounding := reason == BELOW_ROUNDING:
                    loading.settle(state, update)
                return Outcome(False, reason, k, residual, to_rounding=rounding)
        return Outcome(False, self.too_many.format(self.stop.max_it), self.stop.max_it, residual)

    def solve(self):
        """Solve for the contact set; return correction, iterations and failure."""
        state = self.state
        state.leave_full_contact()  # periodic patches only
        self.solver.set_contact()  # Sec. 4.1, 2
        return self.solver.solve(state.defect(), self.stop.allowed(state))  # Sec. 4.1, 3

    def move(self):
        """Change the approach under a prescribed load."""
        self.loading.update(self.state)

    def passes(self, update):
        """Return whether an update passes the test."""
        return (
            not update.changed  # Sec. 4.1, 5
            and self.stop(self.state, update.residual)  # Sec. 4.1, 6
        )

    def accepts(self):
        """Return whether a pressure that passes is the solution."""
        return True

    def gives_up(self, update, history):
        """Return why the iteration ends although the test fails; an empty text if it continues."""
        is_rounding = not update.changed and update.residual <= ROUNDING_RESIDUAL * update.h_on_contact
        return BELOW_ROUNDING if is_rounding and history.stagnates() else ""


def active_set_or_search(state, solver, loading, stop, history):
    """Run `active_set`; if it fails for a load, search the approach. Collective.

    The root search is used on periodic patches, and with a hardness. Near full contact, or where cells become plastic,
    the slope of the load changes with every cell, so that Newton's method for the load may not converge.
    """
    if loading.approach_is_known or not state.may_cycle:
        return active_set(state, solver, loading, stop, history)
    outcome = active_set(state, solver, loading, replace(stop, max_it=-(-stop.max_it // 2)), history)
    if outcome.converged or outcome.to_rounding:
        return outcome
    state.start_from_interpenetration()

    def solve(approach, tight):
        return active_set(state, solver, approach, tight, history)

    rtol = 0.01 * min(stop.rtol, 0.1)
    outcome = loading.solve_by_search(state, solve, stop, 0.25, rtol).after(outcome)
    return outcome._replace(fallbacks=outcome.fallbacks + 1)


def start_grid(state, solver, loading, history):
    """Start the iteration on a grid; return whether there is contact. Collective.

    If C is empty, cells that overlap without pressure are added to C, because a coarser grid may have missed contact.
    """
    loading.begin(state)
    if state.may_cycle:
        state.forget_exchanges()
    history.start(state, solver)
    touches = state.cells_in_contact() > 0
    if not touches:
        state.start_from_interpenetration()
        touches = state.cells_in_contact() > 0
    if state.displacement_status is Displacement.STALE:
        state.compute_displacement()
    return touches


def failure_reason(failure, residual):
    """Return why the iteration failed; an empty text if it did not."""
    if failure:
        return f"the linear solver failed: {failure}"
    return "" if residual < float("inf") else "the residual is not a finite number"
