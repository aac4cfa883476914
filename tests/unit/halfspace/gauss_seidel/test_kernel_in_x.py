"""Kernel of a sweep in x-Fourier space."""

import numpy as np
import pytest

from app.halfspace.gauss_seidel.kernel_in_x import KernelInX
from app.halfspace.grid import Grid
from app.halfspace.influence import quadrant_rows
from app.halfspace.kernel import UNIT


@pytest.mark.parametrize("aspect", [0.25, 1.0, 3.0])
def test_reach_follows_decay_of_waves(aspect):
    """exp(-k y) is a rounding error at k y = 36; a factor before it, and the spectrum of the blend, are a tenth."""
    grid = Grid(512, 600, 0.1, 0.1 * aspect)
    kernel = KernelInX(quadrant_rows(grid, UNIT), grid.shape)
    wave_numbers = 2 * np.pi * np.arange(kernel.frequencies) / kernel.length  # times dx
    local = kernel.reach * aspect * wave_numbers <= 40
    assert local[wave_numbers > 0.6].all()
