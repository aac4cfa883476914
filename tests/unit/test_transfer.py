"""Restriction and prolongation of Sec. 4.2 and 4.3, on even, odd and thin grids."""

from itertools import pairwise

import numpy as np
import pytest
from mpi4py import MPI
from operators import mat_times, restriction_mat
from petsc4py import PETSc

from app.halfspace.grid import Grid
from app.halfspace.operator import InfluenceOperator
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.transfer import Transfer
from app.parallel.slabs import Slabs

# shape (ny, nx) and factors (fy, fx)
CASES = [
    ((8, 6), (2, 2)),
    ((7, 9), (2, 2)),
    ((1, 9), (1, 2)),
    ((10, 3), (2, 1)),
    ((2, 2), (2, 2)),
    ((5, 4), (2, 2)),
]
each_case = pytest.mark.parametrize(("shape", "factors"), CASES)


def make_transfer(shape, factors):
    (ny, nx), (fy, fx) = shape, factors
    fine = Grid(nx, ny, 0.5, 0.25, x0=-1.0, y0=3.0)
    coarse = Grid(-(-nx // fx), -(-ny // fy), fx * fine.dx, fy * fine.dy, fine.x0, fine.y0)
    return Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), factors)


def children(shape, factors, j, i):
    """Fine cells of a coarse cell that exist."""
    return np.s_[j * factors[0] : (j + 1) * factors[0], i * factors[1] : (i + 1) * factors[1]]


def field(shape, seed=1):
    return np.random.default_rng(seed).normal(size=shape)


def some_cells(shape, seed=2):
    return np.random.default_rng(seed).random(shape) < 0.3


@each_case
def test_defect_is_averaged_over_four_children_of_which_missing_ones_are_zero(shape, factors):
    transfer, fine = make_transfer(shape, factors), field(shape)
    coarse = transfer.restrict_defect(fine)
    for (j, i), value in np.ndenumerate(coarse):
        assert value == pytest.approx(
            fine[children(shape, factors, j, i)].sum() / np.prod(factors), rel=1e-14
        )


@each_case
def test_restriction_is_the_scaled_transpose_of_the_copy(shape, factors):
    transfer, fine = make_transfer(shape, factors), field(shape)
    coarse, copied = field(transfer.coarse.grid.shape, 3), np.empty(shape)
    transfer.copy(coarse, copied)
    restricted = transfer.restrict_defect(fine)
    assert np.vdot(restricted, coarse) == pytest.approx(np.vdot(fine, copied) / np.prod(factors), rel=1e-13)


@pytest.mark.parametrize(
    ("name", "arguments", "least"),
    [("restrict_defect", 1, 1), ("add_copies", 2, 1), ("interpolate", 2, 3)],
)
def test_flops_of_transfers_are_logged(name, arguments, least):
    """Some for each fine cell."""
    transfer = make_transfer((8, 6), (2, 2))
    fields = [field((8, 6))] if arguments == 1 else [field((4, 3)), field((8, 6))]
    before = PETSc.Log.getFlops()
    getattr(transfer, name)(*fields)
    assert least * 48 <= PETSc.Log.getFlops() - before <= 10 * 48


@each_case
def test_coarse_cell_is_in_contact_if_a_child_is(shape, factors):
    transfer = make_transfer(shape, factors)
    for cells in (some_cells(shape), np.zeros(shape, bool), np.ones(shape, bool)):
        transfer.fine.mask[...] = cells
        transfer.coarse.mask[...] = ~transfer.coarse.mask  # what was there before must not matter
        transfer.restrict_contact()
        for (j, i), inside in np.ndenumerate(transfer.coarse.mask):
            assert inside == cells[children(shape, factors, j, i)].any()


@each_case
def test_shape_is_the_mean_of_admissible_children(shape, factors):
    transfer = make_transfer(shape, factors)
    fine = np.where(some_cells(shape), np.nan, field(shape))
    fine[children(shape, factors, 0, 0)] = np.nan
    coarse, lowest = transfer.restrict_shape(fine), transfer.restrict_minimum(fine)
    assert np.isnan(coarse[0, 0])
    for (j, i), value in np.ndenumerate(coarse):
        mine = fine[children(shape, factors, j, i)]
        if np.isnan(mine).all():
            assert np.isnan(value)
            assert np.isnan(lowest[j, i])
        else:
            assert value == pytest.approx(np.nanmean(mine), rel=1e-14)
            assert lowest[j, i] == np.nanmin(mine)


@each_case
def test_copy(shape, factors):
    transfer = make_transfer(shape, factors)
    coarse, fine = field(transfer.coarse.grid.shape), np.full(shape, np.nan)
    transfer.copy(coarse, fine)
    for (j, i), value in np.ndenumerate(coarse):
        assert (fine[children(shape, factors, j, i)] == value).all()
    np.testing.assert_allclose(transfer.restrict_shape(fine), coarse, rtol=1e-14)


@each_case
def test_correction_is_added_in_the_contact_set_only(shape, factors):
    transfer = make_transfer(shape, factors)
    transfer.fine.mask[...] = some_cells(shape)
    coarse, before, copied = field(transfer.coarse.grid.shape), field(shape, 4), np.empty(shape)
    transfer.copy(coarse, copied)
    fine = before.copy()
    transfer.add_copies(coarse, fine)
    np.testing.assert_array_equal(fine, np.where(transfer.fine.mask, before + copied, before))


@each_case
def test_interpolation_is_exact_for_bilinear_functions_up_to_the_rim(shape, factors):
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


def test_interpolation_weights_inside_are_nine_three_three_one():
    transfer = make_transfer((12, 12), (2, 2))
    coarse, fine = np.zeros((6, 6)), np.empty((12, 12))
    coarse[3, 2] = 16
    transfer.interpolate(coarse, fine)
    line = np.array([1, 3, 3, 1])
    np.testing.assert_allclose(fine[5:9, 3:7], np.outer(line, line), rtol=1e-14)
    assert fine.sum() == pytest.approx(64, rel=1e-14)


def test_interpolation_of_smooth_functions_is_of_second_order():
    errors = []
    for n in (16, 32, 64):
        fine, coarse = Grid(n, n, 1 / n, 1 / n), Grid(n // 2, n // 2, 2 / n, 2 / n)
        transfer = Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), (2, 2))

        def function(grid):
            return np.sin(3 * grid.x()[None, :]) * np.exp(grid.y()[:, None])

        found = np.empty(fine.shape)
        transfer.interpolate(function(coarse), found)
        errors.append(np.abs(found - function(fine)).max())
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.15)


@each_case
def test_as_matrices_of_petsc(shape, factors):
    transfer = make_transfer(shape, factors)
    transfer.fine.mask[...] = some_cells(shape)
    transfer.restrict_contact()
    fine, coarse = field(shape), field(transfer.coarse.grid.shape, 3)
    restriction = restriction_mat(transfer, PETSc.COMM_SELF)
    interpolation = transfer.interpolation_mat(PETSc.COMM_SELF)
    assert restriction.getSize() == interpolation.getSize()[::-1] == (coarse.size, fine.size)

    restricted = transfer.coarse.mask * transfer.restrict_defect(fine * transfer.fine.mask)
    np.testing.assert_array_equal(mat_times(restriction, fine), restricted.reshape(-1))
    copied = np.zeros(shape)
    transfer.add_copies(coarse, copied)
    np.testing.assert_array_equal(mat_times(interpolation, coarse), copied.reshape(-1))

    # y = v + P x, the way PCMG calls it: in place, and with another vector
    x, y = interpolation.createVecs()
    v = y.duplicate()
    x.setArray(coarse.reshape(-1))
    for other in (y, v):
        y.set(1)
        v.set(1)
        interpolation.multAdd(x, other, y)
        np.testing.assert_array_equal(y.getArray(readonly=True), 1 + copied.reshape(-1))
    for thing in (x, y, v, restriction, interpolation):
        thing.destroy()


@pytest.mark.parametrize("shape", [(256, 256), (37, 100), (1, 1000), (5, 3), (1, 1)])
def test_grids_of_a_hierarchy(shape):
    ny, nx = shape
    hierarchy = Hierarchy(Grid(nx, ny, 0.1, 0.1), 1.0, MPI.COMM_SELF, coarsest=4)
    grids = [level.grid for level in hierarchy.levels]
    assert grids[-1].shape == shape
    assert max(grids[0].shape) <= 4
    for coarse, fine in pairwise(grids):
        for n_coarse, n_fine in zip(coarse.shape, fine.shape, strict=True):
            assert n_coarse == (-(-n_fine // 2) if n_fine > 4 else n_fine)
        assert coarse.nx * coarse.dx >= fine.nx * fine.dx * (1 - 1e-14)  # no cell gets lost
        assert (coarse.x0, coarse.y0) == (fine.x0, fine.y0)


@pytest.mark.parametrize("ny", [1, 5, 16, 37])
@pytest.mark.parametrize("size", [1, 2, 3, 7])
@pytest.mark.parametrize("block", [1, 4])
def test_slabs_are_a_partition_that_coarsens(ny, size, block):
    all_rows = []
    for rank in range(size):
        slabs = Slabs(ny, size, rank, block)
        assert slabs.local == slabs.counts[rank] == slabs.rows.stop - slabs.rows.start
        assert slabs.rows.start % block == 0 or slabs.rows.start == ny
        all_rows += range(ny)[slabs.rows]
        coarse = slabs
        while coarse.ny > 1:  # the parent is where the first child is
            fine, coarse = coarse, coarse.coarsen(2)
            assert coarse.ny == -(-fine.ny // 2)
            firsts = [j // 2 for j in range(fine.ny)[fine.rows] if j % 2 == 0]
            assert firsts == list(range(coarse.ny)[coarse.rows])
    assert all_rows == list(range(ny))
