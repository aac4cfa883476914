"""Inverse of A for fields continued past the patch boundary."""

import numpy as np
import pytest

from app import Grid, Material
from app.halfspace.one_way_kernel import patch_kernel
from app.methods.free.padded_inverse import PADDING, PaddedInverse
from app.methods.multilevel_operators import create_circulant_inverse


def continue_linearly(size):
    """Return the matrix W in one direction, which continues a field to zero on both sides."""
    weights = np.arange(1, PADDING + 1) / (PADDING + 1)
    matrix = np.zeros((size + 2 * PADDING, size))
    matrix[PADDING:-PADDING] = np.eye(size)
    matrix[:PADDING, 0] = weights
    matrix[-PADDING:, -1] = weights[::-1]
    return matrix


@pytest.mark.parametrize("shape", [(24, 31), (130, 150)])
@pytest.mark.parametrize("periodic", ["", "x", "y"])
def test_product_is_that_of_continued_fields(shape, periodic):
    grid = Grid(*shape[::-1], 1.0, 1.0, periodic=periodic)
    ny, kernel = shape[0], patch_kernel(Material.coated((5.0, 1.0), (0.3, 0.3), 10.0).kernel, grid)
    in_y, in_x = (
        np.eye(size) if repeats else continue_linearly(size)
        for size, repeats in zip(shape, grid.repeats, strict=True)
    )
    padded = Grid(len(in_x), len(in_y), 1.0, 1.0, periodic=periodic)
    inverse, exact = PaddedInverse(grid, kernel), create_circulant_inverse(padded, kernel, apart=True)
    rng = np.random.default_rng(0)
    p, u, rows = rng.normal(size=grid.shape), np.empty(grid.shape), np.ones(ny, bool)
    for some in (None, rng.random(ny) < 0.5):
        rows = rows if some is None else some
        continued = in_y @ np.where(rows[:, None], p, 0) @ in_x.T
        exact.apply(continued, continued)
        inverse.apply(np.where(rows[:, None], p, np.nan), u, rows=some)
        inside = in_y.T @ continued @ in_x
        np.testing.assert_allclose(u[rows], inside[rows], rtol=0, atol=1e-12 * abs(inside).max())
