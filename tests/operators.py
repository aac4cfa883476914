"""The influence operator on grids of all kinds, and its dense matrix."""

from functools import cache, partial

import numpy as np
from petsc4py import PETSc

from app import Grid, Material
from app.base.petsc import restricts_by_transpose
from app.halfspace.fft.multiplier import Layout
from app.halfspace.influence import dense_matrix, influence_quadrant
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.product import BoxProduct, Convolution, PeriodicProduct
from app.parallel.slabs import Slabs

STEEL = Material.combined(82000.0, 0.28).kernel
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
    "periodic in x": Grid(22, 17, 0.5, 0.3, periodic="x"),
    "periodic in y, odd": Grid(23, 15, 0.2, 0.5, periodic="y"),
    "periodic in y, one row": Grid(45, 1, 0.1, 0.4, periodic="y"),
}
PERIODIC = {
    "periodic": Grid(24, 16, 0.5, 0.3, periodic="spectral"),
    "periodic, odd": Grid(23, 17, 0.2, 0.5, periodic="spectral"),
    "periodic, more than a block": Grid(40, 36, 0.2, 0.3, periodic="spectral"),
    "images, odd": Grid(23, 17, 0.2, 0.5, periodic="love"),
    "images": Grid(18, 20, 0.5, 0.5, periodic="love"),
    "images, one row": Grid(45, 1, 0.1, 0.4, periodic="love"),
}
STENCIL = [[-0.037, -0.161, -0.037], [-0.189, 1.0, -0.189], [-0.037, -0.161, -0.037]]  # of an inverse
DOUBLE, SINGLE = 1e-14, 1e-6  # measured: 2e-15 and 2e-7


def slabs_of(comm, grid, block=1):
    return Slabs(grid.ny, comm.size, comm.rank, block)


def random_field(grid, seed):
    """The same field on all ranks."""
    return np.random.default_rng(seed).normal(size=grid.shape)


@cache
def matrix_of(grid):
    return dense_matrix(grid, STEEL)


BOXED = Grid(230, 190, 0.2, 0.25)  # large enough for a product in a box
BOXED_ONE_WAY = Grid(230, 190, 0.2, 0.25, periodic="y")


def make_convolution(comm, grid, block=1, dtype=np.float64):
    layout = Layout(slabs_of(comm, grid, block), comm, dtype)
    if grid.doubly_periodic:
        return PeriodicProduct(partial(STEEL.eigenvalues, grid), grid.shape, layout)
    if grid in (BOXED, BOXED_ONE_WAY):
        return BoxProduct(grid, patch_kernel(STEEL, grid), layout)
    return Convolution(partial(influence_quadrant, grid, STEEL), grid.shape, layout, grid.repeats)


def restriction_mat(transfer, comm):
    """The Mat of its restriction, coarse x fine, whichever way round PETSc wants it."""
    mat = transfer.restriction_mat(comm)
    return PETSc.Mat().createTranspose(mat) if restricts_by_transpose() else mat


def mat_times(mat, values):
    """What a Mat makes of an array, which holds this rank's entries."""
    x, y = mat.createVecs()
    x.setArray(values.reshape(-1))
    mat.mult(x, y)
    found = y.getArray(readonly=True).copy()
    x.destroy()
    y.destroy()
    return found


def asymmetry(pc, operator, mat):
    """|u.Mv - v.Mu| / |u| |Mv| of a preconditioner M for two random vectors on the contact set."""
    u, v, mu, mv = vectors = [mat.createVecRight() for _ in range(4)]
    rng = np.random.default_rng(operator.slabs.rows.start)
    for vector in (u, v):
        vector.setArray((rng.normal(size=operator.local_shape) * operator.mask).reshape(-1))
    pc.apply(u, mu)
    pc.apply(v, mv)
    found = abs(u.dot(mv) - v.dot(mu)) / (u.norm() * mv.norm())
    for vector in vectors:
        vector.destroy()
    return found
