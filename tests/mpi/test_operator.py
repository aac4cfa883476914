"""The influence operator against the dense matrix: ``mpiexec -n 3 python tests/mpi_operator.py``.

The checks are collective and also run by `test_convolution` on one rank.
"""

from contextlib import contextmanager
from functools import cache, partial
from unittest import mock

import numpy as np
import running  # noqa: F401  (starts PETSc without this script's arguments)
from mpi4py import MPI
from petsc4py import PETSc

from app.halfspace.fft import transpose
from app.halfspace.grid import Grid, Slabs
from app.halfspace.influence import Material, dense_matrix, influence_quadrant
from app.halfspace.operator import InfluenceOperator
from app.halfspace.product import Convolution

STEEL = Material(82000.0, 0.28).compliance
GRIDS = {
    "one cell": Grid(1, 1, 0.3, 0.2),
    "one row": Grid(45, 1, 0.1, 0.4),
    "one column": Grid(1, 45, 0.1, 0.4),
    "two rows": Grid(38, 2, 1.0, 1.0),
    "even": Grid(24, 16, 0.5, 0.5),
    "odd": Grid(23, 17, 0.5, 0.5),
    "prime": Grid(29, 31, 0.3, 0.2),
    "wide cells": Grid(20, 21, 30.0, 0.1),
    "tall cells": Grid(21, 20, 0.1, 30.0),
    "many groups": Grid(240, 3, 0.2, 0.3),  # of columns
    "more than a block": Grid(40, 36, 0.2, 0.3),  # rows and columns go through the FFT 32 and 16 at a time
}
DOUBLE, SINGLE = 1e-14, 1e-6  # measured: 2e-15 and 2e-7


@contextmanager
def many_groups():
    """Let even small products use several column groups."""
    with mock.patch.object(transpose, "_GROUP_BYTES", 1024):
        yield


def slabs_of(comm, grid, block=1):
    return Slabs(grid.ny, comm.size, comm.rank, block)


def random_field(grid, seed):
    """The same field on all ranks."""
    return np.random.default_rng(seed).normal(size=grid.shape)


def random_mask(grid, seed, share=0.4):
    mask = np.random.default_rng(seed).random(grid.shape) < share
    mask[grid.ny // 2 :] &= grid.ny < 4  # ranks without a cell in contact
    return mask


@cache
def matrix_of(grid):
    return dense_matrix(grid, STEEL)


def dense_product(grid, p):
    return (matrix_of(grid) @ p.reshape(-1)).reshape(grid.shape)


def assert_close(comm, found, expected, tolerance):
    """Compare this rank's rows; `expected` is the whole field's."""
    mine, whole = expected
    error = np.abs(found - mine).max(initial=0.0) / np.abs(whole).max()
    assert comm.allreduce(error, MPI.MAX) <= tolerance, error


def make_convolution(comm, grid, block=1, dtype=np.float64):
    quadrant = partial(influence_quadrant, grid, STEEL)
    return Convolution(quadrant, grid.shape, slabs_of(comm, grid, block), comm, dtype)


def check_product(comm, grid, block=1, dtype=np.float64, tolerance=DOUBLE):
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


def check_mat(comm, grid, block=1):
    """The same as PETSc sees it, with a contact set that changes."""
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
        state = mat.stateGet()
        mask = random_mask(grid, seed, share)
        operator.mask[...] = mask[slabs.rows]
        operator.mask_changed()
        assert mat.stateGet() > state
        mat.mult(x, y)
        expected = mask * dense_product(grid, p * mask)
        found = y.getArray(readonly=True).reshape(operator.local_shape)
        assert_close(comm, found, (expected[slabs.rows], whole), DOUBLE)
    assert operator.products == 3
    mat.getDiagonal(y)
    own = influence_quadrant(grid, STEEL)[0, 0]
    assert (y.getArray(readonly=True) == own).all()
    u = np.empty(operator.local_shape)
    operator.displacement(p[slabs.rows].copy(), u)
    assert_close(comm, u, (whole[slabs.rows], whole), DOUBLE)
    x.destroy()
    y.destroy()
    operator.free()


def main():
    comm = MPI.COMM_WORLD
    for grid in GRIDS.values():
        for block in (1, 8):  # 8: some ranks own no rows
            check_product(comm, grid, block)
            with many_groups():
                check_product(comm, grid, block)
            check_mat(comm, grid, block)
        check_product(comm, grid, dtype=np.float32, tolerance=SINGLE)
    with many_groups():
        assert comm.size == 1 or len(make_convolution(comm, GRIDS["many groups"])._groups) > 4
    if comm.rank == 0:
        print(f"passed on {comm.size} ranks")


if __name__ == "__main__":
    main()
