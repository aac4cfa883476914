"""Elliptic contact: published digits, limits, extreme ellipses."""

import numpy as np
import pytest

from app import EllipticHertz, InputError, reference

from .contacts import contact, points


def test_hertz_has_the_digits_of_the_paper():
    c = contact(EllipticHertz, (300.0, 163.0))
    assert c.a == pytest.approx(6.00200, abs=5e-6)
    assert c.b == pytest.approx(3.99920, abs=5e-6)
    assert c.max_pressure == pytest.approx(1631.1995, abs=5e-5)
    assert c.load == pytest.approx(82003.858, abs=5e-4)


@pytest.mark.parametrize(
    "radii", [(1.0, 1e4), (1e4, 1.0), (1.0, 1e8), (1e12, 1.0), (1.0, 1 + 1e-15), (1.0, 1 + 1e-9)]
)
def test_extreme_ellipses_touch_in_contact_and_only_there(radii):
    c = contact(EllipticHertz, radii)
    np.testing.assert_allclose(c.gap(*points(c, [0, 0.3, 0.99])), 0, atol=1e-14 * c.approach)
    assert (c.gap(*points(c, [1.001, 1.5, 10, 1e4])) > 0).all()
    assert c.load == pytest.approx(2 / 3 * c.contact_area * c.max_pressure, rel=1e-14)


def test_slender_ellipse_is_a_line_contact_across():
    """Cylinders: p_max = E* b / (2 R) on the half-width b; the ellipse differs by (b/a)^2 log(a/b)."""
    c = contact(EllipticHertz, (1e8, 5.0))
    assert c.max_pressure == pytest.approx(c.e_star * c.b / (2 * 5.0), rel=1e-6)


def test_radii_of_too_great_a_ratio_are_refused():
    with pytest.raises(InputError, match="rx 1e-100, ry 1e\\+100: must have a ratio closer to 1"):
        _ = EllipticHertz.from_approach(1e-100, 1e100, 1.0, 1.0).a
    assert EllipticHertz.from_approach(1e-60, 1e60, 1.0, 1.0).a > 0


def test_a_radius_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="rx '10': must be a number"):
        EllipticHertz.from_load("10", 10, 1e5, 100)
    with pytest.raises(InputError, match="needs rx, ry, e_star and load; load is missing"):
        EllipticHertz.from_load(10, 1e5, 100)


def test_names_of_analytic_solutions_are_listed():
    assert dir(reference) == sorted(reference.__all__)
