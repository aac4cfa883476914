"""The influence operator: symmetric, positive definite, small."""

import tracemalloc

import numpy as np
import pytest
import scipy.fft
from mpi4py import MPI
from operators import GRIDS, make_convolution, matrix_of, random_field
from petsc4py import PETSc

from app.halfspace.fft.lengths import transform_length
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.grid import Grid
from app.halfspace.operator import InfluenceOperator
from app.halfspace.product import Convolution, DenseProduct

SELF = MPI.COMM_SELF
each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())


def test_small_grids_are_multiplied_as_dense_matrices():
    assert isinstance(InfluenceOperator(GRIDS["two rows"], 1.0).product, DenseProduct)
    assert isinstance(InfluenceOperator(GRIDS["even"], 1.0).product, Convolution)


@each_grid
def test_symmetric_and_positive_definite(grid):
    product = make_convolution(SELF, grid)
    scale = matrix_of(grid).max() * grid.n
    for seed in range(5):
        p, q = random_field(grid, seed), random_field(grid, 100 + seed)
        Ap, Aq = np.empty_like(p), np.empty_like(q)
        product.apply(p, Ap)
        product.apply(q, Aq)
        assert abs(np.vdot(q, Ap) - np.vdot(p, Aq)) <= 1e-13 * scale
        assert np.vdot(p, Ap) > 0


@pytest.mark.parametrize("name", ["one cell", "one row", "two rows", "even", "odd", "wide cells"])
def test_all_eigenvalues_are_positive(name):
    grid = GRIDS[name]
    product = make_convolution(SELF, grid)
    columns = np.empty((grid.n, *grid.shape))
    for unit, column in zip(np.eye(grid.n), columns, strict=True):
        product.apply(unit.reshape(grid.shape), column)
    assert np.linalg.eigvalsh(columns.reshape(grid.n, grid.n)).min() > 0


def test_positive_pressure_sinks_every_cell():
    grid = Grid(300, 260, 0.1, 0.1)
    p, u = np.zeros(grid.shape), np.empty(grid.shape)
    p[7, 5] = 1.0
    make_convolution(SELF, grid).apply(p, u)
    assert (u > 0).all()
    assert np.unravel_index(u.argmax(), u.shape) == (7, 5)


def test_periods_leave_room_for_the_padding():
    for n in [*range(1, 70), 127, 1000, 1024]:
        period = transform_length(n)
        assert 2 * n - 1 <= period <= 1.34 * 2 * n + 1
        assert period % 2 == 0


@pytest.mark.parametrize("periods", [(1, 1), (5, 7), (6, 9), (8, 8), (1, 12), (9, 1)])
def test_even_multiplier_is_a_periodic_convolution(periods):
    ny, nx = periods
    rng = np.random.default_rng(2)
    half = rng.normal(size=(ny // 2 + 1, nx // 2 + 1))
    j, i = (np.minimum(np.arange(n), n - np.arange(n)) for n in periods)
    kernel = half[j[:, None], i]
    multiplier = EvenMultiplier(periods, periods)
    multiplier.set_kernel(lambda rows: half[rows], *half.shape)
    spectrum = scipy.fft.fft2(kernel)
    p = rng.normal(size=periods)
    out = np.empty(periods)
    multiplier.apply(p, out)
    np.testing.assert_allclose(out, scipy.fft.ifft2(spectrum * scipy.fft.fft2(p)).real, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("dtype", "share"), [(np.float64, 1.0), (np.float32, 0.5)])
def test_needs_three_arrays_of_n_doubles(dtype, share):
    grid = Grid(512, 512, 1.0, 1.0)
    product = make_convolution(SELF, grid, dtype=dtype)
    n_doubles = 8 * grid.n
    cache = 1 << 20  # blocks of rows and columns, whatever n
    assert product.memory <= share * (3.02 * n_doubles + cache)
    p, out = random_field(grid, 1), np.empty(grid.shape)
    product.apply(p, out)  # compiles
    tracemalloc.start()
    try:
        product.apply(p, out)
        product.apply(p, out, p > 0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.2 * n_doubles


def test_empty_contact_set_costs_no_row_transforms():
    grid = GRIDS["even"]
    product = make_convolution(SELF, grid)
    out = np.full(grid.shape, np.nan)
    product.apply(np.full(grid.shape, np.nan), out, np.zeros(grid.shape, bool))
    assert (out == 0).all()


def test_vectors_know_that_they_have_changed():
    grid = GRIDS["odd"]
    operator = InfluenceOperator(grid, 1.0)
    operator.mask[...] = True
    mat = operator.mat(PETSc.COMM_SELF)
    x, y = mat.createVecs()
    y.set(0)
    assert y.norm() == 0  # PETSc keeps this norm as long as it knows of no change
    x.set(1)
    mat.mult(x, y)
    assert y.norm() == pytest.approx(np.linalg.norm(y.getArray(readonly=True)), rel=1e-14)
    assert y.norm() > 0
    assert mat.isSymmetricKnown() == (True, True)
    x.destroy()
    y.destroy()
    mat.destroy()
    assert not mat
