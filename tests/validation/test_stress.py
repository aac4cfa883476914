"""Stress below a pressure: analytic solutions, and what holds for any pressure."""

import numpy as np
import pytest
from cases import sphere_pressure

from app.halfspace.grid import Grid
from app.halfspace.stress.subsurface import SubsurfaceStress, max_shear, von_mises

DEPTHS = np.array([0.05, 0.3, 1.0, 2.5])


def test_sphere_yields_first_at_half_a_radius_below():
    hottest = SubsurfaceStress(*sphere_pressure(64), 0.3).maximum()
    assert hottest.von_mises == pytest.approx(0.620, rel=2e-3)
    assert hottest.depth == pytest.approx(0.481, rel=5e-3)
    assert max(abs(hottest.x), abs(hottest.y)) < 0.02
    assert von_mises(hottest.stress) == pytest.approx(hottest.von_mises)


@pytest.mark.parametrize("periodic", ["", "spectral"])
def test_search_finds_what_looking_everywhere_finds(periodic):
    """Asperities of many sizes, some deep enough for larger cells."""
    rng = np.random.default_rng(5)
    grid = Grid(96, 80, 0.1, 0.1, periodic=periodic)
    x, y = np.meshgrid(grid.x(), grid.y())
    pressure = np.zeros(grid.shape)
    for a in (0.15, 0.3, 0.6, 1.2, 3.5):
        r2 = ((x - rng.uniform(2, 8)) ** 2 + (y - rng.uniform(2, 6)) ** 2) / a**2
        pressure += rng.uniform(0.5, 1.0) * np.sqrt(np.maximum(1 - r2, 0))
    below = SubsurfaceStress(pressure, grid, 0.3)
    planes = [below.plane(depth) for depth in np.geomspace(0.02, 4, 60)]
    hottest, sheared = below.maxima()
    assert hottest.von_mises == pytest.approx(max(von_mises(plane).max() for plane in planes), rel=2e-3)
    assert sheared.max_shear == pytest.approx(max(max_shear(plane).max() for plane in planes), rel=2e-3)
    assert max_shear(below.line([sheared.depth], sheared.x, sheared.y)[:, 0]) == sheared.max_shear
    assert below.maximum().von_mises == hottest.von_mises


def test_below_the_centre_of_a_sphere_the_error_falls_with_the_square_of_the_cell():
    exact_z = -1 / (1 + DEPTHS**2)
    exact_x = -1.3 * (1 - DEPTHS * np.arctan(1 / DEPTHS)) - exact_z / 2
    errors = []
    for n in (32, 64):
        stress = SubsurfaceStress(*sphere_pressure(n), 0.3).line(DEPTHS[1:], 0.0, 0.0)
        assert stress[0] == pytest.approx(stress[1], rel=1e-12)
        errors.append(max(abs(stress[2] - exact_z[1:]).max(), abs(stress[0] - exact_x[1:]).max()))
    assert errors[1] < 5e-4 and errors[1] < errors[0] / 3


@pytest.fixture(scope="module")
def strip():
    """One row of cells, so long that the strain along it is plane."""
    return Grid(256, 1, 2 / 256, 2e5, -1.0, -1e5)


def test_uniform_strip(strip):
    angle = np.arctan(1 / DEPTHS)
    xx, yy, zz, *shear = SubsurfaceStress(np.ones(strip.shape), strip, 0.3).line(DEPTHS, 0.0, 0.0)
    assert zz == pytest.approx(-(2 * angle + np.sin(2 * angle)) / np.pi, abs=1e-5)
    assert xx == pytest.approx(-(2 * angle - np.sin(2 * angle)) / np.pi, abs=1e-5)
    assert yy == pytest.approx(0.3 * (xx + zz), abs=1e-5)
    assert abs(np.array(shear)).max() < 1e-12


def test_line_contact(strip):
    pressure = np.sqrt(1 - strip.x() ** 2)[None]
    xx, _, zz, *_ = SubsurfaceStress(pressure, strip, 0.3).line(DEPTHS[1:], 0.0, 0.0)
    root = np.sqrt(1 + DEPTHS[1:] ** 2)
    assert zz == pytest.approx(-1 / root, rel=5e-4)
    assert xx == pytest.approx(-(root + DEPTHS[1:] ** 2 / root - 2 * DEPTHS[1:]), abs=5e-4)


def test_far_below_a_patch_is_a_point_force():
    """Boussinesq: sigma_zz = -3 F z^3 / (2 pi r^5)."""
    grid = Grid(3, 5, 0.1, 0.1, -0.15, -0.25)
    stress = SubsurfaceStress(np.ones(grid.shape), grid, 0.2).line([30.0], 8.0, -5.0)
    r = np.sqrt(30.0**2 + 8.0**2 + 5.0**2)
    assert stress[2, 0] == pytest.approx(-3 * 0.15 * 30.0**3 / (2 * np.pi * r**5), rel=1e-4)
    assert stress[4, 0] / stress[5, 0] == pytest.approx(8 / -5, rel=1e-3)


def test_the_largest_shear_stress_is_johnson_s():
    """Contact Mechanics, Sec. 3.4: 0.31 of the largest pressure at 0.48 radii below a sphere."""
    z = np.linspace(0.3, 0.7, 41)
    shear = max_shear(SubsurfaceStress(*sphere_pressure(64), 0.3).line(z, 0.0, 0.0))
    assert shear.max() == pytest.approx(0.310, rel=2e-3) and z[shear.argmax()] == pytest.approx(
        0.48, abs=0.011
    )
    turned = np.array([3.0, -1.0, 0.0, 2.0, 0.0, 0.0])  # principal stresses 1 + 8**0.5, 1 - 8**0.5, 0
    assert max_shear(turned) == pytest.approx(8**0.5)
