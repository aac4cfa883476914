"""Conjugate gradients that carry the displacement along.

The convolution computes A d on *all* cells although CG only needs it on C. `TrackingCG` keeps it: ``u += alpha A d``
along with ``p += alpha d``, so that after the solve the displacement everywhere is known without another product, and
neither the first residual nor the search for new contact costs one. Usable from options::

    -ksp_type python -ksp_python_type app.multigrid.krylov.TrackingCG -ksp_norm_type unpreconditioned
"""

from __future__ import annotations

import numba
import numpy as np
from petsc4py import PETSc


@numba.njit(cache=True)
def _advance(p, u, r, d, q, contact, alpha):
    """p += alpha d, u += alpha q, and r -= alpha q on C; return r.r and the sum of r."""
    squares, total = 0.0, 0.0
    for j in range(p.shape[0]):
        row, plain = 0.0, 0.0
        for i in range(p.shape[1]):
            u[j, i] += alpha * q[j, i]
            if contact[j, i]:
                p[j, i] += alpha * d[j, i]
                r[j, i] -= alpha * q[j, i]
                row += r[j, i] * r[j, i]
                plain += r[j, i]
        squares += row
        total += plain
    return squares, total


@numba.njit(cache=True)
def _direction(d, z, beta):
    """d = z + beta d."""
    for j in range(d.shape[0]):
        for i in range(d.shape[1]):
            d[j, i] = z[j, i] + beta * d[j, i]


@numba.njit(cache=True)
def _add_on(a, scale, b, contact):
    """a += scale b on C."""
    for j in range(a.shape[0]):
        for i in range(a.shape[1]):
            if contact[j, i]:
                a[j, i] += scale * b[j, i]


@numba.njit(cache=True)
def _shift(r, shift, contact):
    """r -= shift on C."""
    for j in range(r.shape[0]):
        for i in range(r.shape[1]):
            if contact[j, i]:
                r[j, i] -= shift


@numba.njit(cache=True)
def _dots(a, b, c, contact):
    """a.b and a.c over C."""
    first, second = 0.0, 0.0
    for j in range(a.shape[0]):
        row, other = 0.0, 0.0
        for i in range(a.shape[1]):
            if contact[j, i]:
                row += a[j, i] * b[j, i]
                other += a[j, i] * c[j, i]
        first += row
        second += other
    return first, second


@numba.njit(cache=True)
def _first_residual(r, u, contact):
    """r -= u on C; return r.r, the sum of r and the number of cells."""
    squares, total, cells = 0.0, 0.0, 0
    for j in range(r.shape[0]):
        row, plain = 0.0, 0.0
        for i in range(r.shape[1]):
            if contact[j, i]:
                r[j, i] -= u[j, i]
                row += r[j, i] * r[j, i]
                plain += r[j, i]
                cells += 1
        squares += row
        total += plain
    return squares, total, cells


class TrackingCG:
    """KSP context; its operator must be an `InfluenceOperator`. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*.

    The residual it tests is the true one, relative to the first: stop at ``max(rtol ||r0||, atol)``. `b` holds the
    residual on exit.

    With `balance` the sum of x is kept as it is, and b may be shifted by a constant on C instead: that is contact
    under a given load, the shift being the change of the approach. Residual and preconditioned residual are made
    orthogonal to the constants, the latter by a multiple of ``M 1``.

    Attributes
    ----------
    displacement : ndarray, shape (local rows, nx)
        u = A x on entry and on exit; set by the caller.
    balance : bool
    resume : bool
        Nothing has changed since the last solve: go on with its search direction.
    shift : float
        What was added to b on C by the last solve.
    residual : float
        Norm of the residual after the last solve.
    """

    _restart = 1e-2  # a residual that grows this much says that the old direction is none: start again

    displacement = None
    balance = False
    resume = False
    shift = 0.0
    residual = 0.0

    def setUp(self, ksp):
        """Make two work vectors."""
        self.work, self._d = ksp.getOperators()[0].createVecs()
        self._ones = None
        self._ones_cells = 0
        self._previous = 0.0
        # Load the compiled loops now, not in the first iteration.
        field, mask = np.zeros((0, 0)), np.zeros((0, 0), bool)
        _advance(field, field, field, field, field, mask, 0.0)
        _direction(field, field, 0.0)
        _dots(field, field, field, mask)
        _first_residual(field, field, mask)
        _shift(field, 0.0, mask)

    def solve(self, ksp, b, x):
        """Improve x."""
        operator = ksp.getOperators()[0].getPythonContext()
        contact, shape, u = operator.mask, operator.local_shape, self.displacement
        pc, z, d = ksp.getPC(), self.work, self._d
        rtol, atol, _, max_it = ksp.getTolerances()
        self._operator, self.shift = operator, 0.0
        with b as right:
            squares, total, cells = self._sum(_first_residual(right.reshape(shape), u, contact))
        self._cells = max(cells, 1.0)
        if self.balance:
            squares = self._project(b, squares, total)
        norm = first = np.sqrt(max(squares, 0.0))
        iteration = 0
        if not self.resume:
            self._previous = 0.0
        ksp.its, ksp.norm = 0, norm
        ksp.monitor(0, norm)
        while norm > atol and (iteration == 0 or norm > rtol * first) and iteration < max_it:
            pc.apply(b, z)
            if self.balance:
                self._make_sum_zero(pc, z)
            with b as right, z as preconditioned, d as direction:
                r, s, v = (a.reshape(shape) for a in (right, preconditioned, direction))
                rz = self._sum(_dots(r, s, s, contact)[:1])[0]
                _direction(v, s, rz / self._previous if self._previous > self._restart * rz else 0.0)
                operator.products += 1
                operator.displacement(v, s)  # z is free now: q = A d
                dq, rd = self._sum(_dots(v, s, r, contact))
                if not dq > 0:
                    ksp.setConvergedReason(PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT)
                    return
                with x as solution:
                    squares, total = self._sum(
                        _advance(solution.reshape(shape), u, r, v, s, contact, rd / dq)
                    )
            if self.balance:
                squares = self._project(b, squares, total)
            norm = np.sqrt(max(squares, 0.0))
            self._previous = rz
            iteration += 1
            ksp.its, ksp.norm = iteration, norm
            ksp.monitor(iteration, norm)
        self.residual = norm
        reasons = PETSc.KSP.ConvergedReason
        if norm <= atol:
            ksp.setConvergedReason(reasons.CONVERGED_ATOL)
        else:
            ksp.setConvergedReason(
                reasons.CONVERGED_RTOL if norm <= rtol * first else reasons.DIVERGED_MAX_IT
            )

    def _project(self, b, squares, total):
        """Make the residual orthogonal to the constants; return its new sum of squares."""
        mean = total / self._cells
        with b as right:
            _shift(right.reshape(self._operator.local_shape), mean, self._operator.mask)
        self.shift -= mean
        return squares - mean * total

    def _make_sum_zero(self, pc, z):
        """Add a multiple of M 1 to z."""
        operator = self._operator
        contact, shape = operator.mask, operator.local_shape
        if self._ones is None or abs(self._cells - self._ones_cells) > 0.2 * self._cells:
            if self._ones is None:
                self._ones = z.duplicate()
            ones = z.duplicate()
            ones.setArray(contact.reshape(-1).astype(float))
            pc.apply(ones, self._ones)
            ones.destroy()
            self._ones_cells = self._cells
        with z as preconditioned:
            s = preconditioned.reshape(shape)
            y = self._ones.getArray(readonly=True).reshape(shape)
            sum_z, sum_y = self._sum([np.sum(s, where=contact), np.sum(y, where=contact)])
            if sum_y > 0:
                _add_on(s, -sum_z / sum_y, y, contact)

    def _sum(self, values):
        values = np.asarray(values, dtype=float)
        if self._operator.comm is not None:
            self._operator.comm.Allreduce(values.copy(), values)
        return values

    def destroy(self, ksp):
        """Free the work vectors."""
        for vec in (self.work, self._d, self._ones):
            if vec is not None:
                vec.destroy()

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the displacement of all cells up to date\n")
