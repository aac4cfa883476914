"""Influence coefficients: quadrant, scaling, dense matrix."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix, influence_quadrant
from app.halfspace.kernel import UNIT, HalfSpaceKernel


def test_influence_at_selects_from_quadrant():
    grid = Grid(40, 30, 0.3, 0.2)
    rows, columns = np.array([0, 7, 3, 29]), np.array([5, 0, 39])
    assert (
        UNIT.unit_coefficients(grid, rows, columns) == influence_quadrant(grid, UNIT)[np.ix_(rows, columns)]
    ).all()


# Closed form up to 8 cells: it cancels (distance / shorter side) of its digits. Measured: below 5e-15 times the
# aspect ratio. Beyond, a Taylor series that cancels nothing: 3.5e-16.
NEAR, FAR = 5e-15, 6e-16


@pytest.mark.parametrize("scale", [2.0**-166, 0.125, 2.0, 2.0**166])
def test_quadrant_scales_with_compliance_and_length(scale):
    quadrant = influence_quadrant(Grid(30, 20, 0.3, 0.5), UNIT)
    scaled = influence_quadrant(Grid(30, 20, 0.3 * scale, 0.5 * scale), HalfSpaceKernel(0.25))
    np.testing.assert_array_equal(scaled, 0.25 * scale * quadrant)


def test_quadrant_is_positive_and_decreasing():
    quadrant = influence_quadrant(Grid(300, 200, 0.7, 0.4), UNIT)
    assert (quadrant > 0).all()
    assert (np.diff(quadrant, axis=0) < 0).all()
    assert (np.diff(quadrant, axis=1) < 0).all()


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
