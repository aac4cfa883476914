"""Products u = A p: dense, padded, in a box, periodic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from operators import GRIDS, PERIODIC, STEEL, matrix_of, random_field

from app import Material
from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant, quadrant_rows
from app.halfspace.kernel import UNIT
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.operator import InfluenceOperator
from app.halfspace.product import BoxProduct, Convolution, DenseProduct

ROUNDING = {np.float64: 2e-14, np.float32: 2e-6}  # measured: 5e-15 and 5e-7 of the largest displacement


def fields(shape, rng):
    ny, nx = shape
    edges = np.zeros(shape)
    edges[: ny // 8], edges[:, -nx // 9 :] = 1.0, 2.0
    corners = np.zeros(shape)
    corners[[0, 0, -1], [0, -1, -1]] = 1.0
    return rng.normal(size=shape), np.ones(shape), edges, corners


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@settings(max_examples=8, deadline=None)
@given(nx=st.integers(170, 330), ny=st.integers(170, 330), ratio=st.floats(0.6, 1.7), seed=st.integers(0, 99))
def test_box_product_equals_padded_product(dtype, nx, ny, ratio, seed):
    grid = Grid(nx, ny, 1.0, ratio)
    padded = Convolution(lambda rows: influence_quadrant(grid, STEEL, rows), grid.shape)
    product = BoxProduct(grid, STEEL).in_precision(dtype)
    rng = np.random.default_rng(seed)
    mask = rng.random(grid.shape) < 0.5
    for p in fields(grid.shape, rng):
        for contact in (None, mask):
            expected, u = np.empty(grid.shape), np.empty(grid.shape, dtype)
            padded.apply(p, expected, contact)
            product.apply(p.astype(dtype), u, contact)
            assert np.abs(u - expected).max() <= ROUNDING[dtype] * np.abs(expected).max()


@pytest.mark.parametrize("thickness", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("young", [(1.0, 10.0), (10.0, 1.0), (1.0, np.inf)])
def test_box_product_of_layers_equals_padded_product(young, thickness):
    grid = Grid(180, 200, 1.0, 1.2)
    kernel = Material.coated(young, (0.3, 0.3), thickness).kernel
    padded = Convolution(lambda rows: influence_quadrant(grid, kernel, rows), grid.shape)
    product = BoxProduct(grid, kernel)
    for p in fields(grid.shape, np.random.default_rng(0)):
        expected, u = np.empty(grid.shape), np.empty(grid.shape)
        padded.apply(p, expected)
        product.apply(p, u)
        assert np.abs(u - expected).max() <= 1e-9 * np.abs(expected).max()  # the coefficients' accuracy


def assert_box_product_is_padded_product(grid, kernel, double, single):
    kernel = patch_kernel(kernel, grid)
    padded, box = (
        Convolution(quadrant_rows(grid, kernel), grid.shape, repeats=grid.repeats),
        BoxProduct(grid, kernel),
    )
    for p in fields(grid.shape, np.random.default_rng(0)):
        expected = np.empty(grid.shape)
        padded.apply(p, expected)
        for dtype, limit in ((np.float64, double), (np.float32, single)):
            u = np.empty(grid.shape, dtype)
            box.in_precision(dtype).apply(p.astype(dtype), u)
            assert np.abs(u - expected).max() <= limit * np.abs(expected).max()


@pytest.mark.parametrize(
    "grid",
    [
        Grid(170, 180, 1.0, 1.2, periodic="y"),
        Grid(205, 171, 1.0, 0.8, periodic="y"),
        Grid(180, 201, 1.0, 1.5, periodic="x"),
    ],
)
def test_box_product_of_patches_periodic_in_one_direction_equals_padded_product(grid):
    assert_box_product_is_padded_product(grid, STEEL, ROUNDING[np.float64], ROUNDING[np.float32])
    for young in ((1.0, 10.0), (10.0, 1.0)):
        kernel = Material.coated(young, (0.3, 0.3), 5.0).kernel
        assert_box_product_is_padded_product(grid, kernel, 1e-9, ROUNDING[np.float32])


def test_box_product_of_a_part_of_the_period_equals_padded_product():
    whole, part = Grid(180, 300, 1.0, 1.0, periodic="y"), Grid(180, 200, 1.0, 1.0)
    kernel = patch_kernel(STEEL, whole)
    assert_box_product_is_padded_product(part, kernel, ROUNDING[np.float64], ROUNDING[np.float32])


def test_box_product_is_used_on_large_grids_of_moderate_aspect():
    single, double = (np.dtype(kind) for kind in (np.float32, np.float64))
    assert not BoxProduct.suits(Grid(300, 300, 1.0, 1.0), UNIT, single)
    assert BoxProduct.suits(Grid(400, 400, 1.0, 1.0), UNIT, single)
    assert not BoxProduct.suits(Grid(400, 400, 1.0, 1.0), UNIT, double)
    assert not BoxProduct.suits(Grid(400, 400, 1.0, 4.0), UNIT, single)
    operator = InfluenceOperator(Grid(660, 650, 1.0, 1.0), STEEL, dtype=np.float32)
    operator.prepare("exact_product", "product")
    assert isinstance(operator.exact_product, BoxProduct)


def test_box_product_pads_the_free_direction_only():
    single, grid = np.dtype(np.float32), Grid(400, 401, 1.0, 1.0, periodic="y")
    kernel, part = patch_kernel(UNIT, grid), Grid(400, 360, 1.0, 1.0)
    assert BoxProduct.suits(grid, kernel, single) and BoxProduct.periods_of(grid)[0] == 401
    assert not BoxProduct.suits(part, kernel, single)  # its copies are nearer than the images of the box
    assert not BoxProduct.suits(Grid(400, 400, 1.0, 1.0, periodic="x"), kernel, single)


each_periodic_grid = pytest.mark.parametrize("grid", PERIODIC.values(), ids=PERIODIC.keys())


def test_small_grids_have_dense_products():
    assert isinstance(InfluenceOperator(GRIDS["two rows"], UNIT).product, DenseProduct)
    assert isinstance(InfluenceOperator(GRIDS["even"], UNIT).product, Convolution)


@each_periodic_grid
def test_periodic_matrix_is_symmetric_semidefinite_with_constants_as_kernel(grid):
    matrix = matrix_of(grid)
    values = np.linalg.eigvalsh(matrix)
    assert (matrix == matrix.T).all()
    assert abs(matrix.sum(axis=0)).max() <= 1e-14 * grid.n * values[-1]
    assert abs(values[0]) <= 1e-14 * values[-1] < 1e-3 * values[1]


@each_periodic_grid
def test_periodic_inverse_is_exact_on_fields_without_mean(grid):
    operator, p = InfluenceOperator(grid, STEEL), random_field(grid, 2)
    u, back = np.empty(grid.shape), np.empty(grid.shape)
    operator.exact_displacement(p, u)
    operator.exact_inverse.apply(u, back)
    np.testing.assert_allclose(back, p - p.mean(), rtol=0, atol=1e-13 * abs(p).max())
    assert operator.exact_inverse.norm() * np.linalg.eigvalsh(matrix_of(grid))[1] == pytest.approx(
        1, rel=1e-10
    )
    assert operator.diagonal == pytest.approx(matrix_of(grid)[0, 0], rel=1e-14)


@each_periodic_grid
@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e3])
def test_screened_product_solves_half_space_on_springs(grid, stiffness):
    """(B + stiffness) u = p, also for the mean of p, which without springs displaces nothing."""
    operator, p = InfluenceOperator(grid, STEEL), 1 + random_field(grid, 2)
    stiffness /= operator.diagonal
    screened, u, back = operator.screened_product, np.empty(grid.shape), np.empty(grid.shape)
    for value in (7 * stiffness, stiffness):
        screened.screen(value)
    screened.apply(p, u)
    operator.exact_inverse.apply(u, back)
    np.testing.assert_allclose(back + stiffness * u, p, rtol=0, atol=1e-12 * abs(p).max())
