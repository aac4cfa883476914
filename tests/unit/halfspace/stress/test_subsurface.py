"""Stress below a pressure: planes, sections, lines, and invalid input."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.stress.subsurface import SubsurfaceStress, _find_peaks


@pytest.mark.parametrize("nx, ny", [(13, 9), (8, 12)])
def test_plane_section_and_line_agree(nx, ny):
    rng = np.random.default_rng(11)
    grid = Grid(nx, ny, 0.3, 0.2, -1.0, 4.0)
    pressure = np.where(rng.random(grid.shape) < 0.3, rng.random(grid.shape), 0.0)
    pressure[:2] = pressure[:, -1] = 0.0  # what carries nothing is left out
    below = SubsurfaceStress(pressure, grid, 0.4)
    for depth in (0.0, 0.1, 2.0):
        plane = below.plane(depth)
        assert below.section(depth, y=grid.y()[4])[:, 0] == pytest.approx(plane[:, 4], abs=1e-12)
        assert below.section(depth, x=grid.x()[5])[:, 0] == pytest.approx(plane[:, :, 5], abs=1e-12)
        assert below.line(depth, grid.x()[5], grid.y()[4])[:, 0] == pytest.approx(plane[:, 4, 5], abs=1e-12)
    assert below.plane(0.0)[2] == pytest.approx(-pressure, abs=1e-12)  # the surface carries the pressure


@pytest.mark.parametrize("periodic", ["spectral", "y"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_largest_of_equal_stresses_is_the_first(periodic, seed):
    """The load is uniform along y, up to rounding, which machines and numbers of ranks change."""
    grid = Grid(16, 24, 0.3, 0.2, periodic=periodic)
    rounding = 1 + 1e-15 * np.random.default_rng(seed).integers(-2, 3, grid.shape)
    pressure = np.maximum(np.cos(grid.x() - 2.4), 0) ** 0.5 * rounding
    for maximum in SubsurfaceStress(pressure, grid, 0.3).maxima():
        assert (maximum.x, maximum.y) == (grid.x()[7], grid.y()[0])
        assert maximum.depth > 0


def test_peaks_of_strips_are_one_in_each_strip():
    columns = np.array([0.0, 1.9, 2.0, 1.9, 0.0, 0.0, 1.4, 1.5, 0.3, 0.0, 1.0])
    assert _find_peaks(np.tile(columns, (6, 1))) == [(0, 2), (0, 7), (0, 10)]


@pytest.mark.parametrize(
    "change, message",
    [
        ({"pressure": np.ones((3, 4))}, r"needs \(ny, nx\) = \(4, 4\)"),
        ({"pressure": np.full((4, 4), np.nan)}, "not finite"),
        ({"poisson_ratio": 0.6}, "from 0 to 0.5"),
    ],
)
def test_invalid_input_is_refused(change, message):
    given = {"pressure": np.ones((4, 4)), "grid": Grid(4, 4, 1.0, 1.0), "poisson_ratio": 0.3}
    with pytest.raises(ValueError, match=message):
        SubsurfaceStress(**(given | change))
    below = SubsurfaceStress(**given)
    with pytest.raises(ValueError, match="depth -1"):
        below.plane(-1)
    with pytest.raises(ValueError, match="give either x or y"):
        below.section(1.0)
