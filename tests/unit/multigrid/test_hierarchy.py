"""Grids, operators and transfers of a problem."""

from itertools import pairwise

import numpy as np
import pytest
from mpi4py import MPI

from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.multigrid.hierarchy import Hierarchy


@pytest.mark.parametrize("shape", [(256, 256), (37, 100), (1, 1000), (5, 3), (1, 1)])
def test_grids_are_halved_down_to_the_coarsest(shape):
    ny, nx = shape
    hierarchy = Hierarchy(Grid(nx, ny, 0.1, 0.1), UNIT, MPI.COMM_SELF, coarsest=4)
    grids = [level.grid for level in hierarchy.levels]
    assert grids[-1].shape == shape
    assert max(grids[0].shape) <= 4
    for coarse, fine in pairwise(grids):
        for n_coarse, n_fine in zip(coarse.shape, fine.shape, strict=True):
            assert n_coarse == (-(-n_fine // 2) if n_fine > 4 else n_fine)
        assert coarse.nx * coarse.dx >= fine.nx * fine.dx * (1 - 1e-14)  # no cell gets lost
        assert (coarse.x0, coarse.y0) == (fine.x0, fine.y0)


def test_odd_periodic_grids_are_halved():
    shapes = [
        [
            level.grid.shape
            for level in Hierarchy(Grid(nx, ny, 1.0, 1.0, periodic="spectral"), UNIT, MPI.COMM_SELF).levels
        ]
        for nx, ny in ((24, 40), (36, 7), (15, 7), (4, 4))
    ]
    assert shapes == [
        [(3, 3), (5, 3), (10, 6), (20, 12), (40, 24)],
        [(4, 3), (4, 5), (4, 9), (4, 18), (7, 36)],
        [(4, 4), (4, 8), (7, 15)],
        [(2, 2), (4, 4)],
    ]


def test_windowed_levels_make_no_product_before_it_is_used():
    windowed = Hierarchy(Grid(128, 128, 0.1, 0.1), UNIT, MPI.COMM_SELF, margin=0.1)
    assert [level.grid.nx for level in windowed.levels if "product" not in vars(level)] == [128]
    assert "exact_product" in vars(windowed.target)
    assert windowed.operator_applications() == 0
    whole = Hierarchy(Grid(128, 128, 0.1, 0.1), UNIT, MPI.COMM_SELF)
    assert all("product" in vars(level) for level in whole.levels)


@pytest.mark.parametrize("periodic", ["", "spectral"])
@pytest.mark.parametrize("shape", [(8, 12), (7, 15)])
def test_coarse_hardness_is_a_mean_and_infinite_above_an_elastic_cell(shape, periodic):
    ny, nx = shape
    hierarchy = Hierarchy(Grid(nx, ny, 1.0, 1.0, periodic=periodic), UNIT, MPI.COMM_SELF, coarsest=2)
    hardness = 1 + np.random.default_rng(0).random(shape)

    def on_levels(values):
        return hierarchy.hardness(values)

    finite = on_levels(hardness)
    assert all(hardness.min() <= field.min() <= field.max() <= hardness.max() for field in finite)
    hardness[3, 5] = np.inf
    for field, before in zip(on_levels(hardness), finite, strict=True):
        elastic = np.isinf(field)
        assert 1 <= elastic.sum() <= 4 and not np.isnan(field).any()
        np.testing.assert_array_equal(field[~elastic], before[~elastic])
    assert all((field == 2).all() for field in on_levels(2.0))
    assert on_levels(None) is None
