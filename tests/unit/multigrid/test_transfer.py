"""Restriction and prolongation of Sec. 4.2 and 4.3, on even, odd and thin grids."""

import numpy as np
import pytest
from operators import mat_times, restriction_mat
from petsc4py import PETSc

from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.multigrid.transfer import Transfer

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
    return Transfer(InfluenceOperator(fine, UNIT), InfluenceOperator(coarse, UNIT), factors)


def children(shape, factors, j, i):
    """Return a slice of the existing children of a coarse cell."""
    return np.s_[j * factors[0] : (j + 1) * factors[0], i * factors[1] : (i + 1) * factors[1]]


def field(shape, seed=1):
    return np.random.default_rng(seed).normal(size=shape)


def some_cells(shape, seed=2):
    return np.random.default_rng(seed).random(shape) < 0.3


@each_case
def test_defect_is_the_average_of_four_children_with_zero_for_missing_ones(shape, factors):
    transfer, fine = make_transfer(shape, factors), field(shape)
    coarse = transfer.restrict_defect(fine)
    for (j, i), value in np.ndenumerate(coarse):
        assert value == pytest.approx(
            fine[children(shape, factors, j, i)].sum() / np.prod(factors), rel=1e-14
        )


@pytest.mark.parametrize(
    ("name", "arguments", "least"), [("restrict_defect", 1, 1), ("add_copies", 2, 1), ("interpolate", 2, 3)]
)
def test_flops_of_transfers_are_logged(name, arguments, least):
    """A few per fine cell."""
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
def test_copy_sets_children_to_their_parent(shape, factors):
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
def test_mats_restrict_and_prolong_in_the_contact_set(shape, factors):
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


@pytest.mark.parametrize("shape", [(31, 22), (46, 31), (33, 33)])
def test_long_waves_survive_restriction_to_an_odd_grid(shape):
    ny, nx = shape
    fine = Grid(nx, ny, 1 / nx, 1 / ny, periodic="spectral")
    coarse = fine.coarsen()
    transfer = Transfer(InfluenceOperator(fine, UNIT), InfluenceOperator(coarse, UNIT), (2, 2))

    def wave(grid):
        return np.cos(2 * np.pi * grid.x() + 1)[None, :] + np.sin(2 * np.pi * grid.y() + 2)[:, None]

    restricted, found = transfer.restrict_shape(wave(fine)), np.empty(shape)
    off = np.pi * (1 / nx + 1 / ny)  # half a fine cell
    np.testing.assert_allclose(restricted, wave(coarse), rtol=0, atol=off + 0.02)
    transfer.interpolate(wave(coarse), found)
    np.testing.assert_allclose(found, wave(fine), rtol=0, atol=0.1)  # between centres, there is no such error
    assert transfer.restrict_defect(found).sum() == pytest.approx(found.sum() / 4)  # nothing is lost
