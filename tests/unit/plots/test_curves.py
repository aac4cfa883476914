"""Distributions and spectra."""

from dataclasses import replace

import numpy as np
import pytest
from results import made_up_result, with_attributes

from app.halfspace.grid import Grid
from app.plots import curves


def test_distribution_of_nearly_equal_values_fills_its_panel(result):
    pressure = np.where(result.pressure > 0, 1000 + result.pressure / 1e3, 0.0)
    axes = curves.distribution_figure(replace(result, pressure=pressure)).axes[0]
    low, high = axes.get_xlim()
    assert np.ptp(axes.lines[0].get_xdata()) > 0.8 * (high - low)


def test_several_contact_spots_have_a_panel_of_sizes(result):
    labels = [axes.get_xlabel() for axes in curves.distribution_figure(result).axes]
    assert len(labels) == 2 and "pressure" in labels[0] and "gap" in labels[1]


def test_distributions_integrate_to_one():
    rng = np.random.default_rng(2)
    made = made_up_result(64, 48)
    pressure = np.where(rng.random((48, 64)) < 0.5, rng.exponential(100.0, (48, 64)), 0.0)
    figure = curves.distribution_figure(replace(made, pressure=pressure, contact=pressure > 0))
    p, density = figure.axes[0].lines[0].get_data()
    assert np.sum((density[1:] + density[:-1]) / 2 * np.diff(p)) == pytest.approx(1, abs=0.03)
    assert np.median(density[p < 20]) == pytest.approx(1 / 100, rel=0.3)  # exponential: level at small values
    area, patches = figure.axes[2].lines[0].get_data()
    assert patches[-1] >= 1 and (np.diff(patches) < 0).all() and (np.diff(area) > 0).all()


def test_spectrum_of_a_wave_peaks_at_its_wave_number():
    made = with_attributes(made_up_result(128, 128), problem="given")
    grid = Grid.from_domain(128, 128, (0, 2, 0, 2))
    wave = 1e-3 * np.cos(2 * np.pi * 12 * grid.x() / 2) + 1e-6 * np.random.default_rng(3).random((128, 128))
    surface = replace(made, x=grid.x(), y=grid.y(), undeformed_distance=wave)
    periodic = curves.spectrum_figure(with_attributes(surface, periodic_symbol="spectral"))
    q, density = periodic.axes[0].lines[0].get_data()
    assert q[np.argmax(density)] == pytest.approx(2 * np.pi * 6, rel=0.02)
    bowl = surface.undeformed_distance + 0.1 * (grid.x() - 1) ** 2 + 0.2 * grid.y()[:, None]
    q, density = (
        curves.spectrum_figure(replace(surface, undeformed_distance=bowl)).axes[0].lines[0].get_data()
    )
    assert q[np.argmax(density)] == pytest.approx(2 * np.pi * 6, rel=0.1)


@pytest.mark.parametrize("rolloff, cutoff", [(2.0, 0.25), (1.0, 0.05), (0.5, 0.02)])
def test_spectrum_lies_within_its_axes(rolloff, cutoff):
    grid = Grid.from_domain(64, 64, (0, 2, 0, 2))
    waves = np.hypot(*np.meshgrid(np.fft.fftfreq(64, 2 / 64), np.fft.fftfreq(64, 2 / 64)))
    amplitudes = np.maximum(waves, 1 / rolloff) ** -1.8 * (waves > 0) * (waves <= 1 / cutoff)
    noise = np.random.default_rng(1).standard_normal((64, 64))
    heights = np.fft.ifft2(np.fft.fft2(noise) * amplitudes).real
    options = {"hurst": 0.8, "rolloff": rolloff, "cutoff": cutoff}
    made = with_attributes(made_up_result(64, 64), problem="rough", surfaces=1, periodic_symbol="spectral")
    made = with_attributes(made, **{f"surface_{name}": value for name, value in options.items()})
    axes = curves.spectrum_figure(replace(made, x=grid.x(), y=grid.y(), undeformed_distance=-heights)).axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    labels = [line.get_label() for line in axes.lines]
    assert {label.split(",")[0].split()[0] for label in labels} >= {"undeformed", "roll-off", "cut-off"}
    for line in axes.lines:
        x, y = line.get_data()
        assert left < np.min(x) and np.max(x) < right
        assert "λ" in line.get_label() or (low < np.min(y) and np.max(y) < high)
    assert right < 1.5 * max(np.max(line.get_xdata()) for line in axes.lines)


@pytest.mark.parametrize("problem", ["hertz", "sphere", "cylinder", "cone", "punch"])
def test_only_bodies_with_a_surface_have_a_spectrum(result, problem):
    assert curves.spectrum_figure(result) is None
    kink = replace(result, undeformed_distance=np.hypot(*np.meshgrid(result.x, result.y)))
    for periodic_symbol in ("", "spectral"):
        body = with_attributes(kink, problem=problem, periodic_symbol=periodic_symbol)
        assert curves.spectrum_figure(body) is None
        assert curves.spectrum_figure(with_attributes(body, surfaces=1)) is not None
