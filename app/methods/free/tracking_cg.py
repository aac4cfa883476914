"""Conjugate gradients that start from a known displacement.

They solve C A C x = C (b + shift) for the pressure x in the contact set C. The right-hand side b + shift is -h: b is
-h at depth 0, and the constant `shift` is the depth. The displacement u = A x at the start is known, so the first
residual b + shift - u costs no product. The change of x is stored, so that the caller can update u by A times this
change. The caller may replace the products by approximate ones (`TrackingCG.multiply`).

Names: d is the direction of CG, q = A d, r the residual, and z the preconditioned residual. Options::

    -ksp_type python -ksp_python_type app.methods.free.tracking_cg.TrackingCG
"""

from functools import partial
from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.contact.loops import gap
from app.halfspace.mat_methods import check_unscaled
from app.halfspace.operator import InfluenceOperator, get_operator, wrap_vec
from app.multigrid.ksp_context import KspContext
from app.parallel.reductions import add_row, add_tuples, njit_reassoc, nonzero_span

# r.r is updated without a sum over ranks until it has fallen to this share; then it is summed again.
MIN_CARRIED_SQUARES = {np.dtype(np.float64): 1e-8, np.dtype(np.float32): 1e-6}

# r and d vanish outside C; z and q need not. Loops run over each row from its first to its last cell of C.


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
    """Compute the first residual r in contact cells.

    The residual is r = b + shift - u, with right-hand side b + shift and displacement u. `spans` receives the first and
    end column of contact in each row. Return r.r, and the number of cells in these spans.
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
    """Make a step of CG; return r.r.

    The step adds alpha d to `change`, and subtracts alpha q from the residual r. d is the direction, q = A d.
    """
    squares = 0.0
    for j in range(r.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        add_row(change[j, span], alpha, d[j, span])
        squares += _reduce_row(r[j, span], alpha, q[j, span], contact[j, span])
    return squares


@njit_reassoc
def add(a, scale, b):
    """Add scale * b to a, in place."""
    for j in range(a.shape[0]):
        add_row(a[j], scale, b[j])


@njit_reassoc
def _direction(d, z, beta, contact, spans):
    """Compute the direction d = z + beta d in contact cells."""
    for j in range(d.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        _direction_row(d[j, span], z[j, span], beta, contact[j, span])


@njit_reassoc
def _dot(a, b, contact, spans):
    """Return the scalar product a.b over contact cells."""
    total = 0.0
    for j in range(a.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        total += _dot_row(a[j, span], b[j, span], contact[j, span])
    return total


@njit_reassoc
def _dots(d, q, r, contact, spans):
    """Return the scalar products d.q, d.r, q.r, q.q over contact cells."""
    sums = 0.0, 0.0, 0.0, 0.0
    for j in range(d.shape[0]):
        span = slice(spans[j, 0], spans[j, 1])
        sums = add_tuples(sums, _dots_row(d[j, span], q[j, span], r[j, span], contact[j, span]))
    return sums


class TrackingCG(KspContext):
    """KSP context of conjugate gradients from a known displacement.

    Collective. The system is C A C x = C (b + shift), with C the contact cells. The KSP's matrix is an
    `InfluenceOperator`. Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*.

    Attributes
    ----------
    displacement : ndarray, shape (local rows, nx), or None
        u = A x for the initial guess x. Set by the caller, together with a nonzero x.
    shift : float
        Constant that is added to b; it is the depth. Set by the caller.
    first_norm : float or None
        Norm of the first residual, if known. Set by the caller for one solve.
    multiply : callable
        Function ``multiply(d, q)`` that computes q = A d, exactly or approximately. The caller may replace it.
    residual : float
        Norm of the residual after the last solve, according to `multiply`.
    change : ndarray, shape (local rows, nx)
        Change of x in the last solve, in the operator's precision.
    work : ndarray, shape (local rows, nx)
        Work array in double precision. Free for other use between solves.
    product : ndarray, shape (local rows, nx)
        A d in the operator's precision. It shares the memory of `work`.
    """

    displacement = first_norm = None
    residual = shift = 0.0
    _z = _r = _d = _change = None

    def setUp(self, ksp):
        """Make the work arrays; `work` and `product` share memory."""
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
        """Change of x in the last solve."""
        if self._lent is not None:
            return self._lent
        if self._change is None:
            self._change = np.zeros(self._operator.local_shape, self._operator.dtype)
        return self._change

    def free_work(self):
        """Free work arrays until the next solve."""
        self._r = self._d = self._change = None

    def solve(self, ksp, b, x):
        """Improve x by CG from the known displacement; store its `change`."""
        operator, multiply = self._operator, self.multiply
        precondition, local_terms, r, z = self._preconditioner(ksp.getPC())
        contact, spans, q, change = operator.mask, self._spans, self.product, self.change
        d = self._direction_array(z)
        norm, cells = self._start(ksp, b, x, r)
        d[...] = change[...] = 0  # outside the new spans too
        squares, min_share = norm**2, MIN_CARRIED_SQUARES[r.dtype]
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
            numbers, terms = _dots(d, q, r, contact, spans), local_terms(q)
            more = len(terms)
            sums = self._sum(np.append(numbers, terms) if more else numbers)
            dq, rd, qr, qq = sums[:4]
            if not dq > 0:
                reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                break
            alpha = rd / dq
            reduced = (alpha, sums[4:]) if more else None
            local = _advance(change, r, d, q, contact, spans, alpha)
            squares += alpha * (alpha * qq - 2 * qr)  # exact except for cancellation
            if not squares > min_share * summed:
                summed = squares = self._sum([local])[0]
            previous = rz
            norm = sqrt(max(squares, 0.0))
            iteration += 1
            reason = self._report(ksp, iteration, norm)
        with x as solution:
            add(solution.reshape(r.shape), 1.0, change)
        PETSc.Log.logFlops((5 + 18 * iteration) * cells)
        self.residual = norm
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def _direction_array(self, z):
        """Return a work array for the direction d.

        In single precision the array is the half of `work` that `product` does not use.
        """
        halves = self.work.reshape(-1).view(self._operator.dtype)
        if z is not self.work and halves.size > z.size:
            return halves[z.size :].reshape(z.shape)
        if self._d is None:
            self._d = np.zeros(z.shape, self._operator.dtype)
        return self._d

    def _preconditioner(self, pc):
        """Return the preconditioner's functions, and arrays for their arguments.

        The first function computes z, the preconditioned residual, from the residual r. The second function is
        `Circulant.local_terms`. r and z are in the operator's precision if the PC has these functions as methods,
        otherwise in double precision.
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
        """Compute the first residual r = b + shift - u.

        b + shift is the right-hand side. u is the attribute `displacement`, or A x if this is None. Return the norm of
        r, and the number of cells in the spans of contact.
        """
        u, norm, self.first_norm = self.displacement, self.first_norm, None
        if u is None:
            u = self.work
            if ksp.getInitialGuessNonzero():
                ksp.getOperators()[0].mult(x, self._z)
            else:
                x.set(0)
                u[...] = 0
        squares, cells = _first_residual(self._read(b), self.shift, u, self._operator.mask, self._spans, r)
        return (sqrt(self._sum([squares])[0]) if norm is None else norm), cells

    def reset(self, ksp):
        """Free the work arrays and vectors."""
        self.free_work()
        if self._z is not None:
            self._z.destroy()
        self._z = self._lent = self.work = self.product = self.multiply = None

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients from a known displacement\n")
