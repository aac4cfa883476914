"""Inverse influence matrix on the free cells."""

import numpy as np
import pytest
from operators import PERIODIC, STEEL, mat_times, random_field
from petsc4py import PETSc

from app.halfspace.operator import InfluenceOperator
from app.methods.periodic.operator import InverseOperator


@pytest.mark.parametrize(("dtype", "off"), [(np.float64, 1e-12), (np.float32, 2e-5)])
@pytest.mark.parametrize("grid", PERIODIC.values(), ids=PERIODIC.keys())
def test_b_is_the_inverse_except_for_the_mean_and_positive_on_free_cells(grid, dtype, off):
    influence = InfluenceOperator(grid, STEEL, dtype=dtype)
    inverse, p = InverseOperator(influence), random_field(grid, 1)
    u, back = np.empty(grid.shape), np.empty(grid.shape)
    influence.exact_displacement(p, u)
    for compute in (inverse.pressure, inverse.exact_pressure):
        compute(u, back)
        np.testing.assert_allclose(back, p - p.mean(), rtol=0, atol=off * abs(p).max())
    inverse.mask[...] = np.random.default_rng(2).random(grid.shape) < 0.7
    mat = inverse.mat(PETSc.COMM_SELF)
    x, y = (random_field(grid, seed) * inverse.mask for seed in (3, 4))
    bx, by = (mat_times(mat, field).reshape(grid.shape) for field in (x, y))
    assert (bx[~inverse.mask] == 0).all()
    assert np.vdot(bx, x) > 0
    assert np.vdot(bx, y) == pytest.approx(np.vdot(x, by), abs=off * np.vdot(bx, x))
    assert inverse.products == 2
    mat.destroy()
