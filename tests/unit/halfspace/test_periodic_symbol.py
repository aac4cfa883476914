"""Symbols of the influence matrix of periodic patches."""

import tracemalloc

import numpy as np
import pytest
import scipy.fft
import scipy.special
from operators import PERIODIC, STEEL

from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.kernel import UNIT
from app.halfspace.periodic_symbol import influence_symbol

each_grid = pytest.mark.parametrize("grid", PERIODIC.values(), ids=PERIODIC.keys())


@each_grid
def test_waves_are_eigenvectors(grid):
    quadrant = influence_quadrant(grid, STEEL)
    symbol = STEEL.eigenvalues(grid, np.arange(grid.nx // 2 + 1), np.arange(grid.ny // 2 + 1))
    spectrum = scipy.fft.rfft2(quadrant)[: grid.ny // 2 + 1].T
    np.testing.assert_allclose(spectrum, symbol, rtol=0, atol=1e-13 * symbol.max())


@pytest.mark.parametrize("cells", [3, 101, 1001])
def test_long_cell_equals_its_square_cells(cells):
    long, square = Grid(64, 2, 1.0, cells, periodic="love"), Grid(64, 2 * cells, 1.0, 1.0, periodic="love")
    whole, parts = (influence_quadrant(grid, UNIT) for grid in (long, square))
    offsets = np.arange(2)[:, None] * cells + np.arange(cells) - cells // 2
    np.testing.assert_allclose(whole, parts[offsets].sum(axis=1), rtol=0, atol=1e-13 * whole.max())
    turned = influence_quadrant(Grid(2, 64, cells, 1.0, periodic="love"), UNIT)
    np.testing.assert_allclose(turned, whole.T, rtol=0, atol=1e-14 * whole.max())


def test_symbol_of_long_cells_needs_little_memory():
    columns, rows = np.arange(64), np.arange(2)
    peaks = {}
    for aspect in (1.0, 1e5):
        grid = Grid(128, 2, 1.0, aspect, periodic="love")
        influence_symbol(grid, 1.0, columns[:1], rows[:1])  # load what is loaded once
        tracemalloc.start()
        influence_symbol(grid, 1.0, columns, rows)
        peaks[aspect] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peaks[1e5] < 10 * peaks[1.0]  # by a logarithm


@pytest.mark.parametrize(("nx", "ny", "dx", "dy"), [(8, 6, 0.5, 0.5), (5, 6, 0.3, 0.4), (50, 2, 0.02, 0.5)])
def test_love_symbol_is_sum_over_images(nx, ny, dx, dy):
    """The sum over images up to R, its mean taken off, lacks a / R + b / R^3: three of them leave next to nothing."""
    grid = Grid(nx, ny, dx, dy, periodic="love")

    def summed(most):
        whole = influence_quadrant(Grid((most + 1) * nx, (most + 1) * ny, dx, dy), UNIT)
        j, i = (np.abs(np.arange(n)[:, None] + n * np.arange(-most, most + 1)) for n in (ny, nx))
        share = np.where(abs(np.arange(-most, most + 1)) == most, 0.5, 1.0)  # of images at the rim
        total = np.einsum("yaxb,a,b->yx", whole[j][:, :, i], share, share)
        return total - total.mean()

    one, two, four = (summed(most) for most in (8, 16, 32))
    first = 2 * two - one, 2 * four - two
    found = influence_quadrant(grid, UNIT)
    errors = [
        abs(sums - found).max() / found[0, 0] for sums in (four, first[1], (8 * first[1] - first[0]) / 7)
    ]
    assert errors[-1] < 1e-6 and errors[1] < 0.1 * errors[0] and errors[2] < 0.1 * errors[1], errors
