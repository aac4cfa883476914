"""Smoothers that PETSc does not have."""

from petsc4py import PETSc

from app.multigrid.smoothers import NoSmoothing


def test_no_smoothing_leaves_the_solution_unchanged():
    b, x = (PETSc.Vec().createSeq(3, comm=PETSc.COMM_SELF) for _ in range(2))
    b.set(1.0)
    x.set(2.0)
    mat = PETSc.Mat().createAIJ((3, 3), comm=PETSc.COMM_SELF)
    mat.setUp()
    mat.assemble()
    ksp = PETSc.KSP().createPython(NoSmoothing(), comm=PETSc.COMM_SELF)
    ksp.setOperators(mat)
    ksp.pc.setType("none")
    ksp.setInitialGuessNonzero(True)
    ksp.solve(b, x)
    assert (x.array == 2.0).all()
    assert ksp.reason == PETSc.KSP.ConvergedReason.CONVERGED_ITS
    for made in (ksp, mat, b, x):
        made.destroy()
