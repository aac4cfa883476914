"""Conjugate gradients for the displacement of the free cells, that carry the pressure along.

``p = B w + mean pressure`` is to vanish on the free cells O. So p is all there is of a residual: it is kept on all
cells, ``w += alpha d`` and ``p += alpha B d`` in one pass, and the right-hand side of the KSP is not looked at. The
norm is that of the preconditioned residual, about the error of w; directions are those of flexible CG, the
preconditioner need not be quite symmetric. By options of -lcp_type primal only::

    -ksp_type python -ksp_python_type app.primal.cg.CarryingCG -ksp_norm_type preconditioned
"""

from __future__ import annotations

from functools import cache
from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.compiled import njit
from app.halfspace.operator import context_of
from app.halfspace.reductions import any_order
from app.multigrid.ksp_context import KspContext
from app.primal.operator import InverseOperator


@any_order
def _dots_row(d, q, p, free):
    dq, dp, pp, pq, qq = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(d.size):
        value = np.float64(d[i])
        dq += value * q[i]
        dp += value * p[i]
        inside, left = (np.float64(q[i]), p[i]) if free[i] else (0.0, 0.0)
        pp += left * left
        pq += left * inside
        qq += inside * inside
    return dq, dp, pp, pq, qq


@njit()
def _dots(d, q, p, free):
    """d.q and d.p for a d that vanishes outside O; p.p, p.q and q.q on O."""
    dq, dp, pp, pq, qq = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(d.shape[0]):
        here = _dots_row(d[j], q[j], p[j], free[j])
        dq += here[0]
        dp += here[1]
        pp += here[2]
        pq += here[3]
        qq += here[4]
    return dq, dp, pp, pq, qq


@any_order
def _step_row(w, p, d, q, alpha):
    for i in range(w.size):
        w[i] += alpha * d[i]
        p[i] += alpha * q[i]


@any_order
def _step(w, p, d, q, alpha):
    """w += alpha d, p += alpha q."""
    for j in range(w.shape[0]):
        _step_row(w[j], p[j], d[j], q[j], alpha)


@any_order
def _normed_row(z, q):
    squares, product = 0.0, 0.0
    for i in range(z.size):
        value = np.float64(z[i])
        squares += value * value
        product += value * q[i]
    return squares, product


@njit()
def _normed(z, q):
    """z.z and z.q."""
    squares, product = 0.0, 0.0
    for j in range(z.shape[0]):
        here = _normed_row(z[j], q[j])
        squares += here[0]
        product += here[1]
    return squares, product


@any_order
def _direct_row(d, z, beta):
    for i in range(d.size):
        d[i] = z[i] + beta * d[i]


@any_order
def _direct(d, z, beta):
    """d = z + beta d."""
    for j in range(d.shape[0]):
        _direct_row(d[j], z[j], beta)


@cache
def warm_up(dtype):
    """Load the compiled loops now, not in the first iteration. Not collective."""
    field = np.zeros((0, 0))
    low = field.astype(dtype)
    _dots(low, low, field, field.astype(bool))
    _step(field, field, low, low, 0.0)
    _normed(low, low)
    _direct(low, low, dtype.type(0))


class CarryingCG(KspContext):
    """KSP context; its operator must be an `InverseOperator`, its PC a `TwoGrid`.

    Collective. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*. The preconditioner is applied to p as it is; it
    looks at the free cells only, and leaves the others zero. For the test of -ksp_rtol the preconditioned norm is
    estimated from how much smaller p on the free cells is: it saves the last application.

    Attributes
    ----------
    pressure : Vec
        p on entry and on exit; set by the caller. The initial guess is always taken for w.
    residual : float
        Norm of the preconditioned residual after the last solve [mm].
    scratch : ndarray, shape (local rows, nx)
        To be used by others between solves, as may `direction` and `product`, in the operator's precision.
    """

    pressure = None
    residual = 0.0

    def setUp(self, ksp):
        """Make the work arrays, in the operator's precision: z, in a place for doubles, d and q."""
        if ksp.getNormType() != PETSc.KSP.NormType.PRECONDITIONED:
            raise ValueError("-ksp_norm_type: -lcp_type primal needs preconditioned")
        mat = ksp.getOperators()[0]
        self._operator = operator = context_of(mat, InverseOperator, "CarryingCG")
        shape = operator.local_shape
        self.scratch = np.zeros(shape)
        self._z = self.scratch.reshape(-1).view(operator.dtype)[: self.scratch.size].reshape(shape)
        self.direction = np.zeros(shape, operator.dtype)
        [lent] = operator.scratch_beside_product(operator.dtype)
        self.product = np.zeros(shape, operator.dtype) if lent is None else lent
        warm_up(operator.dtype)

    def solve(self, ksp, b, x):
        """Improve x, which is w."""
        operator, smooth = self._operator, ksp.getPC().getPythonContext().smooth
        d, q, z, shape = self.direction, self.product, self._z, operator.local_shape
        iteration, max_it = 0, ksp.getTolerances()[3]
        smooth(self._pressure(), z)
        beta, norm = 0.0, sqrt(self._sum(_normed(z, q))[0])
        d[...] = 0
        reason = self._report(ksp, 0, norm)
        while not reason and iteration < max_it:
            _direct(d, z, d.dtype.type(beta))
            operator.products += 1
            operator.pressure(d, q)
            with self.pressure as pressure, x as displacement:
                p, w = pressure.reshape(shape), displacement.reshape(shape)
                dq, dp, pp, pq, qq = self._sum(_dots(d, q, p, operator.mask))
                if not dq > 0:
                    reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                    break
                alpha = -dp / dq
                _step(w, p, d, q, alpha)
            iteration += 1
            left = (pp + alpha * (2 * pq + alpha * qq)) / pp if pp else 0.0  # of p.p on the free cells
            about = norm * sqrt(max(left, 0.0))
            if ksp.callConvergenceTest(iteration, about) == PETSc.KSP.ConvergedReason.CONVERGED_RTOL:
                norm, reason = about, self._report(ksp, iteration, about)
                break
            smooth(self._pressure(), z)
            squares, zq = self._sum(_normed(z, q))
            beta, norm = -zq / dq, sqrt(squares)
            reason = self._report(ksp, iteration, norm)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def _pressure(self):
        return self._read(self.pressure)

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the pressure of all cells up to date\n")
