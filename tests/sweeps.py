"""Gauss-Seidel sweeps over contact sets and grids of all kinds."""

from contextlib import contextmanager
from unittest import mock

import numpy as np

from app.halfspace.gauss_seidel import tables
from app.halfspace.gauss_seidel.gauss_seidel import GaussSeidel
from app.halfspace.grid import Grid
from app.halfspace.influence import quadrant_rows
from app.halfspace.kernel import UNIT

GRIDS = {
    "prime": Grid(61, 97, 0.3, 0.2),
    "wide": Grid(211, 13, 0.2, 0.2),
    "one row": Grid(101, 1, 1.0, 1.0),
    "one column": Grid(1, 101, 1.0, 1.0),
    "three rows": Grid(70, 3, 1.0, 0.5),
    "one cell": Grid(1, 1, 1.0, 1.0),
    "even": Grid(32, 128, 1.0, 1.0),
    "periodic": Grid(36, 55, 0.3, 0.2, periodic="spectral"),
    "images": Grid(36, 55, 0.3, 0.2, periodic="love"),
    "odd period": Grid(25, 30, 0.3, 0.2, periodic="spectral"),
    "period in x": Grid(36, 55, 0.3, 0.2, periodic="x"),
    "period in y": Grid(25, 30, 0.3, 0.2, periodic="y"),
}


@contextmanager
def block_sizes(leaf_rows, segment_columns):
    """Small blocks, so that small grids exercise every level of the scheme."""
    with mock.patch.multiple(tables, LEAF_ROWS=(leaf_rows, leaf_rows), SEGMENT_COLUMNS=segment_columns):
        yield


def make(grid, slabs=None, comm=None):
    return GaussSeidel(quadrant_rows(grid, UNIT), grid.shape, slabs, comm, grid.repeats[1])


def random_problem(grid, share=0.4, seed=0):
    rng = np.random.default_rng(seed)
    mask = rng.random(grid.shape) < share
    return mask, np.where(mask, rng.normal(size=grid.shape), 0.0)


def empty_in_the_middle(grid):
    mask, r = random_problem(grid)
    mask[grid.ny // 5 : -grid.ny // 5] = False
    return mask, r * mask


def sweep(relaxation, r, mask, omega, backward=False):
    d = np.full(r.shape, np.nan)
    relaxation.sweep(r, mask, omega, d, backward=backward)
    return d
