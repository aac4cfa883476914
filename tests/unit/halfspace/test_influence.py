"""Influence coefficients: quadrant, scaling, dense matrix."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix, influence_quadrant
from app.halfspace.kernel import UNIT, HalfSpaceKernel


def test_rows_and_columns_are_parts_of_the_quadrant():
    grid = Grid(37, 50, 0.7, 0.4)
    whole = influence_quadrant(grid, UNIT)
    for rows in (slice(0, 1), slice(7, 23), slice(49, 50), slice(5, 5), slice(None, None, 3)):
        np.testing.assert_array_equal(influence_quadrant(grid, UNIT, rows), whole[rows])
        for columns in (0, 1, 8, 19, 37):
            some = influence_quadrant(grid, UNIT, rows, columns)
            np.testing.assert_array_equal(some, whole[rows, :columns])


@pytest.mark.parametrize("grid", [Grid(6, 5, 1.0, 1.0), Grid(1, 7, 2.0, 0.1), Grid(8, 3, 0.01, 5.0)])
def test_dense_matrix_is_symmetric_positive_definite_and_toeplitz(grid):
    A = dense_matrix(grid, HalfSpaceKernel(1.3))
    quadrant = influence_quadrant(grid, HalfSpaceKernel(1.3))
    np.testing.assert_array_equal(A, A.T)
    assert np.linalg.eigvalsh(A).min() > 0
    for row in range(grid.n):
        for column in range(grid.n):
            (j, i), (l, k) = divmod(row, grid.nx), divmod(column, grid.nx)
            assert A[row, column] == quadrant[abs(j - l), abs(i - k)]
