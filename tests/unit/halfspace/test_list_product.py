"""Products between lists of cells: their error is below its bound, and the bound is sharp."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from operators import STEEL

from app import Material
from app.base.errors import InputError
from app.halfspace.cell_list import CellList
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix, influence_quadrant, quadrant_rows
from app.halfspace.kernel import Kernel
from app.halfspace.list_product import (
    ListProduct,
    displacement_on_rows,
    fit_gaussians,
    uniform_displacement,
)
from app.halfspace.product import Convolution

ROUNDING = 1e-13  # of the sum of |p| times the largest coefficient
GRIDS = {
    "square": Grid(120, 120, 1.0, 1.0),
    "wide": Grid(170, 90, 0.01, 0.013),
    "tall": Grid(70, 230, 2.0, 0.7),
    "long cells": Grid(150, 80, 0.1, 1.1),
    "one row": Grid(700, 1, 0.5, 0.5),
    "one column": Grid(1, 333, 0.5, 0.2),
    "strip": Grid(3, 500, 1.0, 1.0),
}
TINY = {
    "one cell": Grid(1, 1, 1.0, 2.0),
    "two by two": Grid(2, 2, 1.0, 1.0),
    "strip": Grid(3, 50, 1.0, 2.0),
    "row": Grid(9, 1, 1.0, 1.0),
    "long cells": Grid(20, 21, 0.1, 3.0),
}


def lists(grid, rng):
    """Clustered, scattered, edge and single cells, all cells, none."""
    y, x = np.indices(grid.shape)
    cy, cx = rng.integers(0, grid.shape)
    clustered = (np.hypot(y - cy, x - cx) < 1 + max(grid.shape) / 8) & (rng.random(grid.shape) < 0.7)
    scattered = rng.random(grid.shape) < 0.05
    edge = (y == 0) | (x == grid.nx - 1)
    single = (y == cy) & (x == cx)
    masks = clustered, scattered, edge, single, np.ones(grid.shape, bool), np.zeros(grid.shape, bool)
    return [CellList(grid, mask) for mask in masks]


def assert_error_is_below_bound(product, sources, p, targets):
    grid = product.grid
    field, u = np.zeros(grid.shape), np.empty(grid.shape)
    field.flat[sources.cells] = p
    Convolution(quadrant_rows(grid, product.kernel), grid.shape).apply(field, u)
    limit = (product.error_bound + ROUNDING * product.diagonal) * np.abs(p).sum()
    found = product.apply(sources, p, targets)
    assert found.shape == (len(targets),)
    assert np.abs(found - u.flat[targets.cells]).max(initial=0.0) <= limit


@pytest.mark.parametrize("spacing", [0, 4, 8, 32])
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_error_is_below_bound(grid, spacing):
    rng = np.random.default_rng(spacing)
    product = ListProduct(grid, STEEL, spacing=spacing)
    for sources in lists(grid, rng):
        for targets in lists(grid, rng):
            for p in (np.ones(len(sources)), rng.normal(size=len(sources))):
                assert_error_is_below_bound(product, sources, p, targets)


@pytest.mark.parametrize("spacing", [0, 4, 32])
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_error_on_rows_is_below_bound(grid, spacing):
    rng, product = np.random.default_rng(spacing), ListProduct(grid, STEEL, spacing=spacing)
    for sources in lists(grid, rng):
        field, u, p = np.zeros(grid.shape), np.empty(grid.shape), rng.normal(size=len(sources))
        field.flat[sources.cells] = p
        Convolution(quadrant_rows(grid, STEEL), grid.shape).apply(field, u)
        limit = (product.error_bound + ROUNDING * product.diagonal) * np.abs(p).sum()
        first, last = np.sort(rng.integers(0, grid.ny + 1, 2)).tolist()
        for rows in (slice(0, grid.ny), slice(first, last)):
            found = product.apply_on_rows(sources, p, rows)
            assert found.shape == u[rows].shape
            assert np.abs(found - u[rows]).max(initial=0.0) <= limit
        anew = displacement_on_rows(grid, STEEL, sources.cells, p, slice(0, grid.ny))
        np.testing.assert_allclose(anew, u, atol=1e-7 * product.diagonal * np.abs(p).sum())


@settings(max_examples=25, deadline=None)
@given(
    nx=st.integers(1, 150),
    ny=st.integers(1, 150),
    ratio=st.sampled_from([0.2, 0.7, 1.0, 3.0, 5.0]),
    spacing=st.sampled_from([0, 4, 8, 16]),
    density=st.sampled_from([0.0, 0.01, 0.1, 0.3]),
    seed=st.integers(0, 999),
)
def test_error_of_random_lists_is_below_bound(nx, ny, ratio, spacing, density, seed):
    rng = np.random.default_rng(seed)
    grid = Grid(nx, ny, 0.1, 0.1 * ratio)
    product = ListProduct(grid, STEEL, spacing=spacing)
    sources, targets = (CellList(grid, rng.random(grid.shape) < density) for _ in range(2))
    assert_error_is_below_bound(product, sources, rng.normal(size=len(sources)), targets)


@pytest.mark.parametrize("name", ["square", "wide", "tall", "long cells"])
@pytest.mark.parametrize("spacing", [4, 8])
def test_bound_is_sharp(name, spacing):
    grid, largest = GRIDS[name], 0.0
    product, every = ListProduct(grid, STEEL, spacing=spacing), CellList(grid, np.ones(grid.shape, bool))
    quadrant = influence_quadrant(grid, STEEL)
    rng = np.random.default_rng(1)
    for cell in [0, *rng.integers(grid.n, size=30)]:
        u = product.apply(CellList(grid, np.array([cell])), np.ones(1), every)
        u -= quadrant[np.abs(every.iy - cell // grid.nx), np.abs(every.ix - cell % grid.nx)]
        largest = max(largest, np.abs(u).max())
    assert largest <= product.error_bound <= 20 * largest


@pytest.mark.parametrize("spacing", [4, 8, 16, 32])
def test_bound_is_small(spacing):
    """A ten-millionth of the displacement of a cell by its own pressure, and less if nodes are far apart."""
    product = ListProduct(Grid(400, 400, 1.0, 1.0), STEEL, spacing=spacing)
    assert product.error_bound <= 4e-9 / spacing * product.diagonal


@pytest.mark.parametrize("grid", TINY.values(), ids=TINY)
@pytest.mark.parametrize("spacing", [None, 4])
def test_tiny_grids(grid, spacing):
    product, every = ListProduct(grid, STEEL, spacing=spacing), CellList(grid, np.ones(grid.shape, bool))
    p = np.random.default_rng(0).normal(size=grid.n)
    expected = dense_matrix(grid, STEEL) @ p
    limit = (product.error_bound + ROUNDING * product.diagonal) * np.abs(p).sum()
    assert np.abs(product.apply(every, p, every) - expected).max() <= limit
    assert product.diagonal == dense_matrix(grid, STEEL)[0, 0]


def test_product_is_linear_and_symmetric():
    grid, rng = GRIDS["wide"], np.random.default_rng(0)
    product = ListProduct(grid, STEEL)
    one, two = (CellList(grid, rng.random(grid.shape) < 0.1) for _ in range(2))
    p, other, q = rng.normal(size=len(one)), rng.normal(size=len(one)), rng.normal(size=len(two))
    u, rounding = product.apply(one, p, two), ROUNDING * product.diagonal * np.abs(p).sum()
    both = product.apply(one, p + 2 * other, two)
    np.testing.assert_allclose(both, u + 2 * product.apply(one, other, two), rtol=0, atol=4 * rounding)
    assert abs(q @ u - p @ product.apply(two, q, one)) <= rounding * np.abs(q).sum()


def test_targets_of_ranks_give_the_same_numbers():
    """A rank has all sources and some targets."""
    grid, rng = GRIDS["tall"], np.random.default_rng(0)
    product = ListProduct(grid, STEEL)
    sources = targets = CellList(grid, rng.random(grid.shape) < 0.1)
    p, u = rng.random(len(sources)), np.empty(len(sources))
    for part in np.array_split(np.arange(len(targets)), 3):
        u[part] = product.apply(sources, p, CellList(grid, targets.cells[part]))
    expected = np.empty_like(u)
    assert product.apply(sources, p, targets, out=expected) is expected
    np.testing.assert_allclose(u, expected, rtol=1e-13)


def test_spacing_is_chosen_by_cost():
    grid = Grid(1024, 1024, 1.0, 1.0)
    rng = np.random.default_rng(0)
    for cells in (CellList(grid, rng.random(grid.shape) < density) for density in (1e-5, 1e-3, 1e-1)):
        chosen = ListProduct(grid, STEEL, cells=cells)
        costs = [ListProduct(grid, STEEL, spacing=spacing).cost(cells, cells) for spacing in (4, 8, 16, 32)]
        assert chosen.cost(cells, cells) <= min(costs)


@pytest.mark.parametrize("ratio", [1.0, 0.5, 3.0])
def test_stencil_is_a_preconditioner(ratio):
    grid, rng = Grid(60, 60, 1.0, ratio), np.random.default_rng(0)
    cells = CellList(grid, np.hypot(*(np.indices(grid.shape) - 30)) < 25)
    product, stencil = ListProduct(grid, STEEL), ListProduct(grid, STEEL).stencil(8)
    matrix = np.array([stencil.apply(cells, row, cells) for row in np.eye(len(cells))[::7]])[:, ::7]
    assert np.linalg.eigvalsh(matrix).min() > 0
    a, b = rng.normal(size=(2, len(cells)))
    assert abs(a @ stencil.apply(cells, b, cells) - b @ stencil.apply(cells, a, cells)) <= 1e-12 * np.abs(
        a @ stencil.apply(cells, a, cells)
    )
    checkerboard = np.where((cells.ix + cells.iy) % 2, 1.0, -1.0)
    inner = np.hypot(cells.iy - 30, cells.ix - 30) < 12
    back = stencil.apply(cells, product.apply(cells, checkerboard, cells), cells)
    np.testing.assert_allclose(back[inner], checkerboard[inner], atol=0.1)


@pytest.mark.parametrize("thickness", [0.3, 0.884, 3.0])
@pytest.mark.parametrize("young", [(219.0, 1.0), (0.01, 1.0), (1.0, np.inf)])
def test_stencil_of_layers_is_positive_definite(young, thickness):
    grid = Grid(500, 500, 1.0, 1.0)
    kernel = Material.coated(young, (0.45, 0.3), thickness).kernel
    stencil, grid = ListProduct(grid, kernel, spacing=8).stencil(8), Grid(40, 40, 1.0, 1.0)
    cells = CellList(grid, np.ones(grid.shape, bool))
    matrix = np.array([stencil.apply(cells, row, cells) for row in np.eye(len(cells))])
    assert np.linalg.eigvalsh(matrix).min() > 0


@pytest.mark.parametrize(
    "material",
    [
        Material.from_contact_modulus(2.0),
        Material.layer(1.0, 0.45, 5.0),
        Material.layer(1.0, 0.3, 1e4, other=(2.0, 0.3)),
        Material.coated((50.0, 1.0), (0.3, 0.3), 0.5),
    ],
)
def test_uniform_displacement_is_the_sum_of_coefficients(material):
    grid = Grid(150, 90, 1.0, 1.3)
    cells = CellList(grid, np.array([0, 77, 4000, 6100, grid.n - 1]))
    coefficients = material.kernel.coefficients(grid, np.arange(grid.ny), grid.nx)
    offsets = [
        (abs(np.arange(grid.ny) - j), abs(np.arange(grid.nx) - i))
        for j, i in zip(cells.iy, cells.ix, strict=True)
    ]
    sums = [coefficients[np.ix_(*offset)].sum() for offset in offsets]
    np.testing.assert_allclose(uniform_displacement(material.kernel, cells), sums, rtol=1e-6)


class OtherBodies(Kernel):
    """Bodies with another displacement by a point force."""


@pytest.mark.parametrize("periodic", ["", "x", "y", "love", "spectral"])
def test_other_patches_and_bodies_have_no_list_product(periodic):
    grid, kernel = Grid(8, 8, 1.0, 1.0, periodic=periodic), STEEL if periodic else OtherBodies(1.0)
    assert not ListProduct.suits(grid, kernel)
    with pytest.raises(InputError):
        ListProduct(grid, kernel)


@pytest.mark.parametrize("thickness", [0.5, 3.0, 30.0, 1000.0])
@pytest.mark.parametrize("young", [(1.0, 10.0), (50.0, 1.0), (1.0, np.inf)])
@pytest.mark.parametrize("name", ["square", "wide", "long cells"])
def test_error_of_layers_is_below_bound(name, young, thickness):
    grid, rng = GRIDS[name], np.random.default_rng(0)
    kernel = Material.coated(young, (0.4, 0.3), thickness * max(grid.dx, grid.dy)).kernel
    product = ListProduct(grid, kernel, spacing=4)
    for sources in lists(grid, rng):
        p = rng.normal(size=len(sources))
        assert_error_is_below_bound(product, sources, p, CellList(grid, np.ones(grid.shape, bool)))


@pytest.mark.parametrize("kernel", [STEEL, Material.coated((50.0, 1.0), (0.4, 0.3), 7.0).kernel])
@pytest.mark.parametrize("longest", [1.0, 70.0, 1e3, 1e4])
def test_fit_is_within_its_error(kernel, longest):
    nearest = 60.0
    t, weights, error = fit_gaussians(kernel.point_influence, 3.0 / nearest, nearest, longest)
    r = np.geomspace(nearest, max(longest, nearest), 20001)
    point_force = kernel.point_influence(r)
    assert t.max() <= 3.0 / nearest
    assert np.abs(np.exp(-(np.outer(r, t) ** 2)) @ weights - point_force).max() <= error
    assert error <= 1e-7 * point_force[0]
