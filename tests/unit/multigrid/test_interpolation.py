"""Bilinear and quintic interpolation."""

import numpy as np
import pytest
from operators import random_field

from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.multigrid.transfer import Transfer

from .test_transfer import each_case, make_transfer


@each_case
def test_interpolation_is_exact_for_bilinear_functions(shape, factors):
    transfer = make_transfer(shape, factors)
    fine, coarse = transfer.fine.grid, transfer.coarse.grid

    def function(grid):
        # One coarse cell in a direction carries no slope.
        x = grid.x() if coarse.nx > 1 else np.zeros(grid.nx)
        y = grid.y() if coarse.ny > 1 else np.zeros(grid.ny)
        return 2 + 3 * x[None, :] - 5 * y[:, None] + 7 * x[None, :] * y[:, None]

    found = np.full(shape, np.nan)
    transfer.interpolate(function(coarse), found)
    np.testing.assert_allclose(found, function(fine), rtol=1e-13)


INTERPOLATIONS = "interpolate", "interpolate_quintic"


@pytest.mark.parametrize("interpolate", INTERPOLATIONS)
@pytest.mark.parametrize(("shape", "factors"), [((8, 6), (2, 2)), ((7, 12), (1, 2)), ((4, 2), (2, 2))])
def test_periodic_interpolation_commutes_with_shifts(shape, factors, interpolate):
    (ny, nx), (fy, fx) = shape, factors
    fine = Grid(nx, ny, 0.5, 0.5, periodic="spectral")
    coarse = Grid(nx // fx, ny // fy, 0.5 * fx, 0.5 * fy, periodic="spectral")
    transfer = Transfer(InfluenceOperator(fine, UNIT), InfluenceOperator(coarse, UNIT), factors)
    u, found, moved = random_field(coarse, 1), np.empty(shape), np.empty(shape)
    getattr(transfer, interpolate)(u, found)
    getattr(transfer, interpolate)(np.roll(u, (1, 1), (0, 1)), moved)
    np.testing.assert_array_equal(moved, np.roll(found, factors, (0, 1)))
    assert found.mean() == pytest.approx(u.mean(), abs=1e-14)


@pytest.mark.parametrize(("interpolate", "order"), zip(INTERPOLATIONS, (2, 6), strict=True))
@pytest.mark.parametrize("odd", [0, 1])
def test_order_of_periodic_interpolation(interpolate, order, odd):
    errors, cells = [], (64 + odd, 128 + odd)
    for n in cells:
        fine = Grid(n, n, 1 / n, 1 / n, periodic="spectral")
        coarse = fine.coarsen()

        def function(grid):
            return np.exp(np.sin(2 * np.pi * grid.x()))[None, :] * np.cos(2 * np.pi * grid.y() + 1)[:, None]

        transfer = Transfer(InfluenceOperator(fine, UNIT), InfluenceOperator(coarse, UNIT), (2, 2))
        found = np.empty(fine.shape)
        getattr(transfer, interpolate)(function(coarse), found)
        errors.append(abs(found - function(fine)).max())
    assert np.log(errors[0] / errors[1]) / np.log(cells[1] / cells[0]) == pytest.approx(order, abs=0.15)
