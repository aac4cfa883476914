"""Influence of the periodic images of a patch."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.images import Box, ImageCorrection
from app.halfspace.kernel import UNIT
from app.halfspace.periodic_symbol import periodic_quadrant
from app.parallel.slabs import Slabs

NO_MASK = np.zeros((0, 0), bool)


def box_of(grid, periods):
    return Box(grid, periods, UNIT)


@pytest.mark.parametrize("periods", [(80, 80), (81, 79), (40, 120), (150, 60)])
@pytest.mark.parametrize("sides", [(1.0, 1.0), (0.2, 0.5)])
def test_box_kernel_includes_all_images(periods, sides):
    ny, nx = periods
    patch = Grid(nx // 2 + 1, ny // 2 + 1, *sides)
    found = box_of(patch, periods).kernel(np.arange(ny // 2 + 1), np.arange(nx // 2 + 1))
    other = periodic_quadrant(Grid(nx, ny, *sides, periodic="love"), UNIT)
    assert np.abs(found - other).max() <= 1e-12 * other.max()  # both less their mean


def test_image_correction_accepts_ranks_without_rows():
    grid = Grid(40, 40, 1.0, 1.0)
    correction = ImageCorrection(box_of(grid, (60, 60)), 1.0, (1, 1), 6, Slabs(40, 50, 49), None, np.float64)
    none = np.zeros((0, 40))
    correction.multiply(none, NO_MASK)
    correction.add(none, NO_MASK)
