"""Figures of measured surfaces."""

import numpy as np
import pytest

from .drawn import image_values, surface_panels


def _wavy():
    """A wave of 16 cells in x on a tilted plane [um]."""
    return np.cos(2 * np.pi * np.arange(64) / 16) + 0.5 * np.arange(48.0)[:, None]


def test_heights_are_drawn_above_their_plane_with_iso_numbers():
    figure, panels = surface_panels(_wavy())
    for said in "64 × 48 points, cells of 1 × 1 µm", "Sq 0.70", "Sdq 0.2", "Ssk", "Sku 1.":
        assert said in figure._suptitle.get_text()
    values, x, _ = image_values(figure)
    wave = np.cos(2 * np.pi * np.arange(64) / 16)
    assert np.abs(values[24] - wave).max() < 0.15  # a plane takes a little of a wave
    assert np.array_equal(panels["x"].lines[0].get_ydata(), values[24])
    assert np.array_equal(panels["y"].lines[0].get_ydata(), values[:, 32])
    assert panels["x"].lines[0].get_xdata() == pytest.approx(x) and "[µm]" in panels["x"].get_xlabel()
    density = panels["heights"].patches[-1].get_data()
    assert np.sum(density.values * np.diff(density.edges)) == pytest.approx(1)
    q, c = panels["spectrum"].lines[0].get_data()
    assert q[np.argmax(c)] == pytest.approx(2 * np.pi / 16, rel=0.1)
    assert "[1/µm]" in panels["spectrum"].get_xlabel()


def test_missing_points_are_grey_and_prevent_a_spectrum():
    z = _wavy()
    z[20:28, 5:9] = np.nan
    figure, panels = surface_panels(z)
    assert "32 missing" in figure._suptitle.get_text()
    missing = np.isnan(z)
    grey = np.ma.masked_invalid(figure.axes[0].images[0].get_array())
    assert np.array_equal(~np.ma.getmaskarray(grey), missing)
    assert np.array_equal(np.ma.getmaskarray(image_values(figure)[0]), missing)
    assert np.array_equal(np.isnan(panels["x"].lines[0].get_ydata()), missing[24])
    assert not panels["spectrum"].lines and "points are missing" in panels["spectrum"].texts[0].get_text()


def test_a_spike_does_not_change_the_colours_of_other_heights():
    z = _wavy()
    z[10, 10] += 1000
    figure, panels = surface_panels(z)
    image = figure.axes[0].images[-1]
    assert image.norm.vmax < 100 < 900 < image.get_array().max()  # [um]
    assert panels["heights"].get_xlim()[1] < 100
    assert image.colorbar.extend == "max"


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (5, 6), (60, 4), (4, 60), (16, 16)])
@pytest.mark.parametrize("value", [0.0, 2.0])
def test_small_and_flat_surfaces_are_drawn(shape, value):
    figure, panels = surface_panels(np.full(shape, value))
    assert panels["spectrum"].texts and figure.axes[0].images
    surface_panels(np.random.default_rng(1).normal(size=shape))
