"""Base class of this program's Krylov methods."""

from petsc4py import PETSc

from app.parallel.reductions import sum_over


class KspContext:
    """Context of Python KSPs that use PETSc's convergence test.

    The attribute `norm_type` is the norm that the method computes.
    """

    norm_type = PETSc.KSP.NormType.UNPRECONDITIONED

    def setFromOptions(self, ksp):
        """Set the method's norm, unless ``-ksp_norm_type`` is given."""
        if not PETSc.Options(ksp.getOptionsPrefix()).hasName("ksp_norm_type"):
            ksp.setNormType(self.norm_type)

    def reset(self, ksp):
        """Free the work arrays until the next set-up."""

    def destroy(self, ksp):
        """Free everything that the context holds."""
        self.reset(ksp)

    def _report(self, ksp, iteration, norm):
        """Report an iteration to PETSc; return PETSc's reason to stop, or 0."""
        if not norm >= 0:
            return PETSc.KSP.ConvergedReason.DIVERGED_NANORINF
        ksp.its, ksp.norm = iteration, norm
        ksp.logConvergenceHistory(norm)
        ksp.monitor(iteration, norm)
        return ksp.callConvergenceTest(iteration, norm)

    def _read(self, vec):
        return vec.getArray(readonly=True).reshape(self._operator.local_shape)

    def _sum(self, values):
        return sum_over(self._operator.comm, values)
