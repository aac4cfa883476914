"""Multiplication by even functions in Fourier space."""

import tracemalloc

import numpy as np
import pytest
import scipy.fft
from mpi4py import MPI
from operators import GRIDS, make_convolution, random_field

from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.grid import Grid

SELF = MPI.COMM_SELF


@pytest.mark.parametrize("periods", [(1, 1), (5, 7), (6, 9), (8, 8), (1, 12), (9, 1)])
def test_even_multiplier_is_periodic_convolution(periods):
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
def test_product_needs_three_arrays_of_n_doubles(dtype, share):
    grid = Grid(512, 512, 1.0, 1.0)
    n_doubles = 8 * grid.n
    p, out = random_field(grid, 1), np.empty(grid.shape)
    make_convolution(SELF, grid, dtype=dtype).apply(p, out)  # compiles, and makes work arrays of this length
    tracemalloc.start()
    try:
        product = make_convolution(SELF, grid, dtype=dtype)
        assert tracemalloc.get_traced_memory()[0] <= share * 3.02 * n_doubles
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        product.apply(p, out)
        product.apply(p, out, p > 0)
        peak = tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()
    assert peak < 0.2 * n_doubles


def test_empty_contact_set_needs_no_row_transforms():
    grid = GRIDS["even"]
    product = make_convolution(SELF, grid)
    out = np.full(grid.shape, np.nan)
    product.apply(np.full(grid.shape, np.nan), out, np.zeros(grid.shape, bool))
    assert (out == 0).all()
