"""The product in a periodic box: what the images add is smooth and taken off, to rounding."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from operators import STEEL

from app.halfspace.grid import Grid
from app.halfspace.images import Box, ImageCorrection
from app.halfspace.influence import influence_at, influence_quadrant
from app.halfspace.operator import InfluenceOperator
from app.halfspace.periodic_symbol import periodic_quadrant
from app.halfspace.product import BoxProduct, Convolution
from app.parallel.slabs import Slabs

ROUNDING = {np.float64: 2e-14, np.float32: 2e-6}  # measured: 5e-15 and 5e-7 of the largest displacement
NO_MASK = np.zeros((0, 0), bool)


def box_of(grid, periods):
    return Box(grid, periods, lambda rows, columns: influence_at(grid, rows, columns))


@pytest.mark.parametrize("periods", [(80, 80), (81, 79), (40, 120), (150, 60)])
@pytest.mark.parametrize("sides", [(1.0, 1.0), (0.2, 0.5)])
def test_kernel_is_that_of_all_images(periods, sides):
    ny, nx = periods
    patch = Grid(nx // 2 + 1, ny // 2 + 1, *sides)
    found = box_of(patch, periods).kernel(np.arange(ny // 2 + 1), np.arange(nx // 2 + 1))
    other = periodic_quadrant(Grid(nx, ny, *sides, periodic="love"), 1.0)
    assert np.abs(found - other).max() <= 1e-12 * other.max()  # both less their mean


def test_coefficients_at_any_offsets_are_those_of_the_quadrant():
    grid = Grid(40, 30, 0.3, 0.2)
    rows, columns = np.array([0, 7, 3, 29]), np.array([5, 0, 39])
    assert (influence_at(grid, rows, columns) == influence_quadrant(grid, 1.0)[np.ix_(rows, columns)]).all()


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
def test_the_product_is_the_padded_one(dtype, nx, ny, ratio, seed):
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


def test_more_nodes_for_a_cell_converge_as_they_should():
    """Between 2 k nodes the error falls with the power 2 k of their distance."""
    grid = Grid(96, 96, 1.0, 1.0)
    box, p = box_of(grid, (128, 128)), np.zeros(grid.shape)
    p[0, 0] = p[40, 50] = 1.0
    errors = {}
    for step in (8, 4, 2, 1):
        correction, u = (
            ImageCorrection(box, 1.0, (step, step), 6, Slabs(96), None, np.float64),
            np.zeros(grid.shape),
        )
        correction.multiply(p, NO_MASK)
        correction.add(u, NO_MASK)
        errors[step] = u
    errors = {step: np.abs(errors[step] - errors[1]).max() for step in (8, 4, 2)}
    assert 5 <= np.log2(errors[8] / errors[4]) <= 7
    assert 5 <= np.log2(errors[4] / errors[2]) <= 7


def test_a_rank_without_rows_adds_nothing():
    grid = Grid(40, 40, 1.0, 1.0)
    correction, none = (
        ImageCorrection(box_of(grid, (60, 60)), 1.0, (1, 1), 6, Slabs(40, 50, 49), None, np.float64),
        np.zeros((0, 40)),
    )
    correction.multiply(none, NO_MASK)
    correction.add(none, NO_MASK)


def test_large_grids_have_it_and_small_or_stretched_ones_not():
    single, double = (np.dtype(kind) for kind in (np.float32, np.float64))
    assert not BoxProduct.suits(Grid(300, 300, 1.0, 1.0), single)
    assert BoxProduct.suits(Grid(400, 400, 1.0, 1.0), single)
    assert not BoxProduct.suits(Grid(400, 400, 1.0, 1.0), double)
    assert not BoxProduct.suits(Grid(400, 400, 1.0, 4.0), single)
    operator = InfluenceOperator(Grid(660, 650, 1.0, 1.0), STEEL, dtype=np.float32)
    operator.prepare("exact_product", "product")
    assert isinstance(operator.exact_product, BoxProduct)
    assert operator.product.memory < 1.0 * operator.exact_product.memory
