"""Sections, histories and titles of results."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from results import made_up_result, with_attributes

from app.halfspace.grid import Grid
from app.plots import figures
from app.plots.pictures import analytic_reference


def test_sections_show_computed_and_exact_pressure(result):
    figure = figures.section_figure(result, analytic_reference(result))
    row, column = 47, 63  # first of the four equal cells around the origin
    for axes, values in zip(figure.axes, (result.pressure[row], result.pressure[:, column]), strict=True):
        assert np.array_equal(axes.patches[-1].get_data().values, values)
        s, exact = axes.lines[0].get_data()
        centres, along = (result.x, True) if axes is figure.axes[0] else (result.y, False)
        assert np.ptp(s) < np.ptp(centres)  # zoomed to the contact
        inside = (centres > s[0]) & (centres < s[-1]) & (values > 400)
        assert np.interp(centres[inside], s, exact) == pytest.approx(values[inside], rel=2e-3), along


@pytest.mark.parametrize(
    "carries", [lambda x, y: 5.0 + 0 * x * y, lambda x, y: np.maximum(9 - x**2, 0) + 0 * y]
)
def test_sections_go_through_the_middle_of_the_most_loaded_cells(result, carries):
    x, y = result.x[None, :], result.y[:, None]
    noise = 1 + 1e-7 * np.random.default_rng(6).random((y.size, x.size))
    row, column = figures.section_place(replace(result, pressure=carries(x, y) * noise))
    assert abs(result.y[row]) < result.grid.dy and abs(result.x[column]) < result.grid.dx
    apart = np.where(np.abs(x) > 5, 1.0, 0.0) + 0 * y
    row, column = figures.section_place(replace(result, pressure=apart))
    assert apart[row, column] == 1


def test_sections_have_no_gap_in_contact(result):
    noisy = replace(result, gap=np.where(result.contact == 1, 1e-9, result.gap))
    drawn = [axes for axes in figures.section_figure(noisy).axes if "gap" in axes.get_ylabel()]
    row, column = figures.section_place(result)
    for axes, here in zip(drawn, ((row, slice(None)), (slice(None), column)), strict=True):
        contact, values = result.contact[here] == 1, axes.patches[0].get_data().values
        assert contact.any() and not values[contact].any()
        assert values == pytest.approx(result.gap[here] * values.max() / result.gap[here].max())
    full = replace(result, gap=np.full_like(result.gap, 1e-9), contact=np.ones_like(result.contact))
    assert len(figures.section_figure(full).axes) == 2


def test_sections_without_load_have_no_analytic_pressure_and_no_scale(result):
    """A load of 0 ends at an approach above 0, the cell in the middle not being at the very tip."""
    unloaded = with_attributes(result, load=0.0, without=["analytic_approach"])
    unloaded = replace(unloaded, pressure=np.zeros_like(result.pressure))
    reference = analytic_reference(unloaded)
    assert reference is None
    for axes in figures.section_figure(unloaded, reference).axes[:2]:
        assert "pressure" in axes.get_ylabel() and list(axes.get_yticks()) == [0]


def names(result):
    """Of the grids above a history."""
    above = figures.history_figure(result).axes[0].child_axes
    return [label.get_text() for axes in above for label in axes.get_xticklabels()]


def test_history_names_the_grids_of_a_nested_iteration(result):
    assert names(result) == ["16 × 12", "32 × 24", "64 × 48", "128 × 96"]
    downwards = replace(result, history=result.history | {"level": 3 - result.history["level"]})
    assert names(downwards) == names(result)
    by_option = replace(result, attributes=result.attributes | {"options": "-lcp_coarsest 50"})
    assert names(by_option)[1:] == ["32 × 48", "64 × 48", "128 × 96"]
    assert names(replace(result, history={k: v[-6:] for k, v in result.history.items()})) == []


def test_titles_and_labels_have_problem_grid_load_and_units(result):
    load = f"load {result.attributes['load'] / 1e3:.4g} kN"
    for figure in (
        figures.pressure_figure(result),
        figures.section_figure(result),
        figures.deformation_figure(result),
    ):
        heading = figure._suptitle.get_text()
        assert "Hertz" in heading and "128 × 96" in heading and load in heading
        for axes in figure.axes:
            titles = [axes.get_title()] if axes.images else []
            assert all("mm" in label or "µm" in label for label in [axes.get_ylabel(), *titles])
    assert "NOT CONVERGED" in figures.make_title(with_attributes(result, converged=False))
    steps = {"load": np.array([1.0, 2.0]), "mean_pressure": np.array([10.0, 20.0])}
    words = "-load_path 1,2 -mean_pressure_path 10,20"
    ends = {"": "2 steps, load from 1 to 2 N", words: "2 steps, mean pressure from 10 to 20 N/mm²"}
    for words, said in ends.items():
        path = replace(with_attributes(result, command_line=words), path=steps)
        assert said in figures.make_title(path, path=True)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({}, "Sphere, "),
        ({"surfaces": 1}, "Sphere with a rough surface, "),
        ({"surfaces": 1, "surface_file": "maps/plate.h5:/heights"}, "Sphere with plate.h5, "),
        ({"surfaces": 2, "surface_file": "a.txt", "surface_file2": "b.txt"}, "Sphere with a.txt and b.txt, "),
        ({"surfaces": 1, "problem": "rough"}, "Rough surface, "),
        ({"surfaces": 1, "problem": "rough", "surface_file": "a.txt"}, "Rough surface a.txt, "),
    ],
)
def test_titles_name_rough_surfaces(result, facts, said):
    assert figures.make_title(with_attributes(result, **{"problem": "sphere"} | facts)).startswith(said)


@pytest.mark.filterwarnings("error")
def test_huge_residuals_are_not_drawn(result):
    residual = np.geomspace(1e-6, 1e300, len(result.history["level"]))
    figure = figures.history_figure(replace(result, history=result.history | {"residual": residual}))
    figure.canvas.draw()
    axes = figure.axes[0]
    drawn = np.concatenate([line.get_ydata() for line in axes.lines if line.get_label() != "tolerance"])
    assert np.array_equal(drawn[np.isfinite(drawn)], residual[residual < 1e200])


def test_residuals_far_below_the_tolerance_are_marked(result):
    residual = result.history["residual"].copy()
    residual[[1, 3, 4]] = 1e-17, 3e-14, 0
    axes = figures.history_figure(replace(result, history=result.history | {"residual": residual})).axes[0]
    marked = next(line for line in axes.lines if line.get_label().startswith("lower"))
    assert list(marked.get_xdata()) == [2, 4, 5] and (marked.get_ydata() == 1e-9).all()
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    assert np.nanmin(drawn) > axes.get_ylim()[0]
    assert "lower" not in str([line.get_label() for line in figures.history_figure(result).axes[0].lines])


def test_levels_below_the_coarsest_grid_have_its_name():
    result = made_up_result(32, 24)
    level = result.history["level"].copy()
    level[0] = -(10**15)
    beyond = replace(result, history=result.history | {"level": level})
    assert names(beyond) == ["4 × 3", *names(result)]


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.4, -0.3)])
def test_sections_cross_a_ring_and_do_not_follow_its_rim(centre):
    grid = Grid.from_domain(64, 64, (-2, 2, -2, 2))
    x, y = grid.x()[None, :] - centre[0], grid.y()[:, None] - centre[1]
    hot = 1 + 0.01 * np.sin(2 + np.arctan2(y, x))  # one cell is the hottest
    pressure = 9 * np.maximum(1 - ((np.hypot(x, y) - 1.2) / 0.15) ** 2, 0) * hot
    row, column = figures.section_place(SimpleNamespace(pressure=pressure))
    for line in (pressure[row], pressure[:, column]):
        assert line.max() >= 0.9 * pressure.max()
        apart = np.count_nonzero(np.diff((line > 0).astype(int)) == 1)
        assert apart == 2 and np.count_nonzero(line) < 12  # two short pieces
