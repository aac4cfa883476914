"""Stress below the contact."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from results import with_attributes

from app.api.subsurface import survey as api_survey
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.halfspace.stress.layered import LayeredStress
from app.halfspace.stress.subsurface import StressMaximum, von_mises
from app.plots import figures, stress


def survey(grid, depths, section_x, section_y, line, von_mises):
    """Stresses as those of `app.api.subsurface.survey`, the largest at the origin and at half the depth."""
    at = StressMaximum(von_mises, float(grid.x()[grid.nx // 2]), 0.0, depths[-1] / 2, np.zeros(6))
    sections = {"section_x": section_x, "section_y": section_y, "line": line}
    return SimpleNamespace(depths=depths, at=at, interface=None, **sections)


def bell(grid, along, depths):
    """Stress on a section that falls with the distance from a point."""
    s = grid.x() if along == "x" else grid.y()
    section = np.zeros((6, depths.size, s.size))
    section[2] = -np.exp(-((depths[:, None] / depths[-1] - 0.5) ** 2)) * np.exp(-4 * s**2)
    return section


def draw(deepest, height=1.0):
    grid, z = Grid.from_domain(200, 50, (-1, 1, -height, height)), np.linspace(0, deepest, 21)
    x, y = bell(grid, "x", z), bell(grid, "y", z)
    figure = stress.stress_figure(grid, survey(grid, z, x, y, x[:, :, 100], 1.0), "")
    figure.canvas.draw()
    return figure.axes[0], figure.axes[2]


@pytest.mark.parametrize(("deepest", "times"), [(1.0, None), (0.1, 5.12), (10, 0.2)])
def test_sections_state_the_scale_of_depth(deepest, times):
    axes, _ = draw(deepest)
    box = axes.get_window_extent()
    unit = 1e3 if "µm" in axes.get_ylabel() else 1
    drawn = box.height / (abs(np.ptp(axes.get_ylim())) / unit) / (box.width / np.ptp(axes.get_xlim()))
    assert f"(depth scaled by {drawn:.3g})" in axes.get_xlabel() or (times is None and abs(drawn - 1) < 0.02)
    assert times or axes.get_ylabel().endswith("[mm]")


@pytest.mark.parametrize(("height", "same"), [(1.0, True), (0.6, True), (0.05, False)])
def test_sections_along_both_axes_have_the_same_scale(height, same):
    first, second = draw(0.5, height)
    assert (
        first.get_ylim() == second.get_ylim()
        and first.collections[0].get_clim() == second.collections[0].get_clim()
    )
    assert (np.ptp(first.get_xlim()) == pytest.approx(np.ptp(second.get_xlim()))) == same


def test_summary_shows_the_stress_below_if_poissons_ratio_is_known(result):
    known = with_attributes(result, poisson_ratio=0.3)
    below = figures.summary_figure(known).axes[3]
    assert below.get_ylabel().startswith("depth") and "ν = 0.3" in below.get_xlabel()
    assert np.ptp(below.get_xlim()) == pytest.approx(abs(np.ptp(below.get_ylim())) / stress.PANEL_SHAPE)
    infinite = np.where(result.pressure == result.pressure.max(), np.inf, result.pressure)
    for other in (replace(known, pressure=infinite), with_attributes(result, poisson_ratio=None)):
        assert not any(axes.get_ylabel().startswith("depth") for axes in figures.summary_figure(other).axes)


@pytest.mark.parametrize("poisson", [0.2, 0.499])
def test_a_layer_with_much_smaller_stresses_than_its_base_has_its_own_colours(poisson):
    """Under a wide pressure a nearly incompressible layer has hardly any von Mises stress."""
    grid = Grid.from_domain(32, 32, (-2, 2, -2, 2))
    pressure = np.exp(-(grid.x() ** 2) - grid.y()[:, None] ** 2)
    layer = Material.coated((25.0, 210e3), (poisson, 0.3), 0.2).coatings[0]
    stresses = api_survey(LayeredStress(pressure, grid, layer))
    figure = stress.stress_figure(grid, stresses, "")
    drawn = figure.axes[0].collections
    mises = von_mises(stresses.section_x), von_mises(stresses.section_y)
    above = stresses.depths <= stresses.interface
    layer, base = (max(field[part].max() for field in mises) for part in (above, ~above))
    ends = [max(layer, base)] if poisson < 0.4 else [layer, base]
    assert [part.get_clim()[1] for part in drawn] == pytest.approx(ends)
    assert len(figure.axes[0].child_axes) == len(ends)


def thin_coating():
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    x, y = grid.x()[None, :], grid.y()[:, None]
    layer = Material.coated((3e5, 2e5), (0.2, 0.3), "2 um").coatings[0]
    below = LayeredStress(np.sqrt(np.maximum(0.5 - x**2 - y**2, 0)), grid, layer)
    return stress.stress_figure(grid, api_survey(below), "")


def test_a_thin_coating_has_a_panel_of_its_own():
    (panel,) = (axes for axes in thin_coating().axes if axes.get_title() == "in the coating")
    assert panel.get_ylim() == pytest.approx((2.0, 0)) and panel.get_ylabel() == "depth z  [µm]"
    assert all(len(line.get_xdata()) >= 5 for line in panel.lines if line.get_label()[0] != "_")


def test_curves_of_a_panel_have_different_dashes():
    for axes in thin_coating().axes:
        curves = [line for line in axes.lines if line.get_label()[0] != "_"]
        assert len({line._unscaled_dash_pattern for line in curves if line._unscaled_dash_pattern}) == len(
            curves
        )
