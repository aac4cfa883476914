"""Edge extension, block means and trend of the residual on several ranks against one."""

from itertools import product

import numpy as np
import pytest
from operators import STENCIL

from app.methods.free.block_average import BlockAverage
from app.methods.free.contact_edge import EdgeExtension
from app.methods.free.residual_trend import ResidualTrend
from app.parallel.slabs import Slabs

SHAPES = [
    (32, 20),
    (13, 7),
    (5, 9),
    (2, 6),
    (1, 8),
    (9, 1),
]  # slabs thinner than the band; ranks without rows


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize(
    ("shape", "block", "density", "steps", "dtype", "periodic"),
    [
        *product(SHAPES, (1, 4), (0.0, 0.05, 0.4, 1.0), (0, 1, 3), (np.float64,), (False,)),
        *product(SHAPES, (1, 4), (0.05, 0.4), (1, 3), (np.float64,), (True,)),
        ((24, 24), 1, 0.2, 3, np.float32, False),
        *(((24, 24), 1, 0.2, 3, np.float64, periodic) for periodic in "xy"),
    ],
)
def test_extension_on_ranks_is_bitwise_that_on_one(comm, shape, block, density, steps, dtype, periodic):
    rng = np.random.default_rng([*shape, block, steps, int(100 * density)])
    slabs = Slabs(shape[0], comm.size, comm.rank, block)
    alone = EdgeExtension(shape, None, None, steps, periodic)
    here = EdgeExtension((slabs.local, shape[1]), slabs, comm, steps, periodic)
    for extension in (alone, here):
        extension.set_stencil(STENCIL)
    for _ in range(2):  # the second contact set replaces the first
        contact = rng.random(shape) < density
        alone.set_contact(contact)
        here.set_contact(contact[slabs.rows].copy())
        field = rng.normal(size=shape).astype(dtype)

        expected = field * contact
        results = expected[slabs.rows].copy()
        alone.extend(expected)
        here.extend(results)
        np.testing.assert_array_equal(results, expected[slabs.rows])

        expected, results = field.copy(), field[slabs.rows].copy()
        alone.restrict(expected)
        here.restrict(results)
        mine = contact[slabs.rows]
        np.testing.assert_array_equal(results[mine], expected[slabs.rows][mine])


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("block", "cells"), [(1, 4), (4, 3), (1, 16)])
def test_block_means_on_ranks_are_those_on_one(comm, shape, block, cells):
    rng = np.random.default_rng(8)
    slabs = Slabs(shape[0], comm.size, comm.rank, block)
    alone, here = BlockAverage(shape, None, None, cells), BlockAverage(shape, slabs, comm, cells)
    contact, field = rng.random(shape) < 0.4, rng.normal(size=shape)
    expected, results = np.empty(shape), np.empty((slabs.local, shape[1]))
    r = field * contact
    alone.set_contact(contact, r)
    here.set_contact(contact[slabs.rows].copy(), r[slabs.rows].copy())
    alone.extend(r, expected)
    here.extend(r[slabs.rows].copy(), results)
    np.testing.assert_allclose(results, expected[slabs.rows], rtol=0, atol=1e-6)
    expected, results = field.copy(), field[slabs.rows].copy()
    products = alone.apply_transpose(r, expected), here.apply_transpose(r[slabs.rows].copy(), results)
    assert products[0] == pytest.approx(products[1], abs=1e-5)
    np.testing.assert_allclose(results, expected[slabs.rows], rtol=0, atol=1e-6)


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize("shape", [*SHAPES, (70, 40)])
def test_trend_of_the_residual_on_ranks_is_that_on_one(comm, shape):
    rng = np.random.default_rng(9)
    slabs, contact = Slabs(shape[0], comm.size, comm.rank), rng.random(shape) < 0.3
    r, expected, results = rng.normal(size=shape) * contact, np.zeros(shape), np.zeros(shape)
    ResidualTrend(r, contact, Slabs(shape[0]), None).add(1.0, contact, expected)
    rows = slabs.rows
    here = ResidualTrend(r[rows].copy(), contact[rows].copy(), slabs, comm)
    here.add(1.0, contact[rows].copy(), results[rows])
    np.testing.assert_allclose(results[rows], expected[rows], rtol=0, atol=1e-6)
