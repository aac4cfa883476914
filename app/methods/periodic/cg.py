"""Conjugate gradients for the displacement of free cells.

The pressure ``p = B w + mean pressure`` must vanish on the free cells O, so p is the residual. Here w is the
displacement minus the approach, and B is the inverse of A. A step alpha d along the direction d updates p on all cells
and the change of w in one pass: ``change += alpha d``, ``carried += alpha B d``. The right-hand side of the KSP is not
used.

B may be a multilevel product, which has an error of some percent. Then the solve reduces the residual only by a part,
and the caller recomputes p from the change (defect correction, as in `app.methods.free`). The norm is taken of the
preconditioned residual, which is about the error of w. Directions are chosen as in flexible CG, because the
preconditioner is not quite symmetric. This KSP can only be used by the options of -lcp_type primal::

    -ksp_type python -ksp_python_type app.methods.periodic.cg.CarryingCG
"""

from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import as_writable, njit
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
    """Return the scalar products of a step of CG.

    They are d.q and d.p over all cells, and p.p, p.q and q.q over free cells. d is the direction, q its product with
    the matrix B, and p the pressure.
    """
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
    """Make the first CG step along direction d.

    q is the pressure by the displacement d. `change` is set to alpha d, and the updated pressure `left` to p + alpha q.
    """
    for j in range(p.shape[0]):
        _first_step_row(p[j], d[j], q[j], alpha, left[j], change[j])


@njit_reassoc
def _step(d, q, alpha, left, change):
    """Make a further CG step along direction d.

    q is the pressure by the displacement d. alpha d is added to `change`, and alpha q to the updated pressure `left`.
    """
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
    """Return scalar products z.z and z.q of two fields."""
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
    """Compute the direction d = z + beta d, in place."""
    for j in range(d.shape[0]):
        _direct_row(d[j], z[j], beta)


class CarryingCG(KspContext):
    """Conjugate gradients that update p on all cells. Collective.

    The class is a KSP context for an `InverseOperator` and a `TwoGrid`. The `TwoGrid` reads p only on the free cells,
    and returns zero on other cells. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*. For -ksp_rtol the norm is
    estimated from the reduction of p on the free cells, which saves the last application of the preconditioner.

    The solution x of the KSP is not used, and `pressure` is not changed. The results are `change` and `carried`, in the
    precision of the products. This precision is enough for a few contact sets; then the caller recomputes p.

    Attributes
    ----------
    multilevel_share : float
        Products are multilevel until the residual has fallen to this fraction; if 0, all are by FFT. Set by the caller.
    carried : ndarray, shape (local rows, nx)
        Updated p [N/mm2]. The caller sets its storage, in double precision if B is by FFT.
    pressure : Vec
        p at the start of the solve. Set by the caller.
    resumes : bool
        True to start from `carried` instead of `pressure`, and to add to `change`. Set by the caller.
    change : ndarray, shape (local rows, nx)
        Change of w [mm].
    residual : float
        Norm of the preconditioned residual after the last solve [mm].
    uncertainty : float
        Bound of the error of `residual` due to multilevel products [mm]; 0 with FFT.
    scratch : ndarray, shape (local rows, nx)
        Work array in double precision, free for other use between solves. In single precision it contains `change`.
    direction, product : ndarray, shape (local rows, nx)
        Direction d and B d in the operator's precision, free for other use between solves.
    """

    norm_type = PETSc.KSP.NormType.PRECONDITIONED
    pressure, carried, resumes = None, None, False
    multilevel_share = residual = uncertainty = 0.0

    def setUp(self, ksp):
        """Make the work arrays.

        In single precision the preconditioned residual z and `change` share the memory of `scratch`.
        """
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
        """Free the work arrays."""
        self.scratch = self._z = self.change = self.direction = self.product = None

    def solve(self, ksp, b, x):
        """Reduce the pressure p on free cells by CG.

        Store the change of the displacement in `change`, and the new p in `carried`.
        """
        operator, smooth = self._operator, ksp.getPC().getPythonContext().smooth
        d, q, z, kind = self.direction, self.product, self._z, operator.dtype.type
        multiply = operator.multilevel_pressure if self.multilevel_share else operator.pressure
        left = self.carried if self.resumes else as_writable(self._read(self.pressure))
        iteration, max_it = 0, ksp.getTolerances()[3]
        smooth(left, z)
        beta, norm = 0.0, sqrt(self._sum(_normed(z, z))[0])
        if not self.resumes:
            self.uncertainty = self.multilevel_share * norm
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
            estimate = norm * sqrt(max(share, 0.0))
            if ksp.callConvergenceTest(iteration, estimate) == PETSc.KSP.ConvergedReason.CONVERGED_RTOL:
                norm, reason = estimate, self._report(ksp, iteration, estimate)
                break
            smooth(left, z)
            squares, zq = self._sum(_normed(z, q))
            beta, norm = -zq / dq, sqrt(squares)
            reason = self._report(ksp, iteration, norm)
            if not reason and norm <= self.uncertainty:
                reason = PETSc.KSP.ConvergedReason.CONVERGED_RTOL
        if left is not self.carried:
            self.carried[...], self.change[...], self.uncertainty = left, 0, 0.0
        PETSc.Log.logFlops(20 * iteration * d.size)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the pressure of all cells up to date\n")
