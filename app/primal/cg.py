"""Conjugate gradients for the displacement of the free cells, that carry the pressure along.

``p = B w + mean pressure`` is to vanish on the free cells O. So p is all there is of a residual: it is kept on all
cells, ``w += alpha d`` and ``p += alpha B d`` in one pass, and the right-hand side of the KSP is not looked at. The
norm is that of the preconditioned residual, about the error of w; directions are those of flexible CG, the
preconditioner need not be quite symmetric. By options of -lcp_type primal only::

    -ksp_type python -ksp_python_type app.primal.cg.CarryingCG -ksp_norm_type preconditioned
"""

from __future__ import annotations

from functools import cache

import numpy as np
from petsc4py import PETSc

from app.compiled import njit
from app.fast.tracking_cg import KspContext
from app.halfspace.operator import context_of
from app.halfspace.reductions import any_order
from app.primal.operator import InverseOperator


@any_order
def _dots_row(d, q, p):
    first, second = 0.0, 0.0
    for i in range(d.size):
        value = np.float64(d[i])
        first += value * q[i]
        second += value * p[i]
    return first, second


@njit()
def _dots(d, q, p):
    """d.q and d.p for a d that vanishes outside O."""
    first, second = 0.0, 0.0
    for j in range(d.shape[0]):
        here = _dots_row(d[j], q[j], p[j])
        first += here[0]
        second += here[1]
    return first, second


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
        squares += z[i] * z[i]
        product += z[i] * q[i]
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
def _warm_up(dtype):
    """Load the compiled loops now, not in the first iteration."""
    field = np.zeros((0, 0))
    low, fixed = field.astype(dtype), field.view()
    fixed.flags.writeable = False
    _dots(low, low, field)
    _step(field, field, low, low, 0.0)
    _normed(fixed, low)
    _direct(low, fixed, dtype.type(0))


class CarryingCG(KspContext):
    """KSP context; its operator must be an `InverseOperator`. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*.

    Collective.

    The preconditioner is applied to p as it is; it must look at the free cells only, and leave the others zero.

    Attributes
    ----------
    pressure : Vec
        p on entry and on exit; set by the caller. The initial guess is always taken for w.
    residual : float
        Norm of the preconditioned residual after the last solve [mm].
    preconditioned : ndarray, shape (local rows, nx)
        This, to be used by others between solves; so may `direction` and `product`.
    """

    pressure = None
    residual = 0.0
    _z = None

    def setUp(self, ksp):
        """Make the work arrays: z, and in the operator's precision d and q."""
        if ksp.getNormType() != PETSc.KSP.NormType.PRECONDITIONED:
            raise ValueError("-ksp_norm_type: -lcp_type primal needs preconditioned")
        mat = ksp.getOperators()[0]
        self._operator = operator = context_of(mat, InverseOperator, "CarryingCG")
        shape = operator.local_shape
        self.preconditioned = np.zeros(shape)
        self._z = PETSc.Vec().createWithArray(self.preconditioned.reshape(-1), comm=mat.getComm())
        self.direction = np.zeros(shape, operator.dtype)
        [lent] = operator.influence.scratch_beside_product(operator.dtype)
        self.product = np.zeros(shape, operator.dtype) if lent is None else lent
        _warm_up(operator.dtype)

    def solve(self, ksp, b, x):
        """Improve x, which is w."""
        operator, pc, d, q = self._operator, ksp.getPC(), self.direction, self.product
        shape = operator.local_shape
        iteration, max_it = 0, ksp.getTolerances()[3]
        pc.apply(self.pressure, self._z)
        beta, norm = 0.0, float(np.sqrt(self._sum(_normed(self._read(self._z), q))[0]))
        d[...] = 0
        reason = self._report(ksp, 0, norm)
        while not reason and iteration < max_it:
            _direct(d, self._read(self._z), d.dtype.type(beta))
            operator.products += 1
            operator.displacement(d, q)
            with self.pressure as pressure, x as displacement:
                p, w = pressure.reshape(shape), displacement.reshape(shape)
                dq, dp = self._sum(_dots(d, q, p))
                if not dq > 0:
                    reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                    break
                _step(w, p, d, q, -dp / dq)
            pc.apply(self.pressure, self._z)
            squares, zq = self._sum(_normed(self._read(self._z), q))
            beta, norm = -zq / dq, float(np.sqrt(squares))
            iteration += 1
            reason = self._report(ksp, iteration, norm)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def destroy(self, ksp):
        """Free the work vector."""
        if self._z is not None:
            self._z.destroy()

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the pressure of all cells up to date\n")
