"""Transfers on several ranks against those on one."""

import numpy as np
import pytest
from mpi4py import MPI
from operators import mat_times, restriction_mat
from petsc4py import PETSc

from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.transfer import Transfer

GRIDS = [
    Grid(32, 32, 1.0, 1.0),
    Grid(27, 37, 1.0, 0.5),
    Grid(3, 50, 1.0, 1.0),
    Grid(50, 3, 1.0, 1.0),
    Grid(9, 2, 1.0, 1.0),
    Grid(32, 40, 1.0, 1.0, periodic="spectral"),
    Grid(36, 7, 1.0, 0.5, periodic="spectral"),
    Grid(27, 37, 1.0, 0.5, periodic="spectral"),
    Grid(3, 52, 1.0, 1.0, periodic="love"),
]
CELLS = (1, 100, 10**6)  # a rank has at least: all grids are shared, but the smallest; only the larger; none


def assert_same_as_alone(comm, here, alone, seed):
    """Assert that each operation of a transfer gives this rank its rows of the serial result."""
    rng = np.random.default_rng(seed)
    fine, coarse = alone.fine.grid.shape, alone.coarse.grid.shape
    rows, coarse_rows = here.fine.slabs.rows, here.coarse.slabs.rows
    defect, pressure, u = rng.normal(size=fine), rng.normal(size=coarse), rng.normal(size=coarse)
    shape = np.where(rng.random(fine) < 0.3, np.nan, rng.normal(size=fine))
    mask = rng.random(fine) < 0.3

    alone.fine.mask[...], here.fine.mask[...] = mask, mask[rows]
    alone.restrict_contact()
    here.restrict_contact()
    np.testing.assert_array_equal(here.coarse.mask, alone.coarse.mask[coarse_rows])
    for name, field in (("restrict_defect", defect), ("restrict_shape", shape), ("restrict_minimum", shape)):
        np.testing.assert_array_equal(
            getattr(here, name)(field[rows].copy()), getattr(alone, name)(field)[coarse_rows]
        )
    upwards = [("copy", pressure), ("interpolate", u), ("add_copies", pressure)]
    upwards += [("interpolate_quintic", u)] if alone.fine.grid.periodic else []
    for name, field in upwards:
        expected = np.ones(fine)
        getattr(alone, name)(field, expected)
        found = np.ones(fine)[rows]
        getattr(here, name)(field[coarse_rows].copy(), found)
        np.testing.assert_array_equal(found, expected[rows], err_msg=name)

    for make, field, given, wanted in (
        (restriction_mat, defect, rows, coarse_rows),
        (Transfer.interpolation_mat, pressure, coarse_rows, rows),
    ):
        mats = make(here, PETSc.Comm(comm)), make(alone, PETSc.COMM_SELF)
        found, expected = mat_times(mats[0], field[given]), mat_times(mats[1], field)
        expected = expected.reshape(coarse if make is restriction_mat else fine)[wanted]
        np.testing.assert_array_equal(found, expected.reshape(-1), err_msg=make.__name__)
        for mat in mats:
            mat.destroy()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("grid", GRIDS)
def test_transfers_are_independent_of_ranks(comm, grid):
    handed_over = 0
    alone = Hierarchy(grid, UNIT, MPI.COMM_SELF)
    for cells in CELLS:
        here = Hierarchy(grid, UNIT, comm, cells_per_rank=cells)
        assert len(here.levels) == len(alone.levels)
        for level in range(1, len(here.levels)):
            assert_same_as_alone(comm, here.transfers[level], alone.transfers[level], seed=level)
            handed_over += here.levels[level - 1].slabs.size < here.levels[level].slabs.size
        here.destroy()
    assert handed_over >= 2
