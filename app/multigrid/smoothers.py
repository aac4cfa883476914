"""Smoothers that PETSc has no name for: ``-mg_levels_ksp_python_type app.multigrid.smoothers.NoSmoothing``."""

from __future__ import annotations


class NoSmoothing:
    """A KSP that leaves the solution as it is, without a product: one half of V(1,0) and V(0,1)."""

    def solve(self, ksp, b, x):
        """Do nothing."""
        ksp.setConvergedReason(4)  # CONVERGED_ITS
