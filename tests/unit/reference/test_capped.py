"""Line contact and waves with a hardness."""

import math
from itertools import pairwise

import numpy as np
import pytest
from cases import capped_line
from scipy.integrate import quad

from app.base.errors import InputError
from app.reference import CappedLineContact, CappedWestergaard, Westergaard

RADIUS, E_STAR = 12.0, 900.0
EDGES = pytest.mark.parametrize("k", [0.01, 0.3, 0.7, 0.95, 1 - 1e-9])
LENGTH, AMPLITUDE = 1.7, 0.02
FULL = math.pi * E_STAR * AMPLITUDE / LENGTH
# hardness and mean pressure over p*: few or many plastic points, next to both limits of the three parts
WAVES = [(0.5, 0.2), (1.0, 0.5), (1.9, 0.94), (0.1, 0.03), (1.5, 0.5626), (1.5, 0.9374)]


def line(k, a=0.8):
    return capped_line(RADIUS, E_STAR, a, k * a)


def wave(hardness, share):
    return CappedWestergaard(AMPLITUDE, LENGTH, E_STAR, share * FULL, hardness * FULL)


def integrate(f, *ends):
    """Integrate a function with square roots at the ends of parts."""
    return sum(
        quad(lambda t, a=a, b=b: f(a + (b - a) * t**2 * (3 - 2 * t)) * 6 * t * (1 - t) * (b - a), 0, 1)[0]
        for a, b in pairwise(ends)
    )


@EDGES
def test_pressure_of_a_line_contact_carries_its_load(k):
    c = line(k)
    assert 2 * integrate(c.pressure, 0, c.c, c.a) == pytest.approx(c.load, rel=1e-8)
    x = np.array([0, 0.5 * c.c, c.c * (1 - 1e-12), c.a, 2 * c.a])
    np.testing.assert_allclose(c.pressure(x), [c.hardness] * 3 + [0, 0], rtol=1e-12)
    assert 0 < c.pressure((c.a + c.c) / 2) < c.hardness == c.max_pressure


@EDGES
def test_pressure_of_a_line_contact_moves_the_surface_onto_the_parabola(k):
    """In elastic contact x / R + u' is 0; u' = -2 / (pi E*) times the integral of log|s - x| p'."""
    c = line(k)
    n = 4000
    t = math.pi / 2 * (np.arange(n) + 0.5) / n
    s = np.sqrt(c.c**2 * np.cos(t) ** 2 + c.a**2 * np.sin(t) ** 2)  # dp is smooth in t
    edges = math.pi / 2 * np.arange(n + 1) / n
    p = c.pressure(np.sqrt(c.c**2 * np.cos(edges) ** 2 + c.a**2 * np.sin(edges) ** 2))

    def slope(x):
        return x / RADIUS - 2 / (math.pi * E_STAR) * (np.log(np.abs((s - x) / (s + x))) @ np.diff(p))

    scale = c.a / RADIUS
    x = s[n // 3]
    middle = (slope((s[n // 3 - 1] + x) / 2) + slope((s[n // 3 + 1] + x) / 2)) / 2
    assert abs(middle) < 2e-3 * scale
    x, step = 0.6 * c.c, 1e-5 * c.c
    depth = c.plastic_depth(np.array([x - step, x + step]))
    assert slope(x) == pytest.approx((depth[0] - depth[1]) / (2 * step), abs=2e-3 * scale)


@EDGES
def test_plastic_volume_is_the_integral_of_the_depth(k):
    c = line(k)
    assert 2 * integrate(c.plastic_depth, 0, c.c) == pytest.approx(c.plastic_volume, rel=1e-8 / k**4)
    assert c.plastic_depth(c.c) == c.plastic_depth(c.a) == 0
    m = c.a**2 / c.c**2
    log = math.atanh(k)
    closed = c.a**2 / RADIUS * (c.load / (math.pi * E_STAR / (2 * RADIUS) * c.a**2) * log - k / 2)
    assert c.max_plastic_depth == pytest.approx(closed, rel=1e-13 * m + 1e-8)


@EDGES
def test_load_and_hardness_give_the_edges(k):
    c = line(k)
    same = CappedLineContact(RADIUS, E_STAR, c.hardness, c.load)
    assert (same.a, same.c) == pytest.approx((c.a, c.c), rel=1e-7 if k < 0.1 else 1e-12)


def test_line_contact_has_its_limits():
    soft = line(1 - 1e-12)
    assert soft.load == pytest.approx(2 * soft.a * soft.hardness, rel=1e-10)
    hard = CappedLineContact(RADIUS, E_STAR, math.inf, 100.0)
    least = CappedLineContact(RADIUS, E_STAR, hard.max_pressure * (1 - 1e-9), 100.0)
    x = np.linspace(-1.1, 1.1, 23) * hard.a
    hertz = hard.max_pressure * np.sqrt(np.maximum(1 - (x / hard.a) ** 2, 0))
    np.testing.assert_allclose(hard.pressure(x), hertz, atol=1e-13 * hard.max_pressure)
    np.testing.assert_allclose(least.pressure(x), hertz, atol=1e-8 * hard.max_pressure)
    assert not hard.is_plastic and least.is_plastic
    assert hard.c == hard.plastic_volume == hard.max_plastic_depth == 0
    assert hard.max_pressure == pytest.approx(E_STAR * hard.a / (2 * RADIUS), rel=1e-14)


@pytest.mark.parametrize(("hardness", "share"), WAVES)
def test_means_of_waves_are_means(hardness, share):
    c = wave(hardness, share)
    ends = 0, c.plastic_half_width, c.half_width, LENGTH / 2
    assert c.is_plastic and not c.is_full and sorted(ends) == list(ends)
    node, weight = np.polynomial.legendre.leggauss(60)
    t = (node + 1) / 2
    for f, mean in (
        (c.pressure, c.mean_pressure),
        (c.gap, c.mean_gap),
        (c.plastic_depth, c.mean_plastic_depth),
    ):
        value = sum(
            width * (f(start + width * t**2 * (3 - 2 * t), 0.0) @ (6 * t * (1 - t) * weight))
            for start, width in zip(ends, np.diff(ends), strict=False)
        )
        assert value / LENGTH == pytest.approx(mean, rel=1e-6, abs=1e-12 * AMPLITUDE)
    inside = c.plastic_half_width * np.array([0, 0.9, 1 - 1e-9]) + 3 * LENGTH
    np.testing.assert_allclose(c.pressure(inside, 0), c.hardness, rtol=1e-12)


@pytest.mark.parametrize(("hardness", "share"), [*WAVES, (1.5, 0.95), (1.5, 0.4), (3.0, 2.9), (1.0, 1.0)])
def test_displacement_of_waves_is_that_of_the_pressure(hardness, share):
    """u_q = 2 p_q / (E* |q|), by a Fourier sum."""
    c, n = wave(hardness, share), 2**13
    x = LENGTH * (np.arange(n) + 0.5) / n
    spectrum, q = np.fft.rfft(c.pressure(x, 0)), 2 * np.pi * np.fft.rfftfreq(n, LENGTH / n)
    u = np.fft.irfft(2 / E_STAR * np.concatenate([[0], spectrum[1:] / q[1:]]), n)
    np.testing.assert_allclose(u, c.displacement(x, 0), atol=2e-5 / min(hardness, 1) * AMPLITUDE)


def test_regimes_of_waves_meet():
    """Westergaard without a plastic, mirrored without an open part."""
    x = np.linspace(0, LENGTH / 2, 30)
    elastic = Westergaard(AMPLITUDE, LENGTH, E_STAR, 0.25 * FULL)
    for more in (1e-9, -1e-9):
        c = wave(1.0 + more, 0.25)
        np.testing.assert_allclose(c.pressure(x, 0), elastic.pressure(x, 0), atol=1e-7 * FULL)
        full = wave(1.0, 0.75 + more)
        assert full.is_full == (more > 0) and full.is_plastic
        mirrored = FULL - elastic.pressure(x + LENGTH / 2, 0)
        np.testing.assert_allclose(full.pressure(x, 0), mirrored, atol=1e-7 * FULL)
    assert wave(1.0, 0.75 + 1e-9).half_width == LENGTH / 2
    assert wave(math.inf, 0.3).mean_gap == Westergaard(AMPLITUDE, LENGTH, E_STAR, 0.3 * FULL).mean_gap


def test_waves_have_their_limits():
    plastic = wave(1.0, 1.0)  # the approach is the smallest one
    assert (plastic.approach, plastic.plastic_fraction) == pytest.approx((2 * AMPLITUDE, 1), rel=1e-14)
    soft = wave(0.02, 0.005)
    assert soft.contact_fraction == pytest.approx(0.25, abs=1e-9)
    # light loads: strips are capped line contacts
    radius = LENGTH**2 / (4 * np.pi**2 * AMPLITUDE)
    c = wave(1e-3, 1e-6)
    strip = CappedLineContact(radius, E_STAR, c.hardness, c.mean_pressure * LENGTH)
    assert (c.half_width, c.plastic_half_width) == pytest.approx((strip.a, strip.c), rel=1e-5)
    assert c.max_plastic_depth == pytest.approx(strip.max_plastic_depth, rel=1e-5)


@pytest.mark.parametrize("bad", [0, -1.0, np.nan, "1"])
def test_wrong_hardnesses_are_refused(bad):
    with pytest.raises(InputError, match="hardness"):
        CappedLineContact(RADIUS, E_STAR, bad, 1.0)
    with pytest.raises(InputError, match="hardness"):
        CappedWestergaard(AMPLITUDE, LENGTH, E_STAR, 1.0, bad)


def test_loads_beyond_the_hardness_are_refused():
    with pytest.raises(InputError, match="must be at most the hardness"):
        wave(0.5, 0.51)
    with pytest.raises(InputError, match="too large for this hardness"):
        _ = CappedLineContact(RADIUS, E_STAR, 1.0, 1e9).a
    with pytest.raises(InputError, match="too small for this mean pressure"):
        _ = wave(1e-3, 5e-4).approach
