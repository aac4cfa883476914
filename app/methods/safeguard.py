"""Safeguard: projected Newton's method, which is proved to converge.

The method solves ``min f(p) = p.Ap / 2 + h.p, p >= 0`` [1]_. The direction d solves (2.11) approximately on the contact
set C, without the cells that have a gap and almost no pressure. The step along ``p(alpha) = max(p + alpha d, 0)`` is
halved until f falls by Armijo's condition. With alpha = 1 these are steps 2 to 4 of Sec. 4.1. f falls in every
iteration, and the limit is the solution, for any symmetric positive definite preconditioner and any number of CG steps
[1, Prop. 2]. To meet a prescribed load, a bracketing root search calls the method, because the load is monotone in the
approach.

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
from app.contact.state import Displacement, Update
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.progress import HalvingTest
from app.multigrid.linear_solver import LinearSolver

MAX_EXCLUDED_PRESSURE = (
    0.01  # largest pressure of a cell with a gap that the system leaves out, over the maximum
)
ARMIJO_FRACTION = 1e-4
MAX_HALVINGS = 40


def solve_safeguarded(hierarchy, number, state, loading, stop, history):
    """Solve on one grid by projected Newton's method; return the Outcome.

    Collective over the ranks of `state`. `number` is the number of the level.
    """
    operator = state.operator
    with operator.double_precision():
        solver = LinearSolver(hierarchy, number, operator=operator)

        def solve(_, stop):  # the state has the approach
            return projected_newton(state, solver, stop, history)

        try:
            step = state.on_contact_or_overlap().rms
            outcome = loading.solve_by_search(state, solve, stop, 0.1, 0.1 * stop.rtol, step)
        finally:
            solver.destroy()
    return outcome._replace(fallbacks=outcome.fallbacks + 1)


def projected_newton(state, solver, stop, history):
    """Solve the contact problem (2.8)-(2.10) by projected Newton's method.

    Collective over the ranks of `state`, which has the approach and the initial pressure. Parameters and result are as
    in `active_set`; the solver is in double precision.
    """
    history.start(state, solver)
    state.project()
    state.u[...], gap = _compute_gap(state, state.p)
    residual, progress = state.on_contact().residual / state.h_norm, HalvingTest()
    for k in range(1, stop.max_it + 1):
        before, p, bounds = state.contact.copy(), state.p, state.bounds
        state.contact[...] = bounds.contact(p, gap, _excluded_pressure(state, gap))
        to_bound = _leave_full_contact(state, gap)
        solver.set_contact()
        direction, its, failure = solver.solve(state.defect(), stop.allowed(state))
        d = direction.getArray(readonly=True).reshape(gap.shape) + to_bound
        descent, alpha = state.sum([np.vdot(gap, d)])[0], 1.0
        if not math.isfinite(descent):
            _update_contact(state, gap, before)
            return Outcome(False, failure_reason(failure, float("inf")), k, residual)
        for _ in range(MAX_HALVINGS):
            change = bounds.change(p, alpha * d)
            trial_u, trial_gap = _compute_gap(state, p + change)
            # f(p + change) - f(p) without cancellation
            difference = 0.5 * state.sum([np.vdot(change, gap + trial_gap)])[0]
            if difference <= ARMIJO_FRACTION * alpha * descent:
                break
            alpha *= 0.5
        else:
            update = _update_contact(state, gap, before)  # including the cells that the system left out
            exact = state.displacement_status is Displacement.EXACT
            solved = exact and update.residual <= stop.rtol * state.h_norm and stop.certified(state)
            reason = CONVERGED if solved else "rounding leaves no step that makes it better"
            return Outcome(solved, reason, k, update.residual / state.h_norm)
        np.add(p, change, out=state.values)
        state.project()  # rounding
        state.u[...], gap = trial_u, trial_gap
        state.displacement_status = (
            Displacement.UPDATED if state.operator.needs_verification else Displacement.EXACT
        )
        update = _update_contact(state, gap, before)
        if update.residual <= stop.allowed(state) and state.displacement_status is not Displacement.EXACT:
            state.compute_displacement(exact=True)
            gap = state.gap()
            update = _update_contact(state, gap, before)
        history.add(state, solver, update, its)
        residual = update.residual / state.h_norm
        if wrong := failure_reason(failure, residual):
            return Outcome(False, wrong, k, residual)
        if update.residual <= stop.allowed(state):
            if stop.certified(state):
                return Outcome(True, CONVERGED, k, residual)
            stop, progress = stop.tighter(0.1), HalvingTest()
        progress.update(update.residual)
        if progress.stagnates and update.residual <= ROUNDING_RESIDUAL * state.on_contact(with_h=True).h:
            return Outcome(False, BELOW_ROUNDING, k, residual, to_rounding=True)
    too_few = f"{stop.max_it} iterations of the safeguard were not enough: more by -lcp_max_it"
    return Outcome(False, too_few, stop.max_it, residual)


def _compute_gap(state, p):
    """Return displacement A p and gap h + A p. Collective."""
    u = np.empty(p.shape)
    state.operator.displacement(p, u)
    return u, u - (state.distance.b + state.depth)


def _leave_full_contact(state, gap):
    """Remove a cell from full contact; return the change of p [N/mm2].

    Collective. The change moves p outside C to its bounds. A is singular on all cells of a periodic patch. So if C has
    all cells, the cell with the largest gap leaves C; beyond full contact, the cell with the deepest overlap that can
    become plastic.
    """
    p, bounds, distance = state.p, state.bounds, state.distance
    if not np.isfinite(distance.full_depth) or state.elastic_cells() < state.grid.n:
        return bounds.to_bound(p, state.contact)
    beyond, bound = state.depth > distance.full_depth, np.broadcast_to(bounds.lower, p.shape)
    order = -gap
    if beyond and distance.max_depth == np.inf:
        bound, order = bounds.upper, np.where(np.isfinite(bounds.upper), gap, np.inf)
    leaves = order <= state.minimum([order.min(initial=np.inf)])[0]
    np.logical_not(leaves, out=state.contact)
    change = np.zeros_like(p)
    np.subtract(bound, p, out=change, where=leaves)
    return change


def _excluded_pressure(state, gap):
    """Return the pressure below which cells with gaps leave C.

    Collective. This pressure tends to zero as the iteration converges.
    """
    p = state.p
    step = np.abs(state.bounds.change(p, -gap / state.operator.diagonal))
    minus_highest, minus_largest = state.minimum([-p.max(initial=0.0), -step.max(initial=0.0)])
    return min(-MAX_EXCLUDED_PRESSURE * minus_highest, -minus_largest)


def _update_contact(state, gap, before):
    """Set the contact set to the cells with pressure or overlap. Collective.

    `gap` is h + A p. Return the Update since the contact set `before`.
    """
    state.contact[...] = state.bounds.contact(state.p, gap)
    counts = state.contact.sum(), (state.contact & ~before).sum(), (before & ~state.contact).sum()
    inside = gap[state.contact]
    cells, added, released, squares = state.sum([*counts, inside @ inside])
    return Update(int(cells), int(added), int(released), float(np.sqrt(squares)))
