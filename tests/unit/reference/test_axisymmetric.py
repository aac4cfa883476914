"""Sphere, punch and cone."""

import numpy as np
import pytest

from app.reference import EllipticHertz, Sphere

from .contacts import CASES, E_STAR, contact, points


def test_equal_radii_give_the_sphere():
    ellipse, sphere = contact(EllipticHertz, (40.0, 40.0)), contact(Sphere, (40.0,))
    for name in ("a", "b", "load", "max_pressure", "mean_pressure", "stiffness", "contact_area"):
        assert getattr(ellipse, name) == pytest.approx(getattr(sphere, name), rel=1e-12), name
    x, y = points(sphere, [0, 0.5, 0.9, 1.1, 3, 1e4])
    for name in ("pressure", "displacement", "undeformed_distance"):
        np.testing.assert_allclose(getattr(ellipse, name)(x, y), getattr(sphere, name)(x, y), rtol=1e-12)


@pytest.mark.parametrize("case", ["sphere", "punch", "cone"])
def test_slope_of_the_load_is_that_of_a_flat_punch(case):
    step = 1e-5
    c, less, more = (contact(*CASES[case], 0.1 + s) for s in (0, -step, step))
    assert (more.load - less.load) / (2 * step) == pytest.approx(2 * E_STAR * c.a, rel=1e-7)


def test_pressures_of_punch_and_cone_are_singular():
    punch, cone = contact(*CASES["punch"]), contact(*CASES["cone"])
    assert punch.max_pressure == cone.max_pressure == cone.pressure(0, 0) == np.inf
    assert punch.pressure(0, 0) == pytest.approx(punch.mean_pressure / 2, rel=1e-14)
