"""The influence operator on one and several ranks against the dense matrix."""

from contextlib import contextmanager
from unittest import mock

import numpy as np
import pytest
from mpi4py import MPI
from operators import (
    BOXED,
    BOXED_ONE_WAY,
    DOUBLE,
    GRIDS,
    PERIODIC,
    SINGLE,
    STEEL,
    make_convolution,
    matrix_of,
    random_field,
    slabs_of,
)
from petsc4py import PETSc

from app.halfspace.fft import transpose
from app.halfspace.influence import influence_quadrant
from app.halfspace.operator import InfluenceOperator

ALL = GRIDS | PERIODIC
each_grid = pytest.mark.parametrize("grid", ALL.values(), ids=ALL.keys())
each_block = pytest.mark.parametrize("block", [1, 8])  # 8: some ranks own no rows


@contextmanager
def many_groups():
    """Let even small products use several column groups."""
    with mock.patch.object(transpose, "_GROUP_BYTES", 1024):
        yield


def random_mask(grid, seed, share=0.4):
    mask = np.random.default_rng(seed).random(grid.shape) < share
    mask[grid.ny // 2 :] &= grid.ny < 4  # ranks without a cell in contact
    return mask


def dense_product(grid, p):
    return (matrix_of(grid) @ p.reshape(-1)).reshape(grid.shape)


def assert_close(comm, found, expected, tolerance):
    """Compare this rank's rows; `expected` is the whole field's."""
    mine, whole = expected
    error = np.abs(found - mine).max(initial=0.0) / np.abs(whole).max()
    assert comm.allreduce(error, MPI.MAX) <= tolerance, error


def assert_product(comm, grid, block=1, dtype=np.float64, tolerance=DOUBLE):
    """A p and C A C p are those of the dense matrix, also in place and again."""
    product = make_convolution(comm, grid, block, dtype)
    rows = slabs_of(comm, grid, block).rows
    for seed in (1, 2):
        p, mask = random_field(grid, seed), random_mask(grid, seed)
        expected, masked = dense_product(grid, p), mask * dense_product(grid, p * mask)
        out = np.full(p[rows].shape, np.nan)
        given = p[rows].copy()
        product.apply(given, out)
        assert (given == p[rows]).all()
        assert_close(comm, out, (expected[rows], expected), tolerance)
        product.apply(given, given)
        assert (given == out).all()
        out[...] = np.nan
        product.apply(p[rows].copy(), out, mask[rows])
        assert (out[~mask[rows]] == 0).all()
        assert_close(comm, out, (masked[rows], expected), tolerance)
        in_place = p[rows].copy()
        product.apply(in_place, in_place, mask[rows])
        assert (in_place == out).all()
    assert product.count == 8


@pytest.mark.mpi(1, 2, 3)
@each_grid
@each_block
def test_product_equals_dense_matrix(comm, grid, block):
    assert_product(comm, grid, block)
    with many_groups():
        assert_product(comm, grid, block)


@pytest.mark.mpi(1, 2, 3)
@each_grid
def test_single_precision_product_is_accurate(comm, grid):
    assert_product(comm, grid, dtype=np.float32, tolerance=SINGLE)


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("grid", [BOXED, BOXED_ONE_WAY], ids=["free", "periodic in y"])
def test_box_product_does_not_depend_on_ranks(comm, grid, dtype):
    slabs, tolerance = slabs_of(comm, grid), {np.float64: 2 * DOUBLE, np.float32: 2 * SINGLE}[dtype]
    p, mask = random_field(grid, 5), random_mask(grid, 5)
    padded = InfluenceOperator(grid, STEEL)
    product = make_convolution(comm, grid, dtype=dtype)
    for contact in (None, mask):
        u, expected = np.empty((slabs.local, grid.nx), dtype), np.empty(grid.shape)
        padded.product.apply(p, expected, contact)
        product.apply(p[slabs.rows].astype(dtype), u, None if contact is None else contact[slabs.rows])
        assert_close(comm, u, (expected[slabs.rows], expected), tolerance)


@pytest.mark.mpi(1, 2, 3)
@each_grid
@each_block
def test_mat_follows_changing_contact_sets(comm, grid, block):
    slabs = slabs_of(comm, grid, block)
    operator = InfluenceOperator(grid, STEEL, slabs, comm if comm.size > 1 else None)
    mat = operator.mat(PETSc.Comm(comm))
    assert mat.getSize() == (grid.n, grid.n)
    x, y = mat.createVecs()
    assert x.getLocalSize() == slabs.local * grid.nx
    p = random_field(grid, 3)
    x.setArray(p[slabs.rows].reshape(-1))
    whole = dense_product(grid, p)
    for seed, share in ((4, 0.4), (5, 1.1), (6, -1)):  # some cells, all in the first half, none
        number = operator.contact_version
        mask = random_mask(grid, seed, share)
        operator.mask[...] = mask[slabs.rows]
        mat.assemble()
        assert operator.contact_version > number
        assert mat.isSymmetric() and mat.isHermitian()  # PETSc forgets it with other entries
        mat.mult(x, y)
        expected = mask * dense_product(grid, p * mask)
        found = y.getArray(readonly=True).reshape(operator.local_shape)
        assert_close(comm, found, (expected[slabs.rows], whole), DOUBLE)
    assert operator.products == 3
    mat.getDiagonal(y)
    own = influence_quadrant(grid, STEEL)[0, 0]
    assert y.getArray(readonly=True) == pytest.approx(own, rel=1e-14)
    u = np.empty(operator.local_shape)
    operator.displacement(p[slabs.rows].copy(), u)
    assert_close(comm, u, (whole[slabs.rows], whole), DOUBLE)
    x.destroy()
    y.destroy()
    mat.destroy()


def mat_of(comm, grid, block):
    """Mat of all cells, its operator and its dense matrix."""
    slabs = slabs_of(comm, grid, block)
    operator = InfluenceOperator(grid, STEEL, slabs, comm if comm.size > 1 else None)
    return operator.mat(), operator, matrix_of(grid)


def assert_is(mat, operator, dense, seed=7):
    """A Mat multiplies, and has norms and a diagonal, like a dense matrix."""
    rows, p = operator.slabs.rows, random_field(operator.grid, seed)
    x, y = mat.createVecs()
    x.setArray(p[rows].reshape(-1))
    mat.mult(x, y)
    found = y.getArray(readonly=True).reshape(operator.local_shape)
    expected = (dense @ p.reshape(-1)).reshape(p.shape)
    error = np.abs(found - expected[rows]).max(initial=0.0)
    assert error <= DOUBLE * np.abs(dense).sum(1).max() * np.abs(p).max()
    columns = np.abs(dense).sum(0).max()
    for kind, norm in (("NORM_1", columns), ("INFINITY", columns), ("FROBENIUS", np.linalg.norm(dense))):
        assert mat.norm(getattr(PETSc.NormType, kind)) == pytest.approx(norm, rel=1e-11)
    for vec in (x, y):
        vec.destroy()


@pytest.mark.mpi(1, 2, 3)
@each_grid
def test_new_operator_has_all_cells_in_contact(comm, grid):
    mat, operator, dense = mat_of(comm, grid, 1)
    assert_is(mat, operator, dense)
    mat.destroy()
