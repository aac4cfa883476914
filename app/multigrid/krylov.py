"""Conjugate gradients that carry the displacement along.

The convolution computes A d on *all* cells although CG only needs it on C. `TrackingCG` keeps it: ``u += alpha A d``
along with ``p += alpha d``, so that after the solve the displacement everywhere is known without another product, and
neither the first residual nor the search for new contact costs one. Usable from options::

    -ksp_type python -ksp_python_type app.multigrid.krylov.TrackingCG -ksp_norm_type unpreconditioned
"""

from __future__ import annotations

from functools import cache

import numba
import numpy as np
from petsc4py import PETSc

from app.halfspace.reductions import any_order, sum_over
from app.multigrid.circulant import Circulant

# r and d vanish outside C; z and q need not. Rows are gone through from their first to their last cell of C.


@any_order
def _add_row(a, scale, b):
    for i in range(a.size):
        a[i] += scale * b[i]


@any_order
def _residual_row(r, scale, q, contact):
    squares, total = 0.0, 0.0
    for i in range(r.size):
        value = r[i] - scale * q[i]
        value = value if contact[i] else 0.0
        r[i] = value
        squares += value * value
        total += value
    return squares, total


@any_order
def _direction_row(d, z, beta, contact):
    for i in range(d.size):
        value = z[i] + beta * d[i]
        d[i] = value if contact[i] else 0


@any_order
def _dot_row(a, b, contact):
    total = 0.0
    for i in range(a.size):
        value = a[i] * b[i]
        total += value if contact[i] else 0.0
    return total


@any_order
def _dots_row(a, b, c):
    first, second = 0.0, 0.0
    for i in range(a.size):
        value = np.float64(a[i])
        first += value * b[i]
        second += value * c[i]
    return first, second


@any_order
def _sum_row(a, contact):
    total = 0.0
    for i in range(a.size):
        value = a[i]
        total += value if contact[i] else 0.0
    return total


@any_order
def _shift_row(r, shift, contact):
    for i in range(r.size):
        r[i] -= shift if contact[i] else 0.0


@any_order
def _advance(p, u, r, d, q, contact, spans, alpha):
    """p += alpha d, u += alpha q, and r -= alpha q on C; return r.r and the sum of r."""
    squares, total = 0.0, 0.0
    for j in range(p.shape[0]):
        _add_row(u[j], alpha, q[j])
        span = slice(spans[j, 0], spans[j, 1])
        _add_row(p[j, span], alpha, d[j, span])
        here = _residual_row(r[j, span], alpha, q[j, span], contact[j, span])
        squares += here[0]
        total += here[1]
    return squares, total


@any_order
def _first_residual(r, u, contact, spans):
    """r -= u on C; return r.r, the sum of r and the number of cells."""
    squares, total, cells = 0.0, 0.0, 0
    for j in range(r.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        here = _residual_row(r[j, span], 1.0, u[j, span], contact[j, span])
        squares += here[0]
        total += here[1]
        cells += np.sum(contact[j, span])
    return squares, total, cells


@any_order
def _direction(d, z, beta, contact, spans):
    """d = z + beta d on C."""
    for j in range(d.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        _direction_row(d[j, span], z[j, span], beta, contact[j, span])


@any_order
def _dot(a, b, contact, spans):
    """a.b over C."""
    total = 0.0
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        total += _dot_row(a[j, span], b[j, span], contact[j, span])
    return total


@any_order
def _dots(a, b, c, spans):
    """a.b and a.c for an `a` that vanishes outside C."""
    first, second = 0.0, 0.0
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        here = _dots_row(a[j, span], b[j, span], c[j, span])
        first += here[0]
        second += here[1]
    return first, second


@any_order
def _total(a, contact, spans):
    """Sum of a over C."""
    total = 0.0
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        total += _sum_row(a[j, span], contact[j, span])
    return total


@any_order
def _add_on_row(a, scale, b, contact):
    for i in range(a.size):
        a[i] += scale * b[i] if contact[i] else 0.0


@any_order
def _add_on(a, scale, b, contact, spans):
    """a += scale b on C."""
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        _add_on_row(a[j, span], scale, b[j, span], contact[j, span])


@any_order
def _shift(r, shift, contact, spans):
    """r -= shift on C."""
    for j in range(r.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        _shift_row(r[j, span], shift, contact[j, span])


@numba.njit(cache=True)
def _find_spans(contact, spans):
    """First and last but one column of C in each row."""
    for j in range(contact.shape[0]):
        a, b = 0, contact.shape[1]
        while b > 0 and not contact[j, b - 1]:
            b -= 1
        while a < b and not contact[j, a]:
            a += 1
        spans[j, 0], spans[j, 1] = a, b


@cache
def _load_loops(dtype):
    """Load the compiled loops now, not in the first iteration."""
    field, mask, spans = np.zeros((0, 0)), np.zeros((0, 0), bool), np.zeros((0, 2), np.int64)
    low = field.astype(dtype)
    _find_spans(mask, spans)
    _first_residual(field, field, mask, spans)
    for z in (field, low):
        _add_on(field, 0.0, z, mask, spans)
        _dot(field, z, mask, spans)
        _direction(low, z, dtype.type(0), mask, spans)
    _dots(low, low, field, spans)
    _advance(field, field, field, low, low, mask, spans, 0.0)
    _shift(field, 0.0, mask, spans)
    _total(low, mask, spans)
    _add_on(low, dtype.type(0), low, mask, spans)


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

    work = displacement = None
    balance = False
    resume = False
    shift = 0.0
    residual = 0.0

    def setUp(self, ksp):
        """Make the work vectors: z and q, never needed at the same time, are one; d is in the operator's precision."""
        mat = ksp.getOperators()[0]
        operator = mat.getPythonContext()
        self.work = mat.createVecRight()
        self._d = np.zeros(operator.local_shape, operator.dtype)
        self._spans = np.zeros((operator.local_shape[0], 2), np.int64)
        self._ones = None
        self._ones_cells = 0
        self._previous = 0.0
        _load_loops(operator.dtype)

    def solve(self, ksp, b, x):
        """Improve x."""
        operator = ksp.getOperators()[0].getPythonContext()
        contact, shape, u = operator.mask, operator.local_shape, self.displacement
        pc, d, spans = ksp.getPC(), self._d, self._spans
        rtol, atol, _, max_it = ksp.getTolerances()
        self._operator, self.shift = operator, 0.0
        _find_spans(contact, spans)
        with b as right:
            squares, total, cells = self._sum(_first_residual(right.reshape(shape), u, contact, spans))
        self._cells = max(cells, 1.0)
        if self.balance:
            squares = self._project(b, squares, total)
        norm = first = np.sqrt(max(squares, 0.0))
        iteration = 0
        if not self.resume:
            self._previous = 0.0
            d[...] = 0  # outside the new spans too
        ksp.its, ksp.norm = 0, norm
        ksp.monitor(0, norm)
        while norm > atol and (iteration == 0 or norm > rtol * first) and iteration < max_it:
            z = self._precondition(pc, b)
            if self.balance:
                self._make_sum_zero(pc, z)
            with b as right, self.work as memory, x as solution:
                r, p = right.reshape(shape), solution.reshape(shape)
                rz = self._sum([_dot(r, z, contact, spans)])[0]
                beta = rz / self._previous if self._previous > self._restart * rz else 0.0
                _direction(d, z, d.dtype.type(beta), contact, spans)
                operator.products += 1
                q = self._low(memory)
                operator.displacement(d, q)
                dq, rd = self._sum(_dots(d, q, r, spans))
                if not dq > 0:
                    self.residual = norm
                    ksp.setConvergedReason(PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT)
                    return
                squares, total = self._sum(_advance(p, u, r, d, q, contact, spans, rd / dq))
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

    def correct(self, ksp, r, x, step):
        """Take a step of steepest descent: x += step M r on C. Collective."""
        contact = ksp.getOperators()[0].getPythonContext().mask
        self._previous = 0.0  # after this the last search direction is worth nothing
        _find_spans(contact, self._spans)
        z = self._precondition(ksp.getPC(), r)
        with x as solution:
            _add_on(solution.reshape(z.shape), step, z, contact, self._spans)

    def foresee(self, ksp, r):
        """Return what reducing the residual r will add to u around C, about; None if nobody knows. Collective.

        In the memory of the work vector; anything on C.
        """
        context = self._circulant(ksp.getPC())
        if context is None or context.extension is None:
            return None
        with r as right, self.work as memory:
            z = self._low(memory)
            context.extend(right.reshape(z.shape), z)
        return z

    def _low(self, memory):
        """Return a field in the operator's precision in the memory of a Vec."""
        return memory.view(self._d.dtype)[: self._d.size].reshape(self._d.shape)

    def _circulant(self, pc):
        context = pc.getPythonContext() if pc.getType() == PETSc.PC.Type.PYTHON else None
        return context if isinstance(context, Circulant) else None

    def _precondition(self, pc, r):
        """Return M r, in the memory of the work vector; anything outside C."""
        context = self._circulant(pc)
        if context is not None:
            with r as right, self.work as memory:
                z = self._low(memory)
                context.apply_to(right.reshape(z.shape), z)
            return z
        pc.apply(r, self.work)
        with self.work as memory:
            return memory.reshape(self._d.shape)

    def _project(self, b, squares, total):
        """Make the residual orthogonal to the constants; return its new sum of squares."""
        mean = total / self._cells
        with b as right:
            _shift(right.reshape(self._d.shape), mean, self._operator.mask, self._spans)
        self.shift -= mean
        return squares - mean * total

    def _make_sum_zero(self, pc, z):
        """Add a multiple of M 1 to z."""
        contact, spans = self._operator.mask, self._spans
        if self._ones is None or abs(self._cells - self._ones_cells) > 0.2 * self._cells:
            saved = z.copy()
            ones = self.work.duplicate()
            ones.setArray(contact.reshape(-1).astype(float))
            self._ones = self._precondition(pc, ones) * contact  # used on other sets too
            ones.destroy()
            z[...] = saved
            self._ones_cells = self._cells
        sum_z, sum_y = self._sum([_total(z, contact, spans), _total(self._ones, contact, spans)])
        if sum_y > 0:
            _add_on(z, z.dtype.type(-sum_z / sum_y), self._ones, contact, spans)

    def _sum(self, values):
        return sum_over(self._operator.comm, values)

    def destroy(self, ksp):
        """Free the work vector."""
        if self.work is not None:
            self.work.destroy()

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients that keep the displacement of all cells up to date\n")
