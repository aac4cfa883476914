"""Safeguard: projected Newton's method, which is proved to converge.

The method solves ``min f(p) = p.Ap / 2 + h.p, p >= 0`` [1]_. The direction d solves (2.11) approximately on the contact
set C, without the cells that have a gap and almost no pressure. The step along ``p(alpha) = max(p + alpha d, 0)`` is
halved until f falls by Armijo's condition. With alpha = 1 these are steps 2 to 4 of Sec. 4.1. f falls in every
iteration, and the limit is the solution, for any symmetric positive definite preconditioner and any number of CG steps
[1, Prop. 2]. To meet a prescribed load, a bracketing root search calls the method, because the load is monotone in the
approach. If moments are prescribed, too, the bodies are held by springs, see `app.contact.tilted_load`.

All numbers are in double precision. The method needs some more vectors while it runs. The result counts the grids on
which the method was used (``fallbacks``).

References
----------
.. [1] D.P. Bertsekas, Projected Newton methods for optimization problems with simple constraints, SIAM J. Control
   Optim. 20 (1982) 221-246.
"""

import math

import numpy as np

from app.contact.active_set import CONVERGED, failure_reason
from app.contact.history import Outcome
from app.contact.state import Displacement
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.contact.updates import Update
from app.methods.progress import HalvingTest
from app.multigrid.linear_solver import LinearSolver

MAX_EXCLUDED_PRESSURE = (
    0.01  # largest pressure of a cell with a gap that the system leaves out, over the maximum
)
ARMIJO_FRACTION = 1e-4
MAX_HALVINGS = 40
NO_STEP = "rounding leaves no step that makes it better"
TOO_FEW = "{} iterations of the safeguard were not enough: more by -lcp_max_it"


def solve_safeguarded(hierarchy, number, state, loading, stop, history):
    """Solve on one grid by projected Newton's method; return the Outcome.

    Collective over the ranks of `state`. `number` is the number of the level.
    """
    operator = state.operator
    with operator.double_precision():
        solver = LinearSolver(hierarchy, number, operator=operator)

        def solve(loading, stop):  # the state has the approach
            return ProjectedNewton(state, solver, stop, loading.support).run(history)

        try:
            step = state.on_contact_or_overlap().rms
            # The load that the search leaves over is spread evenly, also over cells that are much softer than others.
            tighter = 0.1 if operator.compliance is None else 1e-3
            outcome = loading.solve_by_search(state, solve, stop, tighter, tighter * stop.rtol, step)
        finally:
            solver.destroy()
    return outcome._replace(fallbacks=outcome.fallbacks + 1)


class ProjectedNewton:
    """Projected Newton's method at the approach of a state. Collective.

    Parameters
    ----------
    state : ContactState
        State with the approach and the initial pressure.
    solver : LinearSolver
        Linear solver of the same operator, in double precision.
    stop : InexactStop
    support : Springs, optional
        Springs that hold the bodies (`app.contact.tilted_load`): the position depends on the pressure, and A has their
        compliance, too.

    Attributes
    ----------
    gap : ndarray, shape (local rows, nx), [mm]
        h + A p.
    """

    def __init__(self, state, solver, stop, support=None):
        self.state, self.solver, self.stop, self._support = state, solver, stop, support

    def run(self, history):
        """Solve the contact problem (2.8)-(2.10); return the Outcome."""
        state, solver, progress = self.state, self.solver, HalvingTest()
        history.start(state, solver)
        state.project()
        state.u[...], self.gap = self._displace(state.p)
        residual = state.on_contact().residual / state.h_norm
        for k in range(1, self.stop.max_it + 1):
            before = state.contact.copy()
            direction, its, failure = self._find_direction()
            descent = state.sum([np.vdot(self.gap, direction)])[0]
            if not math.isfinite(descent):
                self._update_contact(before)
                return Outcome(False, failure_reason(failure, float("inf")), k, residual)
            moved = self._descend(direction, descent)
            update = self._update_contact(before)  # including the cells that the system left out
            is_exact = state.displacement_status is Displacement.EXACT
            if not moved:
                residual = update.residual / state.h_norm
                solved = is_exact and residual <= self.stop.rtol and self.stop.certified(state)
                return Outcome(solved, CONVERGED if solved else NO_STEP, k, residual)
            if not is_exact and update.residual <= self.stop.allowed(state):
                state.compute_displacement(exact=True)
                self.gap = state.gap()
                update = self._update_contact(before)
            history.add(state, solver, update, its)
            residual = update.residual / state.h_norm
            if wrong := failure_reason(failure, residual):
                return Outcome(False, wrong, k, residual)
            if update.residual <= self.stop.allowed(state):
                if self.stop.certified(state):
                    return Outcome(True, CONVERGED, k, residual)
                self.stop, progress = self.stop.tighter(0.1), HalvingTest()
            progress.update(update.residual)
            if progress.stagnates and update.residual <= ROUNDING_RESIDUAL * state.on_contact(with_h=True).h:
                return Outcome(False, BELOW_ROUNDING, k, residual, to_rounding=True)
        return Outcome(False, TOO_FEW.format(self.stop.max_it), self.stop.max_it, residual)

    def _displace(self, p):
        """Return displacement A p and gap h + A p, in the position that p gives."""
        if self._support is not None:
            self._support.follow(p)
        u = np.empty(p.shape)
        self.state.operator.displacement(p, u)
        return u, u - (self.state.distance.b + self.state.depth)

    def _find_direction(self):
        """Choose the contact set, and solve (2.11) there.

        Return the direction, the iterations, and why the solver failed (empty if it did not).
        """
        state, solver = self.state, self.solver
        state.contact[...] = state.bounds.contact(state.p, self.gap, self._excluded_pressure())
        to_bound = self._leave_full_contact()
        solver.set_contact()
        with state.operator.supported(self._support):
            direction, its, failure = solver.solve(state.defect(), self.stop.allowed(state))
        return direction.getArray(readonly=True).reshape(self.gap.shape) + to_bound, its, failure

    def _descend(self, direction, descent):
        """Move p along a direction, by Armijo's rule; return success.

        The largest of the steps 1, 1/2, 1/4, ... is taken that satisfies Armijo's condition. `descent` is the
        derivative of f along the `direction`.
        """
        state, alpha = self.state, 1.0
        for _ in range(MAX_HALVINGS):
            change = state.bounds.change(state.p, alpha * direction)
            u, gap = self._displace(state.p + change)
            # f(p + change) - f(p) without cancellation
            difference = 0.5 * state.sum([np.vdot(change, self.gap + gap)])[0]
            if difference <= ARMIJO_FRACTION * alpha * descent:
                break
            alpha *= 0.5
        else:
            if self._support is not None:
                self._support.follow(state.p)
            return False
        np.add(state.p, change, out=state.values)
        state.project()  # rounding
        state.u[...], self.gap = u, gap
        is_exact = not state.operator.needs_verification
        state.displacement_status = Displacement.EXACT if is_exact else Displacement.UPDATED
        return True

    def _leave_full_contact(self):
        """Remove a cell from full contact; return the change of p [N/mm2].

        The change moves p outside C to its bounds. A is singular on all cells of a periodic patch. So if C has all
        cells, the cell with the largest gap leaves C; beyond full contact, the cell with the deepest overlap that can
        become plastic.
        """
        state, p, bounds, distance = self.state, self.state.p, self.state.bounds, self.state.distance
        if not np.isfinite(distance.full_depth) or state.elastic_cells() < state.grid.n:
            return bounds.to_bound(p, state.contact)
        bound, order = np.broadcast_to(bounds.lower, p.shape), -self.gap
        if state.depth > distance.full_depth and distance.max_depth == np.inf:
            bound, order = bounds.upper, np.where(np.isfinite(bounds.upper), self.gap, np.inf)
        leaves = order <= state.minimum([order.min(initial=np.inf)])[0]
        np.logical_not(leaves, out=state.contact)
        change = np.zeros_like(p)
        np.subtract(bound, p, out=change, where=leaves)
        return change

    def _excluded_pressure(self):
        """Return the pressure below which cells with gaps leave C.

        This pressure tends to zero as the iteration converges.
        """
        state = self.state
        step = np.abs(state.bounds.change(state.p, -self.gap / state.operator.diagonal))
        minus_highest, minus_largest = state.minimum([-state.p.max(initial=0.0), -step.max(initial=0.0)])
        return min(-MAX_EXCLUDED_PRESSURE * minus_highest, -minus_largest)

    def _update_contact(self, before):
        """Put the cells with pressure or overlap into C.

        Return the Update since the contact set `before`.
        """
        state = self.state
        state.contact[...] = state.bounds.contact(state.p, self.gap)
        counts = state.contact.sum(), (state.contact & ~before).sum(), (before & ~state.contact).sum()
        inside = self.gap[state.contact]
        cells, added, released, squares = state.sum([*counts, inside @ inside])
        return Update(int(cells), int(added), int(released), float(np.sqrt(squares)))
