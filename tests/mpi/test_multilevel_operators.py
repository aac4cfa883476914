"""Multilevel operators on several ranks against one."""

from functools import partial
from itertools import product

import numpy as np
import pytest

from app import Material
from app.halfspace.fft.multiplier import Layout
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.one_way_kernel import patch_kernel
from app.methods.free.padded_inverse import PaddedInverse
from app.methods.multilevel_operators import (
    create_circulant_inverse,
    create_multilevel_influence,
    create_multilevel_inverse,
)
from app.parallel.slabs import Slabs

SHAPES = [(128, 140, 0.12), (257, 150, 0.12), (150, 129, 0.12), (257, 140, 0.04), (130, 260, 0.5)]


def kind(multiplier):
    return getattr(multiplier, "func", multiplier).__name__


MULTIPLIERS = [
    *product(SHAPES, [partial(create_circulant_inverse, apart=True), create_multilevel_influence]),
    *product([(512, 264, 0.1), (268, 514, 0.03), (258, 514, 0.3)], [create_multilevel_inverse]),
]
ONE_WAY = [((128, 140, 0.12), "x"), ((256, 150, 0.12), "y"), ((256, 140, 0.04), "y"), ((130, 260, 0.5), "x")]


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize(
    ("shape", "multiplier"), MULTIPLIERS, ids=[f"{shape}-{kind(of)}" for shape, of in MULTIPLIERS]
)
@pytest.mark.parametrize("dealt", ["even", "thin", "nothing at the ends"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_multilevel_product_on_ranks_is_that_on_one(comm, shape, dealt, dtype, multiplier):
    periodic = "spectral" if multiplier is create_multilevel_inverse else ""
    compare(comm, shape, dealt, dtype, multiplier, periodic)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize(("shape", "periodic"), ONE_WAY)
@pytest.mark.parametrize("dealt", ["even", "thin", "nothing at the ends"])
@pytest.mark.parametrize(
    "multiplier", [partial(create_circulant_inverse, apart=True), create_multilevel_influence], ids=kind
)
def test_products_periodic_in_one_direction(comm, shape, periodic, dealt, multiplier):
    compare(comm, shape, dealt, np.float64, multiplier, periodic)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("shape", [(128, 140, 0.12), (30, 40, 0.1)])
@pytest.mark.parametrize("dealt", ["even", "thin", "nothing at the ends"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_inverse_of_layers(comm, shape, dealt, dtype):
    kernel = Material.coated((5.0, 1.0), (0.3, 0.3), 0.5).kernel
    compare(comm, shape, dealt, dtype, PaddedInverse, "", kernel)


def compare(comm, shape, dealt, dtype, multiplier, periodic, kernel=UNIT):
    """Check a product on these ranks against one on a single rank."""
    ny, nx, dy = shape
    starts = {
        "even": Slabs(ny, comm.size).starts,
        "thin": [0, *(2 * rank + 1 for rank in range(comm.size - 1)), ny],  # of odd rows, of one and two
        "nothing at the ends": [0, 0, *[ny] * (comm.size - 1)],
    }[dealt]
    slabs = Slabs.starting(starts, comm.rank)
    grid = Grid(nx, ny, 0.1, dy, periodic=periodic)
    kernel = patch_kernel(kernel, grid)
    alone = multiplier(grid, kernel, Layout(dtype=dtype))
    here = multiplier(grid, kernel, Layout(slabs, comm, dtype))
    field = np.random.default_rng(1).normal(size=grid.shape)
    expected, product_here = np.empty(grid.shape), field[slabs.rows].copy()
    alone.apply(field, expected)
    here.apply(product_here, product_here)
    tolerance = 10 * np.finfo(dtype).eps * abs(expected).max()
    np.testing.assert_allclose(product_here, expected[slabs.rows], rtol=0, atol=tolerance)
