"""Stress below a pressure: analytic solutions, and what holds for any pressure."""

from dataclasses import replace

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.stress.subsurface import SubsurfaceStress, max_shear, von_mises

DEPTHS = np.array([0.05, 0.3, 1.0, 2.5])


def sphere(n, half=1.2):
    """Hertz's pressure with p0 = 1 and a = 1, as means over parts of the cells."""
    grid = Grid.from_domain(n, n, (-half, half, -half, half))
    fine = Grid.from_domain(8 * n, 8 * n, (-half, half, -half, half))
    p = np.sqrt(np.maximum(1 - fine.x() ** 2 - fine.y()[:, None] ** 2, 0))
    return p.reshape(n, 8, n, 8).mean(axis=(1, 3)), grid


def test_sphere_yields_first_at_half_a_radius_below():
    hottest = SubsurfaceStress(*sphere(64), 0.3).maximum()
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
        stress = SubsurfaceStress(*sphere(n), 0.3).line(DEPTHS[1:], 0.0, 0.0)
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


def test_a_cosine_is_exact_on_a_periodic_patch():
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
def test_stresses_between_cell_centres_do_not_know_x_from_y(nx, ny):
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


@pytest.mark.parametrize("nx, ny", [(13, 9), (8, 12)])
def test_plane_section_and_line_are_the_same_below_a_free_patch(nx, ny):
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


def test_far_below_a_patch_is_a_point_force():
    """Boussinesq: sigma_zz = -3 F z^3 / (2 pi r^5)."""
    grid = Grid(3, 5, 0.1, 0.1, -0.15, -0.25)
    stress = SubsurfaceStress(np.ones(grid.shape), grid, 0.2).line([30.0], 8.0, -5.0)
    r = np.sqrt(30.0**2 + 8.0**2 + 5.0**2)
    assert stress[2, 0] == pytest.approx(-3 * 0.15 * 30.0**3 / (2 * np.pi * r**5), rel=1e-4)
    assert stress[4, 0] / stress[5, 0] == pytest.approx(8 / -5, rel=1e-3)


def test_equilibrium_of_a_plane_and_the_load_through_it():
    """On a wide plane the vertical stress carries the load; shear stresses cancel."""
    pressure, grid = sphere(32, half=1.0)
    wide = replace(grid, nx=512, ny=512, x0=-16.0, y0=-16.0)
    spread = np.zeros(wide.shape)
    spread[240:272, 240:272] = pressure
    plane = SubsurfaceStress(spread, wide, 0.3).plane(0.5)
    carried = plane.sum(axis=(1, 2)) * wide.cell_area
    assert carried[2] == pytest.approx(-pressure.sum() * grid.cell_area, rel=1e-4)
    assert abs(carried[3:]).max() < 1e-10


def test_a_small_contact_does_not_see_that_its_patch_is_repeated():
    pressure, grid = sphere(32, half=1.0)
    wide = replace(grid, nx=512, ny=512, x0=-16.0, y0=-16.0)
    spread = np.zeros(wide.shape)
    spread[240:272, 240:272] = pressure
    free, periodic = (SubsurfaceStress(spread, g, 0.3) for g in (wide, replace(wide, periodic="spectral")))
    z, deep = [0.2, 0.5, 1.0], free.line([0.5], 0.0, 0.0)
    assert abs(free.line(z, 0.1, 0.2) - periodic.line(z, 0.1, 0.2)).max() < 0.01 * abs(deep).max()


def test_the_largest_shear_stress_is_johnson_s():
    """Contact Mechanics, Sec. 3.4: 0.31 of the largest pressure at 0.48 radii below a sphere."""
    z = np.linspace(0.3, 0.7, 41)
    shear = max_shear(SubsurfaceStress(*sphere(64), 0.3).line(z, 0.0, 0.0))
    assert shear.max() == pytest.approx(0.310, rel=2e-3) and z[shear.argmax()] == pytest.approx(
        0.48, abs=0.011
    )
    turned = np.array([3.0, -1.0, 0.0, 2.0, 0.0, 0.0])  # principal stresses 1 + 8**0.5, 1 - 8**0.5, 0
    assert max_shear(turned) == pytest.approx(8**0.5)


def test_without_pressure_there_is_no_stress():
    grid = Grid(4, 4, 1.0, 1.0)
    hottest, sheared = SubsurfaceStress(np.zeros((4, 4)), grid, 0.3).maxima()
    assert hottest.von_mises == sheared.max_shear == 0


@pytest.mark.parametrize(
    "change, message",
    [
        ({"pressure": np.ones((3, 4))}, r"needs \(ny, nx\) = \(4, 4\)"),
        ({"pressure": np.full((4, 4), np.nan)}, "not finite"),
        ({"poisson_ratio": 0.6}, "from 0 to 0.5"),
    ],
)
def test_bad_input(change, message):
    given = {"pressure": np.ones((4, 4)), "grid": Grid(4, 4, 1.0, 1.0), "poisson_ratio": 0.3}
    with pytest.raises(ValueError, match=message):
        SubsurfaceStress(**(given | change))
    below = SubsurfaceStress(**given)
    with pytest.raises(ValueError, match="depth -1"):
        below.plane(-1)
    with pytest.raises(ValueError, match="give either x or y"):
        below.section(1.0)


@pytest.mark.parametrize("n", [4, 8, 10, 14, 30, 128])
def test_on_the_edge_of_cells_the_surface_has_their_mean(n):
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
