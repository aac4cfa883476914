"""Analytic solutions: published digits, and the laws any half-space contact obeys."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.reference import Cone, EllipticHertz, FlatCircularPunch, Sphere

E_STAR = 82000 / 0.72  # the paper's steel: G / (1 - nu)
CASES = {
    "paper": (EllipticHertz, (300.0, 163.0)),
    "long in y": (EllipticHertz, (20.0, 900.0)),
    "circular": (EllipticHertz, (40.0, 40.0)),
    "sphere": (Sphere, (40.0,)),
    "punch": (FlatCircularPunch, (3.0,)),
    "cone": (Cone, (0.02,)),
}
each_case = pytest.mark.parametrize(("kind", "geometry"), CASES.values(), ids=CASES)


def contact(kind, geometry, approach=0.1091):
    return kind.from_approach(*geometry, E_STAR, approach)


def graded_gauss(n=80):
    """Nodes and weights on (-pi/2, pi/2), dense at 0 and at the ends, where pressures may be singular."""
    t, w = np.polynomial.legendre.leggauss(n)
    t, w = (t + 1) / 2, w / 2
    t, w = t**2 * (3 - 2 * t), w * 6 * t * (1 - t)
    return np.pi / 2 * np.concatenate([-t, t]), np.pi / 2 * np.concatenate([w, w])


def integrated_displacement(c, x, y):
    """Integrate p / (pi E* rho) over the contact ellipse, mapped to the unit circle.

    In polar coordinates about the point, 1/rho cancels against the area element; what is left is the
    integral of p along every chord through the point.
    """
    xi, eta = x / c.a, y / c.b
    d, towards = np.hypot(xi, eta), np.arctan2(-eta, -xi)
    node, weight = graded_gauss()
    if d < 1:
        angle, w_angle = node, weight
        half_chord = np.sqrt(1 - (d * np.sin(angle)) ** 2)
    else:
        angle, half_chord = np.arcsin(np.sin(node) / d), np.cos(node)
        w_angle = weight * half_chord / np.sqrt(d**2 - np.sin(node) ** 2)
    direction = np.array([np.cos(angle + towards), np.sin(angle + towards)])[:, :, None]
    t = (d * np.cos(angle))[:, None] + half_chord[:, None] * np.sin(node)
    p = c.pressure(c.a * (xi + t * direction[0]), c.b * (eta + t * direction[1]))
    chord = half_chord * (p @ (weight * np.cos(node)))
    stretch = np.hypot(c.a * direction[0, :, 0], c.b * direction[1, :, 0])
    return c.a * c.b / (np.pi * c.e_star) * (w_angle @ (chord / stretch))


def points(c, radii):
    """Points on ellipses of `radii` times the contact ellipse, none on a symmetry line."""
    angle = np.array([0.1, 0.8, 1.4, 2.5, 4.0])
    radii = np.asarray(radii)[:, None]
    return c.a * radii * np.cos(angle), c.b * radii * np.sin(angle)


def test_paper_data_to_the_digits_given():
    c = contact(EllipticHertz, (300.0, 163.0))
    assert c.a == pytest.approx(6.00200, abs=5e-6)
    assert c.b == pytest.approx(3.99920, abs=5e-6)
    assert c.max_pressure == pytest.approx(1631.1995, abs=5e-5)
    assert c.load == pytest.approx(82003.858, abs=5e-4)


@each_case
def test_load_is_the_integral_of_the_pressure(kind, geometry):
    c = contact(kind, geometry)
    node, weight = graded_gauss()
    s, w = np.sin(np.abs(node)), weight * np.cos(node) / 2
    angle = 2 * np.pi * np.arange(16) / 16
    p = c.pressure(c.a * s[:, None] * np.cos(angle), c.b * s[:, None] * np.sin(angle))
    # Round-off in 1 - s^2 next to the singular rim of the punch limits the accuracy.
    assert 2 * np.pi * c.a * c.b * (w * s) @ p.mean(axis=1) == pytest.approx(c.load, rel=1e-8)
    assert c.mean_pressure * c.contact_area == pytest.approx(c.load, rel=1e-14)


@each_case
def test_displacement_is_the_integral_of_the_pressure(kind, geometry):
    c = contact(kind, geometry)
    for x, y in zip(*map(np.ravel, points(c, [0.2, 0.7, 1.1, 3])), strict=True):
        assert integrated_displacement(c, x, y) == pytest.approx(c.displacement(x, y), rel=1e-6)


@each_case
def test_far_away_the_load_acts_in_a_point(kind, geometry):
    c = contact(kind, geometry)
    x, y = (1e5 * v / max(c.a, c.b) for v in points(c, [1]))
    np.testing.assert_allclose(c.displacement(x, y) * np.pi * c.e_star * np.hypot(x, y), c.load, rtol=1e-6)


@each_case
def test_bodies_touch_in_contact_and_only_there(kind, geometry):
    c = contact(kind, geometry)
    x, y = points(c, [0, 0.3, 0.999, 1 - 1e-9])
    assert c.in_contact(x, y).all()
    assert (c.pressure(x, y) > 0).all()
    gap = c.displacement(x, y) + c.undeformed_distance(x, y) - c.approach
    np.testing.assert_allclose(gap, 0, atol=1e-14 * c.approach)
    x, y = points(c, [1 + 1e-9, 1.001, 1.5, 10, 1e4])
    assert not c.in_contact(x, y).any()
    assert (c.pressure(x, y) == 0).all()
    if kind is FlatCircularPunch:
        assert np.isnan(c.gap(x, y)).all()
    else:
        assert (c.gap(x, y)[1:] > 0).all()


@each_case
def test_displacement_is_continuous_at_the_rim(kind, geometry):
    c = contact(kind, geometry)
    inside, outside = (c.displacement(*points(c, [1 + s])) for s in (-1e-12, 1e-12))
    np.testing.assert_allclose(inside, outside, rtol=2e-6)


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


@pytest.mark.parametrize("radii", [(300.0, 163.0), (1.0, 1e4), (7.0, 7.0 * (1 + 1e-6))])
def test_swapping_the_radii_swaps_the_axes(radii):
    c, swapped = contact(EllipticHertz, radii), contact(EllipticHertz, radii[::-1])
    assert (swapped.b, swapped.a) == pytest.approx((c.a, c.b), rel=1e-13)
    assert swapped.load == pytest.approx(c.load, rel=1e-13)
    x, y = points(c, [0.5, 2])
    np.testing.assert_allclose(swapped.displacement(y, x), c.displacement(x, y), rtol=1e-12)


def test_equal_radii_give_the_sphere():
    ellipse, sphere = contact(EllipticHertz, (40.0, 40.0)), contact(Sphere, (40.0,))
    for name in ("a", "b", "load", "max_pressure", "mean_pressure", "stiffness", "contact_area"):
        assert getattr(ellipse, name) == pytest.approx(getattr(sphere, name), rel=1e-12), name
    x, y = points(sphere, [0, 0.5, 0.9, 1.1, 3, 1e4])
    for name in ("pressure", "displacement", "undeformed_distance"):
        np.testing.assert_allclose(getattr(ellipse, name)(x, y), getattr(sphere, name)(x, y), rtol=1e-12)


def test_sphere_is_the_limit_of_the_ellipse():
    """The mean of the radii matters to first order, their difference to second."""
    sphere = contact(Sphere, (40.0,))
    errors = []
    for eps in (1e-2, 1e-3):
        ellipse = contact(EllipticHertz, (40.0 * (1 + eps), 40.0 / (1 + eps)))
        errors.append(abs(ellipse.load / sphere.load - 1))
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.05)


@pytest.mark.parametrize(
    ("case", "exponent"), [("paper", 1.5), ("long in y", 1.5), ("sphere", 1.5), ("punch", 1), ("cone", 2)]
)
def test_load_is_a_power_of_the_approach(case, exponent):
    c, deeper = (contact(*CASES[case], approach) for approach in (0.01, 0.07))
    assert deeper.load / c.load == pytest.approx(7**exponent, rel=1e-13)
    assert deeper.stiffness == pytest.approx(exponent * deeper.load / deeper.approach, rel=1e-13)


@pytest.mark.parametrize("case", ["sphere", "punch", "cone"])
def test_slope_of_the_load_is_that_of_a_flat_punch(case):
    step = 1e-5
    c, less, more = (contact(*CASES[case], 0.1 + s) for s in (0, -step, step))
    assert (more.load - less.load) / (2 * step) == pytest.approx(2 * E_STAR * c.a, rel=1e-7)


@each_case
@pytest.mark.parametrize("approach", [0, 1e-9, 0.1091, 20])
def test_from_load_inverts_from_approach(kind, geometry, approach):
    load = contact(kind, geometry, approach).load
    c = kind.from_load(*geometry, E_STAR, load)
    assert c.approach == pytest.approx(approach, rel=1e-13, abs=0)
    assert c.load == pytest.approx(load, rel=1e-13, abs=0)


@each_case
def test_stiffness_scales_the_load_and_size_the_lengths(kind, geometry):
    c = contact(kind, geometry)
    stiff = kind.from_approach(*geometry, 3 * E_STAR, c.approach)
    assert (stiff.a, stiff.load) == pytest.approx((c.a, 3 * c.load), rel=1e-14)
    factors = (1,) if kind is Cone else (10,) * len(geometry)
    large = contact(kind, [f * g for f, g in zip(factors, geometry, strict=True)], 10 * c.approach)
    assert (large.a, large.b, large.load) == pytest.approx((10 * c.a, 10 * c.b, 100 * c.load), rel=1e-12)
    x, y = points(c, [0.4, 2])
    np.testing.assert_allclose(large.pressure(10 * x, 10 * y), c.pressure(x, y), rtol=1e-11)
    np.testing.assert_allclose(large.displacement(10 * x, 10 * y), 10 * c.displacement(x, y), rtol=1e-11)


@each_case
@pytest.mark.parametrize("approach", [0, -0.1])
def test_no_contact_without_approach(kind, geometry, approach):
    c = contact(kind, geometry, approach)
    x, y = np.linspace(-2, 2, 5), np.zeros((3, 1))
    assert c.a == c.b == c.load == c.max_pressure == c.mean_pressure == c.contact_area == c.stiffness == 0
    assert not c.in_contact(x, y).any()
    for field in (c.pressure(x, y), c.displacement(x, y)):
        np.testing.assert_array_equal(field, np.zeros((3, 5)))
    np.testing.assert_array_equal(c.gap(x, y), c.undeformed_distance(x, y) - approach)
    assert c.gap(0, 0) == -approach


@each_case
def test_fields_broadcast(kind, geometry):
    c = contact(kind, geometry)
    x, y = np.linspace(-1.3, 1.4, 4) * c.a, np.linspace(-1.1, 1.7, 3) * c.b
    for name in ("pressure", "displacement", "undeformed_distance", "in_contact", "gap"):
        field = getattr(c, name)
        pointwise = [[field(xi, yj) for xi in x] for yj in y]
        np.testing.assert_allclose(field(x, y[:, None]), pointwise, rtol=1e-13, atol=1e-15)


def test_singular_pressures():
    punch, cone = contact(*CASES["punch"]), contact(*CASES["cone"])
    assert punch.max_pressure == cone.max_pressure == cone.pressure(0, 0) == np.inf
    assert punch.pressure(0, 0) == pytest.approx(punch.mean_pressure / 2, rel=1e-14)


@each_case
@pytest.mark.parametrize("bad", [0, -3, np.nan, np.inf])
def test_bad_values_are_named(kind, geometry, bad):
    for i in range(len(geometry) + 1):
        values = [*geometry, E_STAR]
        values[i] = bad
        name = list(kind.__dataclass_fields__)[i]
        for construct in (kind.from_approach, kind.from_load):
            with pytest.raises(InputError, match=rf"^{name} {bad:g}: must be positive and finite"):
                construct(*values, 1.0)


def test_radii_of_too_great_a_ratio_are_refused():
    with pytest.raises(InputError, match="rx 1e-100, ry 1e\\+100: must be less unlike"):
        _ = EllipticHertz.from_approach(1e-100, 1e100, 1.0, 1.0).a
    assert EllipticHertz.from_approach(1e-60, 1e60, 1.0, 1.0).a > 0


@each_case
def test_bad_loadings_are_named(kind, geometry):
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match=rf"^approach {bad:g}: must be finite"):
            kind.from_approach(*geometry, E_STAR, bad)
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=rf"^load {bad:g}: must be finite and not negative"):
            kind.from_load(*geometry, E_STAR, bad)
