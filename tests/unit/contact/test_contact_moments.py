"""Centre of pressure, moments, and ellipse of the contact."""

import numpy as np
import pytest
from cases import hertz
from running import solve

from app import ContactProblem, Grid


def test_rotated_and_shifted_ellipse_is_found():
    angle, x0, y0 = np.radians(130.0), 1.3, -0.4
    c, s = np.cos(angle), np.sin(angle)

    def gap(x, y):
        along, across = c * (x - x0) + s * (y - y0), -s * (x - x0) + c * (y - y0)
        return along**2 / 600 + across**2 / 326

    problem = hertz(256)
    turned = solve(ContactProblem(problem.grid, problem.material, gap), 0.02, None)
    known = problem.reference(0.02)
    assert turned.semi_axis_major == pytest.approx(known.a, rel=0.01)
    assert turned.semi_axis_minor == pytest.approx(known.b, rel=0.01)
    assert turned.major_axis_angle == pytest.approx(130 - 180, abs=0.5)
    assert (turned.pressure_centre_x, turned.pressure_centre_y) == pytest.approx((x0, y0), abs=1e-3)
    assert turned.moment_y == pytest.approx(turned.load * turned.pressure_centre_y)
    assert turned.moment_x == pytest.approx(turned.load * turned.pressure_centre_x)


def test_ellipse_far_from_the_origin_is_the_same():
    def at(x0):
        grid = Grid(64, 64, 1 / 32, 1 / 32, x0, x0)
        gap = (grid.x() - x0 - 1) ** 2 + 2 * (grid.y()[:, None] - x0 - 1) ** 2
        return solve(ContactProblem(grid, hertz(16).material, gap), 0.2, None)

    here, far = at(0.0), at(2.0**20)
    for name in ("semi_axis_major", "semi_axis_minor"):
        assert getattr(far, name) == pytest.approx(getattr(here, name), rel=1e-9)
    assert far.pressure_centre_x - 2**20 == pytest.approx(here.pressure_centre_x, abs=1e-9)


def test_no_centre_without_contact_or_on_periodic_patches():
    problem = hertz(16)
    apart = solve(problem, -1.0, None)
    assert np.isnan([apart.pressure_centre_x, apart.semi_axis_major]).all()
    assert (apart.moment_x, apart.contact_area, apart.mean_contact_pressure) == (0, 0, 0)
    assert apart.contact_patches().size == apart.distribution("pressure")[0].size == 0
    x = np.cos(2 * np.pi * (np.arange(16) + 0.5) / 16)
    wave = ContactProblem(
        Grid.from_domain(16, 16, (0, 1, 0, 1)), problem.material, 1e-3 * (x - x[:, None]), True
    )
    assert np.isnan(solve(wave, 0.0, None).moment_x)
