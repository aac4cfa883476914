"""Copies, factors and norms of a Mat, on several ranks."""

import numpy as np
import pytest
from petsc4py import PETSc

from .test_operator import assert_is, each_grid, mat_of, random_mask


@pytest.mark.mpi(1, 2, 3)
@each_grid
def test_scale_and_shift_belong_to_one_mat(comm, grid):
    mat, operator, dense = mat_of(comm, grid, 8)  # some ranks own no rows
    mask = random_mask(grid, 8)
    operator.mask[...] = mask[operator.slabs.rows]
    operator.mask_changed()
    inside = mask.reshape(-1)
    dense = np.where(inside[:, None] & inside, dense, 0.0)
    shift = 3 * dense.max()
    other = mat.duplicate()
    other.scale(-2.0)
    other.shift(shift)
    copy = other.copy()
    copy.scale(0.5)
    for one, factor, summand in ((mat, 1, 0), (other, -2, shift), (copy, -1, shift / 2)):
        assert_is(one, operator, factor * dense + summand * np.eye(grid.n))
        assert one.isHermitian() and one.isSymmetric()
        assert one.getInfo()["nz_used"] == 0
    with pytest.raises((ValueError, PETSc.Error)):
        mat.norm(PETSc.NormType.NORM_2)
    for one in (mat, other, copy):
        one.destroy()
