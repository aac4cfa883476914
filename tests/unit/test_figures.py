"""Pictures: what they show is what the result says."""

from dataclasses import replace

import numpy as np
import pytest
from results import made_up_result, with_attributes

from app.output import figures
from app.plot import analytic_reference


@pytest.fixture(scope="module")
def result():
    return made_up_result()


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_the_same_result_gives_the_same_bytes(result, tmp_path, kind):
    for name in ("a", "b"):
        figures.save_figure(figures.history_figure(result), tmp_path / f"{name}.{kind}", dpi=40)
    assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


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
    at = figures.section_figure(result, at=(2.05, -3.0)).axes
    nearest_y = result.y[np.argmin(abs(result.y + 3.0))]
    assert f"{nearest_y:.3g}".replace("-", "−") in at[0].get_xlabel()


def image_values(figure):
    """The topmost image of the first axes, and the coordinates of its pixel centres."""
    image = figure.axes[0].images[-1]
    values = np.ma.masked_invalid(image.get_array())
    x0, x1, y0, y1 = image.get_extent()
    ny, nx = values.shape
    assert image.origin == "lower"
    return values, x0 + (np.arange(nx) + 0.5) * (x1 - x0) / nx, y0 + (np.arange(ny) + 0.5) * (y1 - y0) / ny


def test_pressure_map_has_no_colour_where_there_is_no_pressure(result):
    values, x, y = image_values(figures.pressure_figure(result))
    assert np.array_equal(np.ma.getmaskarray(values), result.pressure == 0)
    assert np.array_equal(values.compressed(), result.pressure[result.pressure > 0])
    assert x == pytest.approx(result.x) and y == pytest.approx(result.y)


def test_a_single_loaded_cell_is_drawn_in_its_place_also_on_a_coarser_image(result, monkeypatch):
    monkeypatch.setattr(figures, "MOST_PIXELS", 50)  # 128 x 96 cells on 43 x 32 pixels
    pressure = np.zeros_like(result.pressure)
    pressure[90, 17] = 1.0
    values, x, y = image_values(figures.pressure_figure(replace(result, pressure=pressure)))
    (row,), (column,) = np.nonzero(values.filled(0))
    assert values.shape == (32, 43)
    assert abs(x[column] - result.x[17]) <= 20 / 128 and abs(y[row] - result.y[90]) <= 12 / 96
    assert values[row, column] == pytest.approx(1 / 9)


def test_block_mean_keeps_means_and_skips_nan():
    field = np.random.default_rng(5).random((12, 20))
    mean, b = figures.block_mean(field, 5)
    assert (mean.shape, b) == ((3, 5), 4)
    assert mean == pytest.approx(field.reshape(3, 4, 5, 4).mean(axis=(1, 3)))
    assert figures.block_mean(field, 20) == (field, 1)
    assert figures.block_mean(np.ones((7, 10)), 4)[0] == pytest.approx(np.ones((3, 4)))
    field[:4, :4] = np.nan
    field[4, 4] = np.nan
    mean, _ = figures.block_mean(field, 5)
    assert np.isnan(mean[0, 0]) and np.isfinite(mean).sum() == 14
    assert mean[1, 1] == pytest.approx(np.nanmean(field[4:8, 4:8]))


def test_history_names_the_grids_of_a_nested_iteration(result):
    def names(r):
        return [
            label.get_text()
            for axes in figures.history_figure(r).axes[0].child_axes
            for label in axes.get_xticklabels()
        ]

    assert names(result) == ["16 × 12", "32 × 24", "64 × 48", "128 × 96"]
    downwards = replace(result, history=result.history | {"level": 3 - result.history["level"]})
    assert names(downwards) == names(result)
    assert names(replace(result, history={k: v[-6:] for k, v in result.history.items()})) == []


def test_titles_and_labels_say_what_and_in_which_unit(result):
    load = f"load {result.attributes['load']:.0f} N"
    for figure in (
        figures.pressure_figure(result),
        figures.section_figure(result),
        figures.deformation_figure(result),
    ):
        heading = figure._suptitle.get_text()
        assert "Hertz" in heading and "128 × 96" in heading and load in heading
        for axes in figure.axes:
            assert "[mm]" in axes.get_xlabel()
            bars = [child.get_ylabel() for child in axes.child_axes]
            assert all("mm" in label for label in [axes.get_ylabel(), *bars])
    assert "NOT CONVERGED" in figures.title(with_attributes(result, converged=False))
