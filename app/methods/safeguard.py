"""The safeguard: an active set iteration with a proof of convergence, for where the inexact one makes no progress.

*Projected Newton's method* [1]_ for ``min f(p) = p.Ap / 2 + h.p, p >= 0``. The direction d solves (2.11) a little on C,
which here leaves out the cells with next to no pressure and a gap; along ``p(alpha) = max(p + alpha d, 0)`` the step is
halved until f falls as much as Armijo asks for. With alpha = 1 this is steps 2 to 4.b of Sec. 4.1, so little is lost
where they work. f falls in every iteration and the limit is the solution, for any symmetric positive definite
preconditioner and any number of CG steps [1, Prop. 2]. Under a prescribed load a bracketing root search goes around it:
the load is monotone in the approach (`app.contact.prescribed_load.PrescribedLoad.solve_by_search`).

All in double precision; on top of the iteration's own it takes some vectors while it runs. The result says that it
took over (``fallbacks``, the number of grids).

References
----------
.. [1] D.P. Bertsekas, Projected Newton methods for optimization problems with simple constraints, SIAM J. Control
   Optim. 20 (1982) 221-246.
"""

from __future__ import annotations

import math

import numpy as np

from app.contact.active_set import CONVERGED, failure_reason
from app.contact.history import Outcome
from app.contact.state import Displacement, Update
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.progress import HalvingTest

MAX_EXCLUDED_PRESSURE = (
    0.01  # of the largest pressure, at most: cells with less and a gap are left out of the system
)
ARMIJO_FRACTION = 1e-4
MAX_HALVINGS = 40


def projected_newton(state, solver, stop, history):
    """Solve (2.8)-(2.10) for the approach of `state`, from its pressure.

    Collective over the ranks of `state`.

    Parameters
    ----------
    state : ContactState
    solver : LinearSolver
        In double precision.
    stop : InexactStop
    history : History

    Returns
    -------
    Outcome
    """
    history.start(state, solver)
    state.project()
    state.u[...], gap = _displaced(state, state.p)
    residual, progress = state.on_contact().residual / state.distance.norm(), HalvingTest()
    for k in range(1, stop.max_it + 1):
        before, p, bounds = state.contact.copy(), state.p, state.bounds
        state.contact[...] = bounds.contact(p, gap, _nearly_none(state, gap))
        solver.set_contact()
        direction, its, failure = solver.solve(state.defect(), stop.allowed(state))
        d = direction.getArray(readonly=True).reshape(gap.shape) + bounds.to_bound(p, state.contact)
        descent, alpha = state.sum([np.vdot(gap, d)])[0], 1.0
        if not math.isfinite(descent):
            _contact_from(state, gap, before)
            return Outcome(False, failure_reason(failure, float("inf")), k, residual)
        for _ in range(MAX_HALVINGS):
            change = bounds.change(p, alpha * d)
            trial_u, trial_gap = _displaced(state, p + change)
            # f(p + change) - f(p), without the cancellation of two nearly equal numbers
            difference = 0.5 * state.sum([np.vdot(change, gap + trial_gap)])[0]
            if difference <= ARMIJO_FRACTION * alpha * descent:
                break
            alpha *= 0.5
        else:
            _contact_from(state, gap, before)  # with the cells, too, that the system was without
            return Outcome(False, "rounding leaves no step that makes it better", k, residual)
        np.add(p, change, out=state.values)
        state.u[...], gap = trial_u, trial_gap
        state.displacement_status = (
            Displacement.UPDATED if state.operator.needs_verification else Displacement.EXACT
        )
        update = _contact_from(state, gap, before)
        if update.residual <= stop.allowed(state) and state.displacement_status is not Displacement.EXACT:
            state.compute_displacement(exact=True)
            gap = state.gap()
            update = _contact_from(state, gap, before)
        history.add(state, solver, update, its)
        residual = update.residual / state.distance.norm()
        if wrong := failure_reason(failure, residual):
            return Outcome(False, wrong, k, residual)
        if update.residual <= stop.allowed(state):
            if stop.certified(state):
                return Outcome(True, CONVERGED, k, residual)
            stop, progress = stop.tighter(0.1), HalvingTest()
        progress.after(update.residual)
        if progress.stalls and update.residual <= ROUNDING_RESIDUAL * state.on_contact(with_h=True).h:
            return Outcome(False, BELOW_ROUNDING, k, residual, to_rounding=True)
    too_few = f"{stop.max_it} iterations of the safeguard were not enough: more by -lcp_max_it"
    return Outcome(False, too_few, stop.max_it, residual)


def _displaced(state, p):
    """A p, and h + A p, for any pressure. Collective."""
    u = np.empty(p.shape)
    state.operator.displacement(p, u)
    return u, u - (state.distance.b + state.depth)


def _nearly_none(state, gap):
    """Pressure up to which a cell with a gap is left out of the system; none in the limit. Collective."""
    p = state.p
    step = np.abs(state.bounds.change(p, -gap / state.operator.diagonal))
    minus_highest, minus_largest = state.minimum([-p.max(initial=0.0), -step.max(initial=0.0)])
    return min(-MAX_EXCLUDED_PRESSURE * minus_highest, -minus_largest)


def _contact_from(state, gap, before):
    """Let C be where there is pressure or overlap; return the Update since a set `before`. Collective."""
    state.contact[...] = state.bounds.contact(state.p, gap)
    counts = state.contact.sum(), (state.contact & ~before).sum(), (before & ~state.contact).sum()
    inside = gap[state.contact]
    cells, added, released, squares = state.sum([*counts, inside @ inside])
    return Update(int(cells), int(added), int(released), float(np.sqrt(squares)))
