"""Smoothers that PETSc does not have.

Gauss-Seidel and SOR are PETSc's PCSOR with the sweeps of the operator. Damped Jacobi is PCJacobi with
``-mg_levels_ksp_richardson_scale``. A red-black sweep would not help: A is dense, so red cells act on each other, and
updating all of them at once is a Jacobi step, which converges for no useful damping.
"""

from petsc4py import PETSc

from app.multigrid.ksp_context import KspContext


class NoSmoothing(KspContext):
    """KSP that does nothing, for V(1,0) and V(0,1).

    Choose it by ``-mg_levels_pc_type none -mg_levels_ksp_type python``,
    ``-mg_levels_ksp_python_type app.multigrid.smoothers.NoSmoothing``.
    """

    def solve(self, ksp, b, x):
        """Leave x unchanged."""
        ksp.setConvergedReason(PETSc.KSP.ConvergedReason.CONVERGED_ITS)
