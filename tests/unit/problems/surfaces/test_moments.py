"""Moments of heights: rms values, spikes."""

import numpy as np
import pytest

from app import read_surface
from app.problems.surfaces import moments

from .maps import HEIGHTS, NX, NY, X, Y


@pytest.mark.parametrize("tilt", [0, 1e3])
@pytest.mark.parametrize("run", [1, 3, 4, 12])
def test_the_highest_spike_does_not_depend_on_the_runs_of_rows(monkeypatch, run, tilt):
    """About the best plane, however tilted that is."""
    heights = HEIGHTS + tilt * (X - 2 * Y)
    heights[np.random.default_rng(3).random(heights.shape) < 0.2] = np.nan
    heights[7, 4] += 9
    flat = read_surface(heights, "mm", "plane").heights()
    j, i = np.indices(heights.shape) + 1
    padded = np.pad(flat, 1, constant_values=np.nan)
    neighbours = np.fmax.reduce([padded[j + dj, i + di] for dj, di in ((1, 0), (-1, 0), (0, 1), (0, -1))])
    expected = np.nanmax(flat - neighbours)
    monkeypatch.setattr(moments, "RUN", run * NX)
    height, _, row, column = read_surface(heights, "mm").spike
    assert height == pytest.approx(expected) and (flat - neighbours)[row, column] == pytest.approx(expected)
    crop = (column, NX, row, NY)  # numbers are those of the whole file
    assert read_surface(heights, "mm", crop=crop).spike[2:] == (row, column)


@pytest.mark.parametrize("level", moments.LEVELS)
@pytest.mark.parametrize("run", [2, 12])
def test_rms_height_skewness_and_kurtosis_are_those_of_the_heights(monkeypatch, level, run):
    monkeypatch.setattr(moments, "RUN", run * NX)
    heights = HEIGHTS**3 + 1e4 * X - 1e5
    heights[2:5, 7:9] = np.nan
    surface = read_surface(heights, "mm", level)
    assert surface.rms_height == pytest.approx(np.nanstd(surface.heights()), rel=1e-6)
    about = "quadratic" if level == "quadratic" else "plane"
    flat = read_surface(heights, "mm", about).heights()
    steps = [np.sqrt(np.nanmean(np.diff(flat, axis=axis) ** 2)) for axis in (1, 0)]
    assert surface.steps == pytest.approx(steps, rel=1e-6)
    flat = flat[~np.isnan(flat)]
    assert (surface.rms_level, surface.skewness, surface.kurtosis) == pytest.approx(
        (flat.std(), *(np.mean(flat**k) / flat.std() ** k for k in (3, 4))), rel=1e-6
    )
    assert f"skewness {surface.skewness:.2g}, kurtosis {surface.kurtosis:.2g};" in surface.understood(
        surface.grid((0, 1, 0, 1))
    )
    assert ("after quadratic level: rms height" in surface.understood(surface.grid((0, 1, 0, 1)))) == (
        level == "quadratic"
    )
    filtered = surface.filtered(surface.grid((0, NX, 0, NY)), s_filter=3)
    assert filtered.rms_height == pytest.approx(np.nanstd(filtered.heights()), rel=1e-6)
    ends = (
        read_surface(np.full((4, 4), 7.0), "mm", spacing=(1, 1)),
        read_surface([[1e45, -1e45, -1e45, 1e45]] * 4, "mm"),
    )
    assert np.isnan(ends[0].skewness) and "skewness" not in str(ends[0])
    assert ends[1].kurtosis == pytest.approx(1)
