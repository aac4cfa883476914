"""Conjugate gradients of the primal form."""

import numpy as np
import pytest
from petsc4py import PETSc

from app.contact.prescribed_load import PrescribedLoad


def test_flops_of_carrying_cg_are_logged(guessed):
    primal, solver = guessed(PrescribedLoad(1e2))
    inverse = primal.inverse
    products, before = inverse.product.count, PETSc.Log.getFlops()
    iterations, *_ = solver.improve(primal, 0.0)
    flops = PETSc.Log.getFlops() - before - (inverse.product.count - products) * inverse.product.flops
    assert flops >= 10 * iterations * inverse.grid.n > 0


@pytest.mark.parametrize("count", [1, 2, 5])
def test_steps_are_those_of_flexible_cg(guessed, count):
    primal, solver = guessed(PrescribedLoad(1e2))
    left = np.where(primal.inverse.mask, -primal.p, 0.0)
    other = PETSc.KSP().create(PETSc.COMM_SELF)
    other.setOperators(solver.mat)
    other.setType("fcg")
    PETSc.Options().setValue("other_ksp_fcg_mmax", "1")
    other.setOptionsPrefix("other_")
    other.setFromOptions()
    other.getPC().setType("python")
    other.getPC().setPythonContext(solver.preconditioner)
    other.setTolerances(rtol=0, atol=0, max_it=count)
    b, x = solver.mat.createVecs()
    b.setArray(left.reshape(-1))
    other.solve(b, x)
    solver.ksp.setTolerances(rtol=1e-300, max_it=count)
    iterations, _, norm = solver.improve(primal, 0.0)
    assert iterations == count
    moved = solver.change
    np.testing.assert_allclose(moved.reshape(-1), x.getArray(), rtol=0, atol=1e-6 * abs(moved).max())
    expected = np.empty_like(moved)
    primal.inverse.exact_pressure(primal.w + moved, expected)
    expected += primal.mean_pressure
    np.testing.assert_allclose(solver.carried, expected, rtol=0, atol=1e-10 * abs(expected).max())
    assert norm == pytest.approx(np.linalg.norm(solver.scratch), rel=1e-12)
    PETSc.Options().delValue("other_ksp_fcg_mmax")
    for thing in (other, b, x):
        thing.destroy()
