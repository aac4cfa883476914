"""Products between lists of cells of periodic patches: no error exceeds the bound, also across the sides."""

from itertools import product as combinations

import numpy as np
import pytest

from app import Material
from app.base.errors import InputError
from app.halfspace import periodic_list_product
from app.halfspace.cell_list import CellList
from app.halfspace.grid import Grid
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.operator import InfluenceOperator
from app.halfspace.periodic_list_product import PeriodicListProduct

ROUNDING = 1e-13  # of the sum of |p| times the largest coefficient
BODIES = {
    "half-space": Material.from_contact_modulus(1.0),
    "stiff coating": Material.coated(young=(50.0, 1.0), poisson=(0.3, 0.3), thickness=9.0),
    "layer": Material.layer(young=1.0, poisson=0.45, thickness=12.0),
}
GRIDS = {"square": (96, 96, 1.0), "wide": (160, 96, 1.0), "long cells": (128, 256, 2.0)}


@pytest.fixture(autouse=True)
def small_grids(monkeypatch):
    """Allow small grids, which have few nodes."""
    for name, value in {"_MIN_CELLS": 64, "_MIN_NODES": 12, "_MARGIN": 8}.items():
        monkeypatch.setattr(periodic_list_product, name, value)


def exact(grid, kernel, p):
    u = np.empty(grid.shape)
    InfluenceOperator(grid, kernel).exact_displacement(p, u)
    return u


@pytest.mark.parametrize("bodies", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("periodic", ["spectral", "love", "x", "y"])
@pytest.mark.parametrize("size", GRIDS.values(), ids=GRIDS)
def test_error_is_below_bound(size, periodic, bodies):
    nx, ny, dx = size
    grid, rng = Grid(nx, ny, dx, 1.0, periodic=periodic), np.random.default_rng(5)
    kernel = patch_kernel(bodies.kernel, grid)
    product, y, x = PeriodicListProduct(grid, kernel, spacing=4), *np.indices(grid.shape)
    edges = (np.minimum(y, x) == 0) | (y == ny - 1)
    spot = (np.hypot(y - 20, x - nx + 3) < 9) & (rng.random(grid.shape) < 0.7)
    single = (y == ny - 1) & (x == nx - 1)
    everywhere = CellList(grid, np.ones(grid.shape, bool))
    for mask, sign in combinations((edges, spot, single, rng.random(grid.shape) < 0.05), (0.0, 0.5)):
        p = np.where(mask, rng.random(grid.shape) - sign, 0.0)
        found = product.apply(CellList(grid, mask), p[mask], everywhere)
        limit = (product.error_bound + ROUNDING * product.diagonal) * np.abs(p).sum()
        assert np.abs(found - exact(grid, kernel, p).ravel()).max() <= limit
    assert product.error_bound < 1e-5 * product.diagonal


@pytest.mark.parametrize("periodic", ["spectral", "love", "x"])
def test_bound_is_small_for_half_spaces_and_sharp(periodic):
    grid = Grid(256, 256, 1.0, 1.0, periodic=periodic)
    kernel = patch_kernel(BODIES["half-space"].kernel, grid)
    for spacing in (4, 8):
        product, p = PeriodicListProduct(grid, kernel, spacing=spacing), np.zeros(grid.shape)
        p[3, 250] = 1.0
        everywhere = CellList(grid, np.ones(grid.shape, bool))
        error = product.apply(CellList(grid, p > 0), p[p > 0], everywhere) - exact(grid, kernel, p).ravel()
        assert 0.05 * product.error_bound < np.abs(error).max() <= product.error_bound
        assert product.error_bound < 3e-8 * product.diagonal


def test_stencil_is_the_same_across_the_sides():
    grid = Grid(128, 96, 1.0, 1.0, periodic="spectral")
    sums = PeriodicListProduct(grid, BODIES["half-space"].kernel, spacing=4).stencil(8)
    middle, moved = np.zeros((2, *grid.shape))
    middle[40:50, 60:80] = np.random.default_rng(2).random((10, 20))
    moved[...] = np.roll(middle, (51, 60), axis=(0, 1))
    results = []
    for p in (middle, moved):
        cells = CellList(grid, p > 0)
        whole = np.zeros(grid.shape)
        whole.flat[cells.cells] = sums.apply(cells, p[p > 0], cells)
        results.append(whole)
    np.testing.assert_allclose(np.roll(results[0], (51, 60), axis=(0, 1)), results[1], atol=1e-12)


@pytest.mark.parametrize("grid", [Grid(96, 96, 1.0, 1.0), Grid(97, 96, 1.0, 1.0, periodic="spectral")])
def test_free_and_indivisible_patches_are_refused(grid):
    assert not PeriodicListProduct.suits(grid, BODIES["half-space"].kernel)
    with pytest.raises(InputError, match="periodic"):
        PeriodicListProduct(grid, BODIES["half-space"].kernel)
