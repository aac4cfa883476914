"""Laws that any analytic contact obeys."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.reference import FlatCircularPunch

from .contacts import CASES, E_STAR, contact, points

each_case = pytest.mark.parametrize(("kind", "geometry"), CASES.values(), ids=CASES)


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
def test_bodies_touch_in_contact_and_only_there(kind, geometry):
    c = contact(kind, geometry)
    x, y = points(c, [0, 0.3, 0.999, 1 - 1e-9])
    assert (c.pressure(x, y) > 0).all()
    gap = c.displacement(x, y) + c.undeformed_distance(x, y) - c.approach
    np.testing.assert_allclose(gap, 0, atol=1e-14 * c.approach)
    x, y = points(c, [1 + 1e-9, 1.001, 1.5, 10, 1e4])
    assert (c.pressure(x, y) == 0).all()
    if kind is FlatCircularPunch:
        assert np.isnan(c.gap(x, y)).all()
    else:
        assert (c.gap(x, y)[1:] > 0).all()


@pytest.mark.parametrize(
    ("case", "exponent"), [("paper", 1.5), ("long in y", 1.5), ("sphere", 1.5), ("punch", 1), ("cone", 2)]
)
def test_load_is_a_power_of_the_approach(case, exponent):
    c, deeper = (contact(*CASES[case], approach) for approach in (0.01, 0.07))
    assert deeper.load / c.load == pytest.approx(7**exponent, rel=1e-13)
    assert deeper.stiffness == pytest.approx(exponent * deeper.load / deeper.approach, rel=1e-13)


@each_case
@pytest.mark.parametrize("approach", [0, 1e-9, 0.1091, 20])
def test_from_load_inverts_from_approach(kind, geometry, approach):
    load = contact(kind, geometry, approach).load
    c = kind.from_load(*geometry, E_STAR, load)
    assert c.approach == pytest.approx(approach, rel=1e-13, abs=0)
    assert c.load == pytest.approx(load, rel=1e-13, abs=0)


@each_case
@pytest.mark.parametrize("approach", [0, -0.1])
def test_no_contact_without_approach(kind, geometry, approach):
    c = contact(kind, geometry, approach)
    x, y = np.linspace(-2, 2, 5), np.zeros((3, 1))
    assert c.a == c.b == c.load == c.max_pressure == c.mean_pressure == c.contact_area == c.stiffness == 0
    for field in (c.pressure(x, y), c.displacement(x, y)):
        np.testing.assert_array_equal(field, np.zeros((3, 5)))
    np.testing.assert_array_equal(c.gap(x, y), c.undeformed_distance(x, y) - approach)
    assert c.gap(0, 0) == -approach


@each_case
def test_fields_broadcast_over_coordinates(kind, geometry):
    c = contact(kind, geometry)
    x, y = np.linspace(-1.3, 1.4, 4) * c.a, np.linspace(-1.1, 1.7, 3) * c.b
    for name in ("pressure", "displacement", "undeformed_distance", "gap"):
        field = getattr(c, name)
        pointwise = [[field(xi, yj) for xi in x] for yj in y]
        np.testing.assert_allclose(field(x, y[:, None]), pointwise, rtol=1e-13, atol=1e-15)


@each_case
@pytest.mark.parametrize("bad", [0, -3, np.nan, np.inf])
def test_parameters_that_are_not_positive_are_named(kind, geometry, bad):
    for i in range(len(geometry) + 1):
        values = [*geometry, E_STAR]
        values[i] = bad
        name = list(kind.__dataclass_fields__)[i]
        for construct in (kind.from_approach, kind.from_load):
            with pytest.raises(InputError, match=rf"^{name} {bad:g}: must be positive and finite"):
                construct(*values, 1.0)


@each_case
def test_wrong_approaches_and_loads_are_named(kind, geometry):
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match=rf"^approach {bad:g}: must be finite"):
            kind.from_approach(*geometry, E_STAR, bad)
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=rf"^load {bad:g}: must be finite and not negative"):
            kind.from_load(*geometry, E_STAR, bad)
