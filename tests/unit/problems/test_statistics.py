"""Statistics of heights."""

import numpy as np
import pytest
from scipy.special import ndtri

from app import Grid, InputError, SelfAffineSurface, read_surface
from app.problems.statistics import normal_plot, radial_spectrum, roughness


def test_a_wave_has_its_moments():
    n, dx, dy, amplitude = 60, 0.1, 0.2, 0.3
    q = 2 * np.pi * 4 / (n * dx)
    height = 5 + amplitude * np.cos(q * np.arange(n) * dx) * np.ones((7, 1))
    moments = roughness(height, dx, dy)
    assert moments.rms_height == pytest.approx(amplitude / np.sqrt(2), rel=1e-12)
    assert moments.skewness == pytest.approx(0, abs=1e-12)
    assert moments.kurtosis == pytest.approx(1.5, rel=1e-12)
    # 15 points a wave.
    assert moments.arithmetic_mean_height == pytest.approx(amplitude * 2 / np.pi, rel=0.01)
    assert moments.maximum_height == pytest.approx(amplitude * (1 + np.cos(np.pi / 15)), rel=1e-12)
    assert moments.rms_slope_y == 0
    expected = q * amplitude / np.sqrt(2) * np.sin(q * dx / 2) / (q * dx / 2)
    assert moments.rms_slope_x == pytest.approx(expected, rel=0.01)  # one face less than cells


def test_roughness_of_a_surface_is_that_of_its_heights():
    heights = np.random.default_rng(1).normal(size=(8, 9))
    surface = read_surface(heights, "um", spacing=(0.02, 0.03))
    assert roughness(surface) == roughness(surface.heights(), 0.02, 0.03)
    with pytest.raises(InputError, match="dx None"):
        roughness(read_surface(heights, "um"))


def test_roughness_scales_and_reflects():
    height = np.random.default_rng(2).exponential(size=(30, 20))
    base, other = roughness(height, 1, 1), roughness(7 - 2 * height, 1, 1)
    assert other.rms_height == pytest.approx(2 * base.rms_height)
    assert other.rms_slope == pytest.approx(2 * base.rms_slope)
    assert other.skewness == pytest.approx(-base.skewness)
    assert other.kurtosis == pytest.approx(base.kurtosis)
    assert other.arithmetic_mean_height == pytest.approx(2 * base.arithmetic_mean_height)
    assert other.maximum_height == pytest.approx(2 * base.maximum_height)
    assert base.skewness > 1


def test_a_flat_surface_has_no_skewness():
    moments = roughness(np.full((4, 4), 0.1), 1, 1)
    assert moments.rms_slope == 0
    assert np.isnan([moments.skewness, moments.kurtosis, normal_plot(np.full(9, 0.1)).correlation]).all()


def test_spectrum_adds_up_to_the_variance():
    # No wave beyond the last ring.
    surface = SelfAffineSurface(0.8, 4.0, 0.5, (12.0, 10.0), 3, rms_height=0.1)
    height = surface.heights_on(Grid.from_domain(100, 90, (0, 12, 0, 10)))
    spectrum = radial_spectrum(height, 12 / 100, 10 / 90)
    assert np.sum(spectrum.count * spectrum.density) / 120 == pytest.approx(height.var(), rel=1e-12)


@pytest.mark.parametrize("window", [False, True])
def test_spectrum_of_white_noise_is_variance_times_cell_area(window):
    dx, dy = 0.1, 0.3
    height = np.random.default_rng(4).normal(scale=0.2, size=(128, 384))
    spectrum = radial_spectrum(height, dx, dy, window)
    mean = np.average(spectrum.density, weights=spectrum.count)
    assert mean == pytest.approx(0.2**2 * dx * dy, rel=0.03)


def test_spectrum_rings_are_closed():
    count = radial_spectrum(np.eye(64), 1, 1).count
    assert len(count) == 31
    np.testing.assert_allclose(count[9:], 2 * np.pi * np.arange(10, 32), rtol=0.15)


def test_window_suppresses_the_edges_of_a_tilted_patch():
    x = np.arange(64) / 64
    height = np.tile(x, (64, 1))  # not periodic: without a window its jump leaks into all wave numbers
    plain, windowed = (radial_spectrum(height, 1 / 64, 1 / 64, window) for window in (False, True))
    assert windowed.density[-1] < 1e-3 * plain.density[-1]


def test_normal_plot_of_normal_quantiles_is_a_straight_line():
    quantiles = ndtri((np.arange(50) + 0.5) / 50)
    plot = normal_plot(np.random.default_rng(6).permutation(2 + 3 * quantiles).reshape(5, 10))
    assert plot.correlation == pytest.approx(1, abs=1e-14)
    np.testing.assert_allclose(plot.height, 2 + 3 * plot.quantile, rtol=1e-12)


HEIGHTS = np.random.default_rng(3).random((6, 8)) * 1e-3


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda: roughness(np.zeros((1, 5)), 1, 1), "at least 2 x 2"),
        (lambda: roughness(np.full((3, 3), np.nan), 1, 1), "finite"),
        (lambda: radial_spectrum(np.zeros((4, 3)), 1, 1), "at least 4 x 4"),
        (lambda: normal_plot([1.0]), "at least 2 heights"),
        (lambda: radial_spectrum("heights.npy", 0.1, 0.1), "heights: must be an array of real"),
        (lambda: roughness(HEIGHTS, 0, 0.1), "dx 0: must be positive"),
        (lambda: radial_spectrum(HEIGHTS, 0.1, -0.1), "dy -0.1: must be positive"),
    ],
)
def test_wrong_heights_are_refused(function, message):
    with pytest.raises(ValueError, match=message):
        function()
