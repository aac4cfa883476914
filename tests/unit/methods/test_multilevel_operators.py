"""Multilevel A and B against products by FFT."""

from functools import partial

import numpy as np
import pytest

from app import Grid, Material
from app.halfspace.fft.multiplier import EvenMultiplier, Layout, SpectrumCache
from app.halfspace.influence import influence_quadrant
from app.halfspace.kernel import UNIT, HalfSpaceKernel
from app.halfspace.product import Convolution, PeriodicProduct
from app.methods.multilevel_operators import (
    create_circulant_inverse,
    create_multilevel_influence,
    create_multilevel_inverse,
)
from app.methods.multilevel_product import MultilevelOperator
from app.methods.symbol import eigenvalues


def noise(grid):
    return np.random.default_rng(grid.ny).normal(size=grid.shape)


def cells(grid):
    return (np.random.default_rng(grid.ny).random(grid.shape) < 0.1).astype(float)


def wave(grid):
    y, x = np.mgrid[: grid.ny, : grid.nx]
    return np.cos(2 * np.pi * (3 * x / grid.nx + 2 * y / grid.ny))


def corner(grid):
    field = np.zeros(grid.shape)
    field[0, -1] = 1.0
    return field


def assert_near_and_symmetric(operator, exact, fields, energy_error):
    """Compare products; `fields`: pairs of a field and its allowed error, relative."""
    products = []
    for field, allowed in fields:
        product, expected = np.empty(field.shape), np.empty(field.shape)
        operator.apply(field, product)
        exact.apply(field, expected)
        products.append(product)
        assert np.linalg.norm(product - expected) < allowed * np.linalg.norm(expected)
        assert np.vdot(field, product) == pytest.approx(np.vdot(field, expected), rel=energy_error)
    gram = np.array([[np.vdot(field, product) for product in products] for field, _ in fields])
    np.testing.assert_allclose(gram, gram.T, rtol=0, atol=1e-13 * abs(gram).max())


FREE = {
    "square": (Grid(128, 128, 1.0, 1.0), 0.01),
    "odd": (Grid(257, 150, 1.0, 1.0), 0.01),
    "long cells": (Grid(131, 200, 5 / 3, 1.0), 0.025),
    "longer": (Grid(131, 300, 3.0, 1.0), 0.025),
    "longest": (Grid(1100, 140, 0.05, 1.0), 0.025),
    "four levels": (Grid(1030, 1024, 0.1, 0.1), 0.01),
}


@pytest.mark.parametrize(("grid", "error"), FREE.values(), ids=FREE.keys())
def test_multilevel_influence_is_near_a_and_symmetric(grid, error):
    exact = Convolution(lambda rows: influence_quadrant(grid, HalfSpaceKernel(0.5), rows), grid.shape)
    fields = [(noise(grid), error), (cells(grid), error), (np.ones(grid.shape), 1e-3), (wave(grid), 2e-3)]
    fields.append((corner(grid), 2 * error))
    assert_near_and_symmetric(create_multilevel_influence(grid, HalfSpaceKernel(0.5)), exact, fields, error)


@pytest.mark.parametrize("young", [(1.0, 10.0), (10.0, 1.0), (1.0, np.inf)])
@pytest.mark.parametrize("thickness", [1.0, 10.0, 100.0])
def test_multilevel_influence_of_layers_is_near_a_and_symmetric(young, thickness):
    grid, kernel = Grid(128, 150, 1.0, 1.0), Material.coated(young, (0.3, 0.3), thickness).kernel
    exact = Convolution(lambda rows: influence_quadrant(grid, kernel, rows), grid.shape)
    fields = [(field, 0.02) for field in (noise(grid), cells(grid), corner(grid))]
    fields += [(np.ones(grid.shape), 3e-3), (wave(grid), 3e-3)]
    assert_near_and_symmetric(create_multilevel_influence(grid, kernel), exact, fields, 0.02)


@pytest.mark.parametrize("grid", [FREE[name][0] for name in list(FREE)[:5]], ids=list(FREE)[:5])
def test_multilevel_circulant_inverse_is_near_that_by_fft_and_symmetric(grid):
    inverse = create_circulant_inverse(grid, UNIT, apart=True)
    assert isinstance(inverse, MultilevelOperator)
    exact = EvenMultiplier(grid.shape, inverse.periods)
    sides = [n * d for n, d in zip(inverse.periods, (grid.dy, grid.dx), strict=True)]

    def symbol(columns, rows):
        values = eigenvalues(grid, 1.0, 2 * columns / inverse.periods[1], 2 * rows / inverse.periods[0])
        values[(columns[:, None] == 0) & (rows == 0)] = UNIT.middle_displacement(sides)
        return 1 / values

    exact.set_spectrum(symbol)
    y, x = np.mgrid[: grid.ny, : grid.nx]
    waves = [np.cos(2 * np.pi * (k * x / grid.nx + k * y / grid.ny)) for k in (0, 1, 5, 20, 60)]
    fields = [(field, 0.03) for field in (noise(grid), *waves, np.eye(*grid.shape))]
    assert_near_and_symmetric(inverse, exact, fields, 0.03)


PERIODIC = {
    "square": (512, 512, 1.0, 0.035),
    "four levels": (1024, 1024, 1.0, 0.035),
    "once": (514, 258, 1.2, 0.035),
    "long cells": (256, 512, 1.7, 0.04),
    "longer": (512, 320, 0.3, 0.04),
    "longest": (512, 256, 20.0, 0.04),
}


@pytest.mark.parametrize("kind", ["spectral", "love"])
@pytest.mark.parametrize(("nx", "ny", "aspect", "error"), PERIODIC.values(), ids=PERIODIC.keys())
def test_multilevel_inverse_is_near_b_and_zero_on_constants(nx, ny, aspect, error, kind):
    grid = Grid(nx, ny, aspect, 1.0, periodic=kind)
    inverse = create_multilevel_inverse(grid, HalfSpaceKernel(0.5))
    exact = PeriodicProduct(partial(HalfSpaceKernel(0.5).eigenvalues, grid), grid.shape).inverse()
    fields = [(noise(grid), error), (cells(grid), error), (wave(grid), 5e-3), (corner(grid), error)]
    assert_near_and_symmetric(inverse, exact, fields, error)
    constant, scale = np.empty(grid.shape), np.empty(grid.shape)
    inverse.apply(np.ones(grid.shape), constant)
    inverse.apply(noise(grid), scale)
    assert abs(constant).max() < 1e-12 * abs(scale).max()


@pytest.mark.parametrize("young, thickness", [((1.0, 5.0), 1.0), ((5.0, 1.0), 1.0), ((5.0, 1.0), 10.0)])
def test_multilevel_inverse_of_coatings_is_near_b(young, thickness):
    grid, kernel = (
        Grid(512, 512, 1.0, 1.0, periodic="spectral"),
        Material.coated(young, (0.3, 0.3), thickness).kernel,
    )
    exact = PeriodicProduct(partial(kernel.eigenvalues, grid), grid.shape).inverse()
    fields = [(noise(grid), 0.05), (cells(grid), 0.05), (wave(grid), 0.02), (corner(grid), 0.05)]
    assert_near_and_symmetric(create_multilevel_inverse(grid, kernel), exact, fields, 0.05)


@pytest.mark.parametrize("young", [(1.0, np.inf), (30.0, 1.0)])
def test_thin_layers_of_steep_symbol_have_no_multilevel_inverse(young):
    kernel = Material.coated(young, (0.3, 0.3), 1.0).kernel
    assert create_multilevel_inverse(Grid(512, 512, 1.0, 1.0, periodic="spectral"), kernel) is None


def test_long_cells_keep_the_levels_of_the_square_cells_that_they_form():
    """Four cells of 4 x 1 mm form a square one, by two levels."""
    kernel = Material.coated((1.0, 10.0), (0.3, 0.3), 16.0).kernel
    levels = []
    for nx, dx in ((512, 4.0), (2048, 1.0)):
        operator, count = create_multilevel_inverse(Grid(nx, 512, dx, 4.0, periodic="spectral"), kernel), 0
        while isinstance(operator, MultilevelOperator):
            operator, count = operator._next, count + 1
        levels.append(count)
    assert levels[1] == levels[0] + 2


def test_multilevel_influence_of_distant_cells_is_that_of_a_point():
    grid = Grid(600, 140, 1.0, 1.0)
    p, u = np.zeros(grid.shape), np.empty(grid.shape)
    p[70, 5] = 1.0
    create_multilevel_influence(grid, UNIT).apply(p, u)
    x = np.arange(200, 600)
    np.testing.assert_allclose(u[70, x], 1 / (x - 5), rtol=2e-3)


@pytest.mark.parametrize(
    ("create", "grid"),
    [
        *((create_multilevel_influence, Grid(*shape, 1.0)) for shape in ((100, 500, 1.0), (50, 500, 4.0))),
        *(
            (create_multilevel_inverse, Grid(*shape, 1.0, 1.0, periodic="spectral"))
            for shape in ((256, 256), (513, 600), (600, 513), (512, 130))
        ),
    ],
)
def test_small_and_odd_periodic_grids_have_no_multilevel_product(create, grid):
    assert create(grid, UNIT) is None


def test_rows_may_be_left_out_and_fields_changed_in_place():
    grid, rng = Grid(140, 150, 1.0, 1.0), np.random.default_rng(0)
    inverse = create_circulant_inverse(grid, UNIT, Layout(dtype=np.float32), apart=True)
    rows = rng.random(150) < 0.5
    field = rng.normal(size=grid.shape) * rows[:, None]
    expected, product = np.empty(grid.shape), field.copy()
    inverse.apply(field, expected)
    inverse.apply(product, product, rows=rows)
    np.testing.assert_array_equal(product[rows], expected[rows])
    single = np.where(rows[:, None], field, np.nan).astype(np.float32)  # rows left out may hold anything
    inverse.apply(single, single, rows=rows)
    np.testing.assert_allclose(single[rows], expected[rows], rtol=0, atol=1e-5 * abs(expected).max())


def test_multilevel_product_costs_less_than_an_fft_of_its_cells():
    inverse = create_circulant_inverse(Grid(2048, 2048, 1.0, 1.0), UNIT, apart=True)
    before = inverse.points
    inverse.apply(np.zeros((2048, 2048)), np.zeros((2048, 2048)))
    assert before == 0
    assert inverse.points < 0.85 * 2048**2


@pytest.mark.parametrize("sides", [(3.0, 2.0), (1.0, 1.0)])
def test_constant_displaces_as_one_large_cell(sides):
    b, a = sides
    expected = influence_quadrant(Grid(1, 1, a, b), HalfSpaceKernel(0.5))[0, 0]
    assert HalfSpaceKernel(0.5).middle_displacement(sides) == pytest.approx(expected, rel=1e-13)


def test_a_product_does_not_depend_on_an_earlier_one_with_the_same_fft_length():
    earlier, grid = Grid(160, 160, 1.0, 1.0), Grid(180, 180, 1.0, 1.0)
    spectra = SpectrumCache()
    create_multilevel_influence(earlier, UNIT, Layout(spectra=spectra))
    cached = create_multilevel_influence(grid, UNIT, Layout(spectra=SpectrumCache(spectra)))
    products = []
    for product in cached, create_multilevel_influence(grid, UNIT):
        products.append(np.empty(grid.shape))
        product.apply(corner(grid), products[-1])
    np.testing.assert_array_equal(*products)
