"""Conjugate gradients whose result has a prescribed sum.

The solver finds x with ``C (A x - c) = C b`` on the contact set C. If the sum of x is prescribed, the constant c is its
Lagrange multiplier. The first step reaches the sum along M 1, where M is the preconditioner. The search directions sum
to zero: the preconditioned residual is z = M (r - c), with the c for which z sums to zero. Options::

    -ksp_type python -ksp_python_type app.methods.film.cg.ConstrainedCG
"""

from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.halfspace.mat_methods import check_unscaled
from app.halfspace.operator import InfluenceOperator, get_operator
from app.multigrid.ksp_context import KspContext


class ConstrainedCG(KspContext):
    """KSP context of conjugate gradients with a prescribed sum. Collective.

    Options: -ksp_rtol, -ksp_atol, -ksp_max_it, -pc_*.

    Attributes
    ----------
    total : float or None
        Prescribed sum of the result; None if there is none. Set by the caller.
    shift : float
        The constant c [mm]; 0 if no sum is prescribed.
    """

    total, shift = None, 0.0
    _vecs = ()

    def setUp(self, ksp):
        """Make the work vectors."""
        mat = ksp.getOperators()[0]
        self._operator = get_operator(mat, InfluenceOperator, "ConstrainedCG")
        check_unscaled(mat, "ConstrainedCG")
        self._free_vecs()
        self._vecs = [mat.createVecRight() for _ in range(5)]

    def _free_vecs(self):
        for vec in self._vecs:
            vec.destroy()
        self._vecs = ()

    def reset(self, ksp):
        """Free the work vectors."""
        self._free_vecs()

    def solve(self, ksp, b, x):
        """Solve for x, starting from zero."""
        mat, pc = ksp.getOperators()[0], ksp.getPC()
        r, z, d, q, unit = self._vecs
        constrained, inside = self.total is not None, self._operator.mask
        x.set(0)
        b.copy(r)
        self.shift, response = 0.0, 1.0
        if constrained:
            q.setArray(inside.reshape(-1).astype(float))
            pc.apply(q, unit)
            response = self._sum([unit.getArray(readonly=True).sum()])[0]
            if self.total:
                x.axpy(self.total / response, unit)
                mat.mult(x, q)
                r.axpy(-1.0, q)

        def precondition():
            """Compute z = M (r - c); return z.(r - c), and the norm of r - c."""
            pc.apply(r, z)
            if constrained:
                self.shift = self._sum([z.getArray(readonly=True).sum()])[0] / response
                z.axpy(-self.shift, unit)
            residual = r.getArray(readonly=True)
            left = residual - self.shift * inside.reshape(-1)
            rz, squares = self._sum([np.vdot(residual, z.getArray(readonly=True)), np.vdot(left, left)])
            return rz, sqrt(squares)

        rz, norm = precondition()
        z.copy(d)
        reason, iteration = self._report(ksp, 0, norm), 0
        while not reason and iteration < ksp.getTolerances()[3]:
            mat.mult(d, q)
            dq = d.dot(q)
            if not dq > 0:
                reason = PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                break
            x.axpy(rz / dq, d)
            r.axpy(-rz / dq, q)
            before, (rz, norm) = rz, precondition()
            d.aypx(rz / before, z)
            iteration += 1
            reason = self._report(ksp, iteration, norm)
        ksp.setConvergedReason(reason or PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)

    def view(self, ksp, viewer):
        """Describe the solver for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII("  conjugate gradients with a prescribed sum\n")
