"""Conjugate gradients for the displacement of the free cells, that carry the pressure along.

``p = B w + mean pressure`` is to vanish on the free cells O. So p is all there is of a residual: it is kept on all
cells, changes of w are added up, ``change += alpha d`` and ``carried += alpha B d`` in one pass, and the right-hand
side of the KSP is not looked at. B may be the product by levels, right to some percent in a part of the time: no
more than a part of the residual is to go, and who adds up the changes multiplies them anew (defect correction, as in
`app.methods.free`). The norm is that of the preconditioned residual, about the error of w; directions are
those of flexible CG, the preconditioner need not be quite symmetric. By options of -lcp_type primal only::

    -ksp_type python -ksp_python_type app.methods.periodic.cg.CarryingCG
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import njit
from app.halfspace.operator import get_operator
from app.methods.periodic.operator import InverseOperator
from app.multigrid.ksp_context import KspContext
from app.parallel.reductions import add_row, add_tuples, njit_reassoc


@njit_reassoc
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
    sums = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(d.shape[0]):
        sums = add_tuples(sums, _dots_row(d[j], q[j], p[j], free[j]))
    return sums


@njit_reassoc
def _first_step_row(p, d, q, alpha, left, change):
    for i in range(p.size):
        change[i] = alpha * d[i]
        left[i] = p[i] + alpha * q[i]


@njit_reassoc
def _first_step(p, d, q, alpha, left, change):
    """change = alpha d, left = p + alpha q."""
    for j in range(p.shape[0]):
        _first_step_row(p[j], d[j], q[j], alpha, left[j], change[j])


@njit_reassoc
def _step(d, q, alpha, left, change):
    """change += alpha d, left += alpha q."""
    for j in range(d.shape[0]):
        add_row(change[j], alpha, d[j])
        add_row(left[j], alpha, q[j])


@njit_reassoc
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
    sums = 0.0, 0.0
    for j in range(z.shape[0]):
        sums = add_tuples(sums, _normed_row(z[j], q[j]))
    return sums


@njit_reassoc
def _direct_row(d, z, beta):
    for i in range(d.size):
        d[i] = z[i] + beta * d[i]


@njit_reassoc
def _direct(d, z, beta):
    """d = z + beta d."""
    for j in range(d.shape[0]):
        _direct_row(d[j], z[j], beta)


class CarryingCG(KspContext):
    """KSP context; its operator must be an `InverseOperator`, its PC a `TwoGrid`.

    Collective. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*. The preconditioner is applied to p as it is; it
    looks at the free cells only, and leaves the others zero. For the test of -ksp_rtol the preconditioned norm is
    estimated from how much smaller p on the free cells is: it saves the last application.

    x is not looked at, nor is `pressure` changed: `change` and `carried` are made, as precise as the products. That is
    enough for some contact sets, and who adds them up goes through w and p anyway.

    Attributes
    ----------
    multilevel_share : float
        Share of the residual of p down to which B is multiplied by levels; 0: by FFT. Set by the caller.
    carried : ndarray, shape (local rows, nx)
        A place for what p becomes [N/mm2], set by the caller: in double precision if B is by FFT.
    pressure : Vec
        p on entry; set by the caller.
    goes_on : bool
        Begin with `carried` in place of p, and add to `change`; set by the caller.
    change : ndarray, shape (local rows, nx)
        By how much w is to change, after a solve [mm].
    residual, doubt : float
        Norm of the preconditioned residual after the last solve, and by how much it may be wrong [mm].
    scratch : ndarray, shape (local rows, nx)
        To be used by others between solves; in single precision `change` is in it. So may `direction` and `product`,
        in the operator's precision.
    """

    norm_type = PETSc.KSP.NormType.PRECONDITIONED
    pressure, carried, goes_on = None, None, False
    multilevel_share = residual = doubt = 0.0

    def setUp(self, ksp):
        """Make the work arrays: z and `change` in a place for doubles, d, q."""
        if ksp.getNormType() != PETSc.KSP.NormType.PRECONDITIONED:
            raise ValueError("-ksp_norm_type: -lcp_type primal needs preconditioned")
        mat = ksp.getOperators()[0]
        self._operator = operator = get_operator(mat, InverseOperator, "CarryingCG")
        shape, dtype = operator.local_shape, operator.dtype
        self.scratch = np.zeros(shape)
        whole, cells = self.scratch.reshape(-1).view(dtype), self.scratch.size
        self._z = whole[:cells].reshape(shape)
        self.change = whole[cells:].reshape(shape) if whole.size > cells else np.zeros(shape, dtype)
        self.direction = np.zeros(shape, dtype)
        [lent] = operator.spare_fields(dtype)
        self.product = np.zeros(shape, dtype) if lent is None else lent

    def reset(self, ksp):
        """Free the work arrays; the next set-up makes others."""
        self.scratch = self._z = self.change = self.direction = self.product = None

    def solve(self, ksp, b, x):
        """Find by how much w is to change."""
        operator, smooth = self._operator, ksp.getPC().getPythonContext().smooth
        d, q, z, kind = self.direction, self.product, self._z, operator.dtype.type
        multiply = operator.multilevel_pressure if self.multilevel_share else operator.pressure
        left = self.carried if self.goes_on else self._read(self.pressure)
        iteration, max_it = 0, ksp.getTolerances()[3]
        smooth(left, z)
        beta, norm = 0.0, sqrt(self._sum(_normed(z, z))[0])
        if not self.goes_on:
            self.doubt = self.multilevel_share * norm
        reason = self._report(ksp, 0, norm)
        while not reason and iteration < max_it:
            if iteration:
                _direct(d, z, kind(beta))
            else:
                d[...] = z
            operator.products += 1
            multiply(d, q)
            dq, dp, pp, pq, qq = self._sum(_dots(d, q, left, operator.mask))
            if not dq > 0:
                reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                break
            alpha = -dp / dq
            if left is self.carried:
                _step(d, q, kind(alpha), left, self.change)
            else:
                _first_step(left, d, q, kind(alpha), self.carried, self.change)
                left = self.carried
            iteration += 1
            share = (pp + alpha * (2 * pq + alpha * qq)) / pp if pp else 0.0  # of p.p on the free cells
            about = norm * sqrt(max(share, 0.0))
            if ksp.callConvergenceTest(iteration, about) == PETSc.KSP.ConvergedReason.CONVERGED_RTOL:
                norm, reason = about, self._report(ksp, iteration, about)
                break
            smooth(left, z)
            squares, zq = self._sum(_normed(z, q))
            beta, norm = -zq / dq, sqrt(squares)
            reason = self._report(ksp, iteration, norm)
            if not reason and norm <= self.doubt:
                reason = PETSc.KSP.ConvergedReason.CONVERGED_RTOL
        if left is not self.carried:
            self.carried[...], self.change[...], self.doubt = left, 0, 0.0
        PETSc.Log.logFlops(20 * iteration * d.size)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the pressure of all cells up to date\n")
