"""Periodic analytic solutions, by quadrature and Fourier sums."""

import numpy as np
import pytest
from scipy.integrate import quad

from app.reference import Bisinusoidal, Westergaard, full_contact_pressure

E_STAR, AMPLITUDE, LENGTH = 900.0, 0.02, 1.7
FULL = np.pi * E_STAR * AMPLITUDE / LENGTH
SHARES = 0.01, 0.3, 0.8, 0.999


def westergaard(share):
    return Westergaard(AMPLITUDE, LENGTH, E_STAR, share * FULL)


def bisinusoidal(share):
    return Bisinusoidal(AMPLITUDE, LENGTH, E_STAR, share * np.sqrt(2) * FULL)


def flattened(pressure, dx, dy):
    """Displacement under a periodic pressure, of mean 0: u_q = 2 p_q / (E* |q|)."""
    ny, nx = pressure.shape
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(ny, dy)[:, None], np.fft.fftfreq(nx, dx))
    spectrum = np.fft.fft2(pressure)
    spectrum[0, 0], q[0, 0] = 0, 1
    return np.fft.ifft2(2 / E_STAR * spectrum / q).real


@pytest.mark.parametrize("share", SHARES)
def test_mean_pressure_and_mean_gap_are_means(share):
    c = westergaard(share)

    def mean(f, ends):
        return 2 * quad(lambda x: float(f(x, 0.0)), *ends, epsabs=1e-14)[0] / LENGTH

    assert mean(c.pressure, (0, c.half_width)) == pytest.approx(c.mean_pressure, rel=1e-9)
    assert mean(c.gap, (c.half_width, LENGTH / 2)) == pytest.approx(c.mean_gap, rel=1e-9)
    assert c.contact_fraction == pytest.approx(2 / np.pi * np.arcsin(np.sqrt(share)), rel=1e-12)


@pytest.mark.parametrize("share", SHARES)
def test_bodies_touch_in_contact_and_only_there(share):
    c = westergaard(share)
    b = c.half_width
    inside, outside = b * np.array([0, 0.3, 1 - 1e-9]), b + (LENGTH / 2 - b) * np.array([1e-6, 0.3, 1])
    for shift in (0, LENGTH, -3 * LENGTH):
        assert (c.pressure(inside + shift, 0) > 0).all()
        assert (c.gap(inside + shift, 0) == 0).all()
        assert (c.gap(outside + shift, 0)[1:] > 0).all()
        assert (c.pressure(outside + shift, 0) == 0).all()
    # e is of order 3/2 at the rim, the pressure of order 1/2
    assert c.gap(b + 4e-6, 0) / c.gap(b + 1e-6, 0) == pytest.approx(8, rel=0.01)
    assert c.pressure(b - 4e-8, 0) / c.pressure(b - 1e-8, 0) == pytest.approx(2, rel=0.01)


@pytest.mark.parametrize("share", SHARES)
def test_displacement_is_that_of_the_pressure(share):
    # The pressure has corners: its sum over cells is of order 3/2 in the coefficients, and better in u.
    c = westergaard(share)
    n = 2**15
    x = LENGTH * (np.arange(n) + 0.5) / n
    u = flattened(c.pressure(x, 0)[None], LENGTH / n, LENGTH)[0]
    np.testing.assert_allclose(u, c.displacement(x, 0), atol=2e-6 * AMPLITUDE)


def test_westergaard_has_its_limits():
    free, full, more = westergaard(0), westergaard(1), westergaard(1.5)
    x = np.linspace(-LENGTH, LENGTH, 41)
    np.testing.assert_array_equal(free.gap(x, 0), free.undeformed_distance(x, 0))
    assert (free.mean_gap, free.approach, free.half_width) == (AMPLITUDE, 0, 0)
    assert full.is_full and (full.mean_gap, full.contact_fraction) == pytest.approx((0, 1), abs=1e-15)
    np.testing.assert_allclose(more.pressure(x, 0), FULL * (1.5 + np.cos(2 * np.pi * x / LENGTH)), rtol=1e-13)
    np.testing.assert_allclose(westergaard(1 - 1e-12).pressure(x, 0), full.pressure(x, 0), atol=1e-5 * FULL)
    # lightly loaded strips are Hertz's line contacts: b^2 = 4 F R / (pi E*), F the load of a strip over its length
    light, radius = westergaard(1e-6), LENGTH**2 / (4 * np.pi**2 * AMPLITUDE)
    line = 4 * light.mean_pressure * LENGTH * radius / (np.pi * E_STAR)
    assert light.half_width**2 == pytest.approx(line, rel=1e-5)
    assert light.max_pressure == pytest.approx(E_STAR * light.half_width / (2 * radius), rel=1e-5)


def test_stiffness_is_the_derivative_of_the_load():
    """d(mean gap) / d(mean pressure) = a / p* log(pbar / p*)."""
    c, step = westergaard(0.3), 1e-5
    slope = (westergaard(0.3 + step).mean_gap - westergaard(0.3 - step).mean_gap) / (2 * step * FULL)
    assert slope == pytest.approx(AMPLITUDE / FULL * np.log(0.3), rel=1e-8)
    assert c.approach + c.mean_gap == AMPLITUDE


def test_full_contact_flattens_any_surface():
    rng = np.random.default_rng(3)
    h, dx, dy = rng.random((12, 15)), 0.1, 0.17
    p = full_contact_pressure(h, dx, dy, E_STAR, 5.0)
    assert p.mean() == pytest.approx(5, rel=1e-12)
    np.testing.assert_allclose(h + flattened(p, dx, dy), h.mean(), atol=1e-13)


@pytest.mark.parametrize("kind", [westergaard, bisinusoidal])
def test_full_contact_flattens_waves(kind):
    c = kind(1.2)
    x, y = LENGTH * np.arange(24)[None] / 24, LENGTH * np.arange(20)[:, None] / 20
    p = full_contact_pressure(c.undeformed_distance(x, y), LENGTH / 24, LENGTH / 20, E_STAR, c.mean_pressure)
    np.testing.assert_allclose(c.full_pressure(x, y), p, rtol=1e-12)
    assert c.is_full and p.min() == pytest.approx(0.2 * c.full_contact_at, rel=1e-12)
    assert not kind(0.99).is_full


def test_two_waves_have_their_asymptotes():
    c = bisinusoidal(0.02)
    assert c.light_contact_fraction == pytest.approx(np.pi * (3 / (8 * np.pi) * 0.02) ** (2 / 3), rel=1e-9)
    assert c.on_a_summit.load * 2 == pytest.approx(c.mean_pressure * LENGTH**2, rel=1e-12)
    assert bisinusoidal(0.9).heavy_contact_fraction == pytest.approx(1 - 0.15 / np.pi, rel=1e-12)
    assert bisinusoidal(1).heavy_mean_gap == pytest.approx(0, abs=1e-30)


def test_crack_near_full_contact_follows_from_its_tension():
    """Sneddon: w = 4 / (pi E*) int_r^c dt / sqrt(t^2 - r^2) int_0^t s T(s) / sqrt(t^2 - s^2) ds, closed smoothly."""
    c = bisinusoidal(0.99)
    k, radius = 2 * np.pi / LENGTH, c.hollow_radius

    def inner(t):
        return t * (c.full_contact_at - c.mean_pressure) - c.full_contact_at * k**2 / 2 * 2 * t**3 / 3

    assert inner(radius) == pytest.approx(0, abs=1e-12)
    # The volume: the order of integration exchanged, int_0^t r / sqrt(t^2 - r^2) dr = t
    volume = 2 * np.pi * 4 / (np.pi * E_STAR) * quad(lambda t: t * inner(t), 0, radius)[0]
    assert c.heavy_mean_gap == pytest.approx(2 * volume / LENGTH**2, rel=1e-10)


@pytest.mark.parametrize("kind", [Westergaard, Bisinusoidal])
@pytest.mark.parametrize(
    "wrong", [{"amplitude": 0}, {"wavelength": -1}, {"e_star": np.inf}, {"mean_pressure": np.nan}]
)
def test_wrong_parameters_of_waves_are_refused(kind, wrong):
    good = {"amplitude": 1, "wavelength": 1, "e_star": 1, "mean_pressure": 1}
    with pytest.raises(ValueError, match=next(iter(wrong))):
        kind(**(good | wrong))
