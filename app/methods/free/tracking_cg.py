"""Conjugate gradients that start from a known displacement, and leave what they changed.

The first residual is -(h + u), and u is there: it costs no product. What the solve adds to x is kept as `change`, for
who wants to know what it adds to u. And what stands for A may be nearly A only (`multiply`).
Usable from options::

    -ksp_type python -ksp_python_type app.methods.free.tracking_cg.TrackingCG
"""

from __future__ import annotations

from functools import partial
from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.contact.kernels import gap
from app.halfspace.mat_methods import check_unscaled
from app.halfspace.operator import InfluenceOperator, get_operator, wrap_vec
from app.multigrid.ksp_context import KspContext
from app.parallel.reductions import add_row, add_tuples, njit_reassoc, nonzero_span

# So much may be left of r.r before it is summed anew, by the digits of r.
MIN_CARRIED_SQUARES = {np.dtype(np.float64): 1e-8, np.dtype(np.float32): 1e-6}

# r and d vanish outside C; z and q need not. Rows are gone through from their first to their last cell of C.


@njit_reassoc
def _residual_row(b, shift, u, contact, r):
    squares = 0.0
    for i in range(r.size):
        value = -gap(u[i], b[i], shift)
        value = value if contact[i] else 0.0
        r[i] = value
        squares += value * value
    return squares


@njit_reassoc
def _reduce_row(r, scale, q, contact):
    squares = 0.0
    for i in range(r.size):
        value = r[i] - scale * q[i]
        value = value if contact[i] else 0.0
        r[i] = value
        squares += value * value
    return squares


@njit_reassoc
def _direction_row(d, z, beta, contact):
    for i in range(d.size):
        value = z[i] + beta * d[i]
        d[i] = value if contact[i] else 0


@njit_reassoc
def _dot_row(a, b, contact):
    total = 0.0
    for i in range(a.size):
        value = np.float64(a[i]) * b[i]
        total += value if contact[i] else 0.0
    return total


@njit_reassoc
def _dots_row(d, q, r, contact):
    dq, dr, qr, qq = 0.0, 0.0, 0.0, 0.0
    for i in range(d.size):
        direction, product = np.float64(d[i]), np.float64(q[i])
        dq += direction * product
        dr += direction * r[i]
        product = product if contact[i] else 0.0
        qr += product * r[i]
        qq += product * product
    return dq, dr, qr, qq


@njit_reassoc
def _first_residual(b, shift, u, contact, spans, r):
    """r = b + shift - u on C, 0 elsewhere, and each row's first column of C and one past the last.

    Return r.r, and the number of cells between these columns.
    """
    squares, cells = 0.0, 0
    for j in range(r.shape[0]):
        first, last = nonzero_span(contact[j])
        spans[j, 0], spans[j, 1] = first, last
        r[j] = 0
        span = slice(first, last)
        squares += _residual_row(b[j, span], shift, u[j, span], contact[j, span], r[j, span])
        cells += last - first
    return squares, cells


@njit_reassoc
def _advance(change, r, d, q, contact, spans, alpha):
    """change += alpha d, r -= alpha q on C; return r.r."""
    squares = 0.0
    for j in range(r.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        add_row(change[j, span], alpha, d[j, span])
        squares += _reduce_row(r[j, span], alpha, q[j, span], contact[j, span])
    return squares


@njit_reassoc
def add(a, scale, b):
    """a += scale b."""
    for j in range(a.shape[0]):
        add_row(a[j], scale, b[j])


@njit_reassoc
def _direction(d, z, beta, contact, spans):
    """d = z + beta d on C."""
    for j in range(d.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        _direction_row(d[j, span], z[j, span], beta, contact[j, span])


@njit_reassoc
def _dot(a, b, contact, spans):
    """a.b over C."""
    total = 0.0
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        total += _dot_row(a[j, span], b[j, span], contact[j, span])
    return total


@njit_reassoc
def _dots(d, q, r, contact, spans):
    """d.q, d.r, q.r and q.q over C."""
    sums = 0.0, 0.0, 0.0, 0.0
    for j in range(d.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        sums = add_tuples(sums, _dots_row(d[j, span], q[j, span], r[j, span], contact[j, span]))
    return sums


class TrackingCG(KspContext):
    """KSP context; its operator must be an `InfluenceOperator`. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*.

    As a KSP it solves C A C x = C b.

    Attributes
    ----------
    displacement : ndarray, shape (local rows, nx), or None
        u = A x on entry; set by the caller, who also says that x is the initial guess.
    shift : float
        Constant that is added to b. Set by the caller.
    first_norm : float or None
        Norm of the residual on entry, if it is known. Set by the caller, for one solve.
    multiply : callable
        ``multiply(d, q)`` computes q = A d, or nearly so. To be replaced by the caller.
    residual : float
        Norm of the residual after the last solve, as these products have it.
    change : ndarray, shape (local rows, nx)
        What the last solve has added to x, in the operator's precision.
    work, product : ndarray, shape (local rows, nx)
        z, and in its place q, in the operator's precision. To be used by others between solves.
    """

    displacement = first_norm = None
    residual = shift = 0.0
    _z = _r = _d = _change = None

    def setUp(self, ksp):
        """Make the work arrays: z and q, never needed at the same time, are one."""
        mat = ksp.getOperators()[0]
        self._operator = operator = get_operator(mat, InfluenceOperator, "TrackingCG")
        check_unscaled(mat, "TrackingCG")
        self.multiply = operator.displacement
        shape = operator.local_shape
        work, self._lent = operator.spare_fields(np.float64, operator.dtype)
        self.work = np.zeros(shape) if work is None else work
        self._z = wrap_vec(self.work, operator)
        self.product = self.work.reshape(-1).view(operator.dtype)[: self.work.size].reshape(shape)  # q = A d
        self._spans = np.zeros((shape[0], 2), np.int64)

    @property
    def change(self):
        """What was added to x: in lent storage, or made when it is needed and freed by `rest`. Not collective."""
        if self._lent is not None:
            return self._lent
        if self._change is None:
            self._change = np.zeros(self._operator.local_shape, self._operator.dtype)
        return self._change

    def rest(self):
        """Free what is kept from one solve to the next, until it is needed. Not collective."""
        self._r = self._d = self._change = None

    def solve(self, ksp, b, x):
        """Improve x."""
        operator, multiply = self._operator, self.multiply
        precondition, local_terms, r, z = self._preconditioner(ksp.getPC())
        contact, spans, q, change = operator.mask, self._spans, self.product, self.change
        d = self._room_for_d(z)
        norm, cells = self._start(ksp, b, x, r)
        d[...] = change[...] = 0  # outside the new spans too
        squares, digits = norm**2, MIN_CARRIED_SQUARES[r.dtype]
        summed, reduced = squares, None
        iteration, max_it, previous = 0, ksp.getTolerances()[3], 0.0
        reason = self._report(ksp, 0, norm)
        while not reason and iteration < max_it:
            rz = precondition(reduced)
            if rz is None:
                rz = self._sum([_dot(r, z, contact, spans)])[0]
            _direction(d, z, d.dtype.type(rz / previous if previous else 0.0), contact, spans)
            operator.products += 1
            multiply(d, q)
            numbers, wanted = _dots(d, q, r, contact, spans), local_terms(q)
            more = len(wanted)
            found = self._sum(np.append(numbers, wanted) if more else numbers)
            (dq, rd, qr, qq), of_q = found[:4], found[4:]
            if not dq > 0:
                reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                break
            alpha = rd / dq
            reduced = (alpha, of_q) if more else None
            here = _advance(change, r, d, q, contact, spans, alpha)
            squares += alpha * (alpha * qq - 2 * qr)  # exactly, but for cancellation
            if not squares > digits * summed:
                summed = squares = self._sum([here])[0]
            previous = rz
            norm = sqrt(max(squares, 0.0))
            iteration += 1
            reason = self._report(ksp, iteration, norm)
        with x as solution:
            add(solution.reshape(r.shape), 1.0, change)
        PETSc.Log.logFlops((5 + 18 * iteration) * cells)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def _room_for_d(self, z):
        """Beside q in the place of z, where these are in a lower precision than Vecs."""
        halves = self.work.reshape(-1).view(self._operator.dtype)
        if z is not self.work and halves.size > z.size:
            return halves[z.size :].reshape(z.shape)
        if self._d is None:
            self._d = np.zeros(z.shape, self._operator.dtype)
        return self._d

    def _preconditioner(self, pc):
        """What computes z from r, what it wants to know of q, r and z.

        In the operator's precision, if the PC has `precondition` and `local_terms` as `Circulant` has, else Vecs.
        """
        context = pc.getPythonContext() if pc.getType() == "python" else None
        precondition = getattr(context, "precondition", None)
        if self._r is None:
            self._r = np.zeros(self._operator.local_shape, self._operator.dtype if precondition else float)
        if precondition:
            return partial(precondition, self._r, self.product), context.local_terms, self._r, self.product
        residual = wrap_vec(self._r, self._operator)

        def apply(_):
            residual.stateIncrease()
            pc.apply(residual, self._z)

        return apply, lambda _: (), self._r, self.work

    def _start(self, ksp, b, x, r):
        """r = b + shift - u; return its norm, and how many cells are worked on.

        Without `displacement` u is A x for the initial guess, and not kept.
        """
        u, known, self.first_norm = self.displacement, self.first_norm, None
        if u is None:
            u = self.work
            if ksp.getInitialGuessNonzero():
                ksp.getOperators()[0].mult(x, self._z)
            else:
                x.set(0)
                u[...] = 0
        squares, cells = _first_residual(self._read(b), self.shift, u, self._operator.mask, self._spans, r)
        return (sqrt(self._sum([squares])[0]) if known is None else known), cells

    def reset(self, ksp):
        """Free the work vectors; the next set-up makes others."""
        self.rest()
        if self._z is not None:
            self._z.destroy()
        self._z = self._lent = self.work = self.product = self.multiply = None  # storage of others

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients from a known displacement\n")
