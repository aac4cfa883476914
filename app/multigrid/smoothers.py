"""Smoothers that PETSc has no name for.

Gauss-Seidel and SOR are PETSc's PCSOR on the operator's own sweeps, damped Jacobi is PCJacobi with
``-mg_levels_ksp_richardson_scale``; here are the rest.
"""

from __future__ import annotations

from petsc4py import PETSc

from app.halfspace import relaxation


class NoSmoothing:
    """A KSP that leaves the solution as it is, without a product: one half of V(1,0) and V(0,1).

    ``-mg_levels_ksp_type python -mg_levels_ksp_python_type app.multigrid.smoothers.NoSmoothing``,
    ``-mg_levels_ksp_norm_type unpreconditioned -mg_levels_pc_type none``.
    """

    def solve(self, ksp, b, x):
        """Do nothing."""
        ksp.setConvergedReason(4)  # CONVERGED_ITS


class RedBlack:
    """A PC: damped Gauss-Seidel on the red cells of a checkerboard, then on the black ones; one product.

    ``-mg_levels_pc_type python -mg_levels_pc_python_type app.multigrid.smoothers.RedBlack``; option
    ``-mg_levels_pc_redblack_omega`` (default 0.8). For a dense matrix no more parallel than plain Gauss-Seidel, and
    no convergent smoother here: for comparison.
    """

    def setUp(self, pc):
        """Find the operator."""
        self.operator = operator = pc.getOperators()[1].getPythonContext()
        self.omega = PETSc.Options(pc.getOptionsPrefix()).getReal("pc_redblack_omega", 0.8)
        self.relaxation = relaxation.RedBlack(
            operator.diagonal, operator.product.apply, operator.local_shape, operator.slabs.rows.start
        )

    def apply(self, pc, x, y):
        """Sweep once from zero."""
        operator = self.operator
        with y as out:
            r = x.getArray(readonly=True).reshape(operator.local_shape) * operator.mask
            self.relaxation.sweep(r, operator.mask, self.omega, out.reshape(operator.local_shape))
        operator.sweeps += 1

    def view(self, pc, viewer):
        """Describe the smoother for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            viewer.printfASCII(f"  red-black Gauss-Seidel, omega {self.omega:g}\n")
