"""Sums of stresses over waves and cells."""

from dataclasses import replace

import numpy as np
import pytest
from cases import sphere_pressure

from app.halfspace.grid import Grid
from app.halfspace.stress.subsurface import SubsurfaceStress


def test_stress_below_a_cosine_is_exact():
    grid = Grid.from_domain(16, 12, (0, 2, 0, 3), periodic=True)
    q = 2 * np.pi * np.array([2 / 2, 1 / 3])  # two waves in x, one in y
    x, y = np.meshgrid(grid.x(), grid.y())
    phase, nu, z = q[0] * x + q[1] * y, 0.27, 0.2
    (nx, ny), s = q / np.hypot(*q), np.hypot(*q) * z
    below = SubsurfaceStress(5 + np.cos(phase), grid, nu)
    c, mean = np.exp(-s) * np.cos(phase), 5 * nu / (1 - nu)
    expected = [
        -mean - c * (nx**2 * (1 - s) + 2 * nu * ny**2),
        -mean - c * (ny**2 * (1 - s) + 2 * nu * nx**2),
        -5 - c * (1 + s),
        -c * nx * ny * (1 - s - 2 * nu),
        *(-np.exp(-s) * np.sin(phase) * s * n for n in (nx, ny)),
    ]
    plane = below.plane(z)
    for component, exact in zip(plane, expected, strict=True):
        assert component == pytest.approx(exact, abs=1e-13)
    # The same on a section and on a line, also between cell centres.
    assert below.section(z, y=grid.y()[5])[:, 0] == pytest.approx(plane[:, 5], abs=1e-13)
    assert below.section(z, x=grid.x()[3])[:, 0] == pytest.approx(plane[:, :, 3], abs=1e-13)
    at = q @ (0.111, 0.777)
    assert below.line(z, 0.111, 0.777)[2, 0] == pytest.approx(-5 - np.exp(-s) * (1 + s) * np.cos(at))


@pytest.mark.parametrize("nx, ny", [(6, 8), (7, 8), (8, 5)])
def test_stress_between_centres_is_symmetric_in_x_and_y(nx, ny):
    """The shortest waves of an even number of rows go neither way, as those of columns do."""
    p = np.random.default_rng(3).random((ny, nx))
    grid = Grid.from_domain(nx, ny, (0, 1, 0, 2), periodic=True)
    turned = Grid.from_domain(ny, nx, (0, 2, 0, 1), periodic=True)
    one, other = SubsurfaceStress(p, grid, 0.3), SubsurfaceStress(p.T, turned, 0.3)
    order = [1, 0, 2, 3, 5, 4]  # xx, yy, zz, xy, xz, yz
    depths = [0.0, 0.05]
    for found, expected in (
        (one.section(depths, y=0.6), other.section(depths, x=0.6)),
        (one.section(depths, x=0.3), other.section(depths, y=0.3)),
        (one.line(depths, 0.3, 0.6), other.line(depths, 0.6, 0.3)),
    ):
        np.testing.assert_allclose(found, expected[order], rtol=0, atol=1e-13)


def test_each_plane_carries_the_load():
    """On a wide plane the vertical stress carries the load; shear stresses cancel."""
    pressure, grid = sphere_pressure(32, half=1.0)
    wide = replace(grid, nx=512, ny=512, x0=-16.0, y0=-16.0)
    spread = np.zeros(wide.shape)
    spread[240:272, 240:272] = pressure
    plane = SubsurfaceStress(spread, wide, 0.3).plane(0.5)
    carried = plane.sum(axis=(1, 2)) * wide.cell_area
    assert carried[2] == pytest.approx(-pressure.sum() * grid.cell_area, rel=1e-4)
    assert abs(carried[3:]).max() < 1e-10


@pytest.mark.parametrize("n", [4, 8, 10, 14, 30, 128])
def test_surface_stress_on_an_edge_is_the_mean(n):
    """sigma_zz = -p there, though the point may be off the edge by rounding."""
    grid = Grid.from_domain(n, n, (-0.4, 0.4, -0.4, 0.4))
    pressure = np.random.default_rng(n).random(grid.shape)
    below, half = SubsurfaceStress(pressure, grid, 0.3), n // 2
    around = pressure[half - 1 : half + 1, half - 1 : half + 1]
    assert below.line([0.0], 0.0, 0.0)[2] == pytest.approx(-around.mean(), abs=1e-13)
    x = grid.x()[half]
    assert below.line([0.0], x, 0.0)[2] == pytest.approx(-around[:, 1].mean(), abs=1e-13)
    assert below.section([0.0], y=0.0)[2, 0, half] == pytest.approx(-around[:, 1].mean(), abs=1e-13)
    assert below.section([0.0], x=0.0)[2, 0, half] == pytest.approx(-around[1].mean(), abs=1e-13)
