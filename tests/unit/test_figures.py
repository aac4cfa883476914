"""Pictures: what they show is what the result says."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Rectangle
from results import made_up_result, with_attributes

from app.base.errors import InputError
from app.base.units import choose_length_unit
from app.cli.plot import analytic_reference
from app.cli.problem_options import PROBLEM_OPTIONS
from app.halfspace.connected_sets import label_connected_sets
from app.halfspace.grid import Grid
from app.halfspace.stress.subsurface import StressMaximum
from app.plots import curves, figures, heights, load_curves, maps, style, sweeps
from app.problems.surfaces.reading import read_surface
from app.reference.rough import persson_fraction


@pytest.fixture(scope="module")
def result():
    return made_up_result()


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_the_same_result_gives_the_same_bytes(result, tmp_path, kind):
    for name in ("a", "b"):
        style.save_figure(figures.history_figure(result), tmp_path / f"{name}.{kind}", dpi=40)
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


@pytest.mark.parametrize(
    "carries", [lambda x, y: 5.0 + 0 * x * y, lambda x, y: np.maximum(9 - x**2, 0) + 0 * y]
)
def test_sections_go_through_the_middle_of_what_carries_most_whatever_rounding_says(result, carries):
    x, y = result.x[None, :], result.y[:, None]
    noise = 1 + 1e-7 * np.random.default_rng(6).random((y.size, x.size))
    row, column = figures.hottest_cell(replace(result, pressure=carries(x, y) * noise))
    assert abs(result.y[row]) < result.grid.dy and abs(result.x[column]) < result.grid.dx
    apart = np.where(np.abs(x) > 5, 1.0, 0.0) + 0 * y
    row, column = figures.hottest_cell(replace(result, pressure=apart))
    assert apart[row, column] == 1


def image_values(figure):
    """The topmost image of the first axes, and the coordinates of its pixel centres."""
    image = figure.axes[0].images[-1]
    values = np.ma.masked_invalid(image.get_array())
    x0, x1, y0, y1 = image.get_extent()
    ny, nx = values.shape
    assert image.origin == "lower"
    return values, x0 + (np.arange(nx) + 0.5) * (x1 - x0) / nx, y0 + (np.arange(ny) + 0.5) * (y1 - y0) / ny


def test_sections_have_no_gap_in_contact(result):
    noisy = replace(result, gap=np.where(result.contact == 1, 1e-9, result.gap))
    drawn = [axes for axes in figures.section_figure(noisy).axes if "gap" in axes.get_ylabel()]
    row, column = figures.hottest_cell(result)
    for axes, here in zip(drawn, ((row, slice(None)), (slice(None), column)), strict=True):
        contact, values = result.contact[here] == 1, axes.patches[0].get_data().values
        assert contact.any() and not values[contact].any()
        assert values == pytest.approx(result.gap[here] * values.max() / result.gap[here].max())
    full = replace(result, gap=np.full_like(result.gap, 1e-9), contact=np.ones_like(result.contact))
    assert len(figures.section_figure(full).axes) == 2


def test_sections_without_load_have_neither_an_analytic_pressure_nor_a_scale(result):
    """A load of 0 ends at an approach above 0, the cell in the middle not being at the very tip."""
    unloaded = replace(with_attributes(result, load=0.0), pressure=np.zeros_like(result.pressure))
    reference = analytic_reference(unloaded)
    assert reference is None
    for axes in figures.section_figure(unloaded, reference).axes[:2]:
        assert "pressure" in axes.get_ylabel() and list(axes.get_yticks()) == [0]


def test_pressure_map_has_no_colour_where_there_is_no_pressure(result):
    values, x, y = image_values(figures.pressure_figure(result))
    assert np.array_equal(np.ma.getmaskarray(values), result.pressure == 0)
    assert np.array_equal(values.compressed(), result.pressure[result.pressure > 0])
    assert x == pytest.approx(result.x) and y == pytest.approx(result.y)


def test_a_single_loaded_cell_is_drawn_in_its_place_also_on_a_coarser_image(result, monkeypatch):
    monkeypatch.setattr(maps, "MAX_PIXELS", 50)  # 128 x 96 cells on 43 x 32 pixels
    pressure = np.zeros_like(result.pressure)
    pressure[90, 17] = 1.0
    values, x, y = image_values(figures.pressure_figure(replace(result, pressure=pressure)))
    (row,), (column,) = np.nonzero(values.filled(0))
    assert values.shape == (32, 43)
    assert abs(x[column] - result.x[17]) <= 20 / 128 and abs(y[row] - result.y[90]) <= 12 / 96
    assert values[row, column] == pytest.approx(1 / 9)


def test_block_mean_keeps_means_and_skips_nan():
    field = np.random.default_rng(5).random((12, 20))
    mean, b = maps.block_mean(field, 5)
    assert (mean.shape, b) == ((3, 5), 4)
    assert mean == pytest.approx(field.reshape(3, 4, 5, 4).mean(axis=(1, 3)))
    assert maps.block_mean(field, 20) == (field, 1)
    assert maps.block_mean(np.ones((7, 10)), 4)[0] == pytest.approx(np.ones((3, 4)))
    field[:4, :4] = np.nan
    field[4, 4] = np.nan
    mean, _ = maps.block_mean(field, 5)
    assert np.isnan(mean[0, 0]) and np.isfinite(mean).sum() == 14
    assert mean[1, 1] == pytest.approx(np.nanmean(field[4:8, 4:8]))


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
            bars = [child.get_ylabel() for child in axes.child_axes]
            assert all("mm" in label or "µm" in label for label in [axes.get_ylabel(), *bars])
    assert "NOT CONVERGED" in figures.make_title(with_attributes(result, converged=False))
    steps = {"load": np.array([1.0, 2.0]), "mean_pressure": np.array([10.0, 20.0])}
    words = "-load_path 1,2 -mean_pressure_path 10,20"
    ends = {"": "2 loads from 1 to 2 N", words: "2 mean pressures from 10 to 20 N/mm²"}
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
def test_titles_name_what_is_rough(result, facts, said):
    assert figures.make_title(with_attributes(result, **{"problem": "sphere"} | facts)).startswith(said)


@pytest.mark.parametrize(
    "largest, per_mm, name", [(2.0, 1.0, "mm"), (0.1, 1e3, "µm"), (1e-5, 1e6, "nm"), (5e4, 1e-3, "m")]
)
def test_lengths_stand_in_a_unit_that_suits_them(largest, per_mm, name):
    assert choose_length_unit(largest) == (per_mm, name)


def test_map_of_a_small_patch_is_in_its_unit(result):
    small = replace(result, x=result.x * 1e-6, y=result.y * 1e-6)
    axes = figures.pressure_figure(small).axes[0]
    assert axes.get_xlabel() == "x  [nm]"
    assert axes.get_xlim() == pytest.approx((-10, 10))


def overlaps(labels, renderer):
    """Whether texts that follow each other touch."""
    boxes = [label.get_window_extent(renderer) for label in labels if label.get_text()]
    return any(a.overlaps(b) for a, b in pairwise(boxes))


@pytest.mark.parametrize(
    "nx, ny, width, height", [(200, 8, 40.0, 0.6), (8, 200, 0.6, 40.0), (1, 64, 1.0, 1.0)]
)
def test_narrow_patches_are_readable(nx, ny, width, height):
    grid = Grid.from_domain(nx, ny, (0, width, 0, height))
    made = made_up_result(nx, ny)
    figure = figures.pressure_figure(replace(made, x=grid.x(), y=grid.y()))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes = figure.axes[0]
    bar = axes.child_axes[0]
    box = bar.get_window_extent()
    for ruler in (axes.xaxis, axes.yaxis, bar.yaxis if box.height > box.width else bar.xaxis):
        assert not overlaps(ruler.get_ticklabels(), canvas.get_renderer())
    assert min(box.width, box.height) > 0.1 * figure.dpi  # of the colour bar: not a hair
    assert len(axes.get_xticks()) >= 2 and len(axes.get_yticks()) >= 2
    assert ("scale" in axes.get_xlabel()) == (max(width, height) > 10)


@pytest.mark.parametrize("values", [[3.0, 3.1], [1.0], [0.9, 4.0], [1e-9, 1e5], [1.1, 95.0], [0.2, 40.0]])
def test_a_logarithmic_axis_has_two_numbers_at_least_which_do_not_touch(values):
    axes = style.new_figure(4, 3).subplots()
    axes.plot(values, values, "o")
    style.set_log_axes(axes)
    low, high = axes.get_xlim()
    FigureCanvasAgg(axes.figure).draw()
    told = set()
    for minor in (False, True):
        labels = zip(axes.get_xticks(minor=minor), axes.get_xticklabels(minor=minor), strict=True)
        told |= {tick for tick, label in labels if label.get_text() and low <= tick <= high}
    assert len(told) >= 2
    assert not overlaps(axes.get_xticklabels(), axes.figure.canvas.get_renderer())


def test_distribution_of_values_that_differ_little_fills_its_panel(result):
    """As of pressures near full contact."""
    pressure = np.where(result.pressure > 0, 1000 + result.pressure / 1e3, 0.0)
    axes = curves.distribution_figure(replace(result, pressure=pressure)).axes[0]
    low, high = axes.get_xlim()
    assert np.ptp(axes.lines[0].get_xdata()) > 0.8 * (high - low)


def test_numbers_below_the_load_of_a_path_do_not_touch():
    columns = {"load": np.zeros(3), "approach": np.array([-0.1, -0.2, -0.3])}
    figure = load_curves.path_figure([load_curves.Path(columns | {"indentation": columns["approach"]})])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert not overlaps(figure.axes[0].get_xticklabels(), canvas.get_renderer())


@pytest.mark.parametrize("width", [0.6, 1e-4])
def test_label_of_a_narrow_map_is_not_cut_off(width):
    grid = Grid.from_domain(8, 200, (0, width, 0, 40))
    figure = figures.contact_figure(replace(made_up_result(8, 200), x=grid.x(), y=grid.y()))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes = figure.axes[0]
    assert "the scale of y" in axes.get_xlabel().replace("\n", " ")
    label = axes.xaxis.label.get_window_extent(canvas.get_renderer())
    kept = axes.get_tightbbox(canvas.get_renderer())
    assert kept.x0 <= label.x0 and label.x1 <= kept.x1


def test_twelve_lines_are_all_different():
    drawn = [{name: str(value) for name, value in style.series_style(number).items()} for number in range(12)]
    assert all(one != other for k, one in enumerate(drawn) for other in drawn[:k])


def test_theories_stand_beside_the_path_of_a_file_as_beside_its_table(result):
    """Where Persson's fractions are known, whatever the problem is called; they tell E* h'rms."""
    columns = {"mean_pressure": np.array([3.0, 300.0, 3e5]), "contact_fraction": np.array([0.1, 0.5, 1.0])}
    columns |= {"load": columns["mean_pressure"], "approach": np.array([1.0, 2.0, 3.0])}
    persson = {"persson_fraction": persson_fraction(columns["mean_pressure"] / 5000)}
    known = with_attributes(
        result, problem="given", contact_modulus=1e5, rms_slope=0.02
    )  # as of a ball, a function
    for flat in (True, False):
        found = columns | persson if flat else columns
        table = {name: list(map(repr, map(float, column))) for name, column in found.items()}
        for path in (load_curves.get_path(replace(known, path=found)), load_curves.get_csv_path(table)):
            assert path.scale == pytest.approx(5000 if flat else np.nan, rel=1e-12, nan_ok=True)
            assert ("κ" in load_curves.path_figure([path]).axes[1].get_ylabel()) == flat


def test_patches_are_told_apart_across_the_sides_of_a_periodic_patch():
    contact = np.zeros((6, 8), bool)
    contact[0, 0] = contact[5, 0] = contact[0, 7] = True  # one at the corner
    contact[2, 2] = contact[3, 3] = True  # by a corner only: two
    _, cells = label_connected_sets(contact)
    assert sorted(cells) == [1] * 5
    labels, cells = label_connected_sets(contact, periodic=True)
    assert sorted(cells) == [1, 1, 3] and labels[0, 0] == labels[5, 0] == labels[0, 7] > 0
    assert not labels[~contact].any()


def test_the_legend_of_contact_says_what_colours_and_white_mean(result):
    contact = np.zeros_like(result.contact)
    contact[::8, ::8] = 1
    for pattern, colours, text in (
        (contact, 10, "192 patches in 10 colours"),
        (contact * (np.arange(contact.size) < 20).reshape(contact.shape), 3, "3 patches in 3 colours"),
        (result.contact, 1, "cells"),
    ):
        axes = figures.contact_figure(replace(result, contact=pattern)).axes[0]
        told, none = axes.get_legend().get_texts()
        assert told.get_text().endswith(text) and none.get_text() == "no contact"
        shown = {patch.get_facecolor() for patch in axes.get_legend().findobj(Rectangle)}
        assert len(shown) == colours + 1 and (1, 1, 1, 1) in shown
        pixels = axes.images[-1].get_array()
        assert {tuple(colour) for colour in pixels[pixels[..., 3] > 0]} == shown - {(1, 1, 1, 1)}


def test_the_legend_of_contact_names_no_colour_that_is_not_there():
    texts = figures.contact_figure(made_up_result(punch_radius=3.0)).axes[0].get_legend().get_texts()
    assert [text.get_text() for text in texts] == ["contact: 100% of 1448 cells", "no contact possible"]


def test_sizes_of_patches_have_a_panel_where_there_are_several(result):
    labels = [axes.get_xlabel() for axes in curves.distribution_figure(result).axes]
    assert len(labels) == 2 and "pressure" in labels[0] and "gap" in labels[1]


def test_distributions_add_up_to_one():
    rng = np.random.default_rng(2)
    made = made_up_result(64, 48)
    pressure = np.where(rng.random((48, 64)) < 0.5, rng.exponential(100.0, (48, 64)), 0.0)
    figure = curves.distribution_figure(
        replace(made, pressure=pressure, contact=(pressure > 0).astype(np.uint8))
    )
    p, density = figure.axes[0].lines[0].get_data()
    assert np.sum((density[1:] + density[:-1]) / 2 * np.diff(p)) == pytest.approx(1, abs=0.03)
    assert np.median(density[p < 20]) == pytest.approx(1 / 100, rel=0.3)  # exponential: level at small values
    area, patches = figure.axes[2].lines[0].get_data()
    assert patches[-1] >= 1 and (np.diff(patches) < 0).all() and (np.diff(area) > 0).all()


def test_spectrum_of_a_wave_is_a_peak_in_its_place():
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
def test_all_that_is_drawn_of_a_spectrum_is_within_its_axes(rolloff, cutoff):
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


def _wavy():
    """A wave of 16 cells in x on a tilted plane [um]."""
    return np.cos(2 * np.pi * np.arange(64) / 16) + 0.5 * np.arange(48.0)[:, None]


def _panels(z, spacing=(0.001, 0.001)):
    figure = heights.surface_figure(read_surface(z, unit="um", level="plane", spacing=spacing))
    figure.draw_without_rendering()
    return figure, dict(zip(("map", "x", "y", "heights", "spectrum"), figure.axes, strict=False))


def test_a_measured_surface_is_drawn_about_its_plane_with_its_numbers():
    figure, panels = _panels(_wavy())
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


def test_missing_points_are_grey_gaps_and_have_no_spectrum():
    z = _wavy()
    z[20:28, 5:9] = np.nan
    figure, panels = _panels(z)
    assert "32 missing" in figure._suptitle.get_text()
    missing = np.isnan(z)
    grey = np.ma.masked_invalid(figure.axes[0].images[0].get_array())
    assert np.array_equal(~np.ma.getmaskarray(grey), missing)
    assert np.array_equal(np.ma.getmaskarray(image_values(figure)[0]), missing)
    assert np.array_equal(np.isnan(panels["x"].lines[0].get_ydata()), missing[24])
    assert not panels["spectrum"].lines and "points are missing" in panels["spectrum"].texts[0].get_text()


def test_a_spike_leaves_the_rest_of_a_surface_its_colours():
    z = _wavy()
    z[10, 10] += 1000
    figure, panels = _panels(z)
    image = figure.axes[0].images[-1]
    assert image.norm.vmax < 100 < 900 < image.get_array().max()  # [um]
    assert panels["heights"].get_xlim()[1] < 100
    assert image.colorbar.extend == "max"


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (5, 6), (60, 4), (4, 60), (16, 16)])
@pytest.mark.parametrize("value", [0.0, 2.0])
def test_small_and_flat_surfaces_are_drawn(shape, value):
    figure, panels = _panels(np.full(shape, value))
    assert panels["spectrum"].texts and figure.axes[0].images
    _panels(np.random.default_rng(1).normal(size=shape))


def test_numbers_below_a_narrow_map_do_not_touch():
    figure, panels = _panels(np.random.default_rng(1).normal(size=(192, 30)), (0.0025, 0.005))
    axes = panels["map"]
    boxes = [text.get_window_extent() for text in axes.get_xticklabels() if text.get_text()]
    left, right = axes.get_window_extent().intervalx
    shown = sorted((box.x0, box.x1) for box in boxes if left < (box.x0 + box.x1) / 2 < right)
    assert len(shown) > 1 and all(one[1] < other[0] for one, other in pairwise(shown))


@pytest.mark.parametrize("problem", ["hertz", "sphere", "cylinder", "cone", "punch"])
def test_a_smooth_body_has_no_spectrum_but_a_surface_on_it_has(result, problem):
    assert curves.spectrum_figure(result) is None
    kink = replace(result, undeformed_distance=np.hypot(*np.meshgrid(result.x, result.y)))
    for periodic_symbol in ("", "spectral"):
        body = with_attributes(kink, problem=problem, periodic_symbol=periodic_symbol)
        assert curves.spectrum_figure(body) is None
        assert curves.spectrum_figure(with_attributes(body, surfaces=1)) is not None


def test_path_of_a_rough_surface_stands_beside_the_theories():
    p = np.geomspace(10, 1e4, 7)
    columns = {"load": p, "mean_pressure": p, "contact_fraction": np.minimum(2.2e-4 * p, 0.99)}
    figure = load_curves.path_figure([load_curves.Path(columns, "", scale=1e4)])
    fraction, kappa, *others = figure.axes
    computed, persson, bgt = fraction.lines[:3]
    assert computed.get_xdata() == pytest.approx(p / 1e4)
    assert persson.get_ydata()[0] / persson.get_xdata()[0] == pytest.approx(np.sqrt(8 / np.pi), rel=1e-3)
    assert bgt.get_ydata()[0] / bgt.get_xdata()[0] == pytest.approx(np.sqrt(2 * np.pi))
    assert kappa.lines[0].get_ydata()[:5] == pytest.approx(2.2)
    assert [axes.texts[0].get_text() for axes in others] == ["no mean gap", "no stiffness"]


def test_each_path_shows_its_exact_stiffness_whatever_the_others_know():
    p = np.geomspace(1, 100, 5)
    known = {"load": p, "approach": p, "mean_pressure": p, "contact_fraction": 1e-3 * p}
    exact = load_curves.Path(known | {"stiffness": 2 * p, "stiffness_by_differences": p}, "exact")
    other = load_curves.Path(known | {"stiffness_by_differences": 3 * p}, "other")
    for scale in (1e4, np.nan):
        drawn = load_curves.path_figure([one._replace(scale=scale) for one in (exact, other)]).axes[3]
        assert drawn.lines[0].get_ydata() == pytest.approx(2 * p)
        assert drawn.lines[1].get_ydata() == pytest.approx(3 * p)
        assert drawn.get_ylabel().endswith("by differences: other")
    alone = load_curves.path_figure([other]).axes[3]
    assert alone.get_ylabel().endswith("\nby differences") and alone.lines[0].get_ydata() == pytest.approx(
        3 * p
    )
    assert "differences" not in load_curves.path_figure([exact]).axes[3].get_ylabel()


def test_corrected_fractions_are_within_the_picture():
    p = np.geomspace(1, 100, 5)
    columns = {"load": p, "mean_pressure": p, "contact_fraction": 1e-4 * p}
    columns["contact_fraction_corrected"] = columns["contact_fraction"] / 5
    fraction = load_curves.path_figure([load_curves.Path(columns, "", scale=1e4)]).axes[0]
    assert fraction.get_ylim()[0] < columns["contact_fraction_corrected"].min()


@pytest.mark.parametrize(("deepest", "times"), [(1.3, None), (0.1, 12), (10, 0.14)])
def test_a_section_below_says_when_depth_has_another_scale(deepest, times):
    grid, z = Grid.from_domain(200, 1, (-1, 1, 0, 1)), np.linspace(0, deepest, 21)
    section = np.zeros((6, 21, 200))
    section[2] = -np.exp(-((z[:, None] - deepest / 2) ** 2)) * np.exp(-(grid.x() ** 2))
    hottest = StressMaximum(1.0, 0.0, 0.0, deepest / 2, np.zeros(6))
    figure = curves.stress_figure("x", grid, z, section, section[:, :, 100], hottest, "")
    figure.canvas.draw()
    axes = figure.axes[0]
    box = axes.get_window_extent()
    unit = 1e3 if "µm" in axes.get_ylabel() else 1
    drawn = box.height / (abs(np.ptp(axes.get_ylim())) / unit) / (box.width / np.ptp(axes.get_xlim()))
    assert drawn == pytest.approx(times or 1, rel=1e-3)
    assert axes.get_xlabel() == "x  [mm]" + (f"   (z: {times} × the scale of x)" if times else "")
    assert times or axes.get_ylabel().endswith("[mm]")


def test_stress_below_a_single_column_has_its_width_and_the_legend_touches_no_curve():
    z, section = np.linspace(0, 1, 21), np.zeros((6, 21, 1))
    section[2, :, 0] = -1
    hottest = StressMaximum(26395.0, 3.0, 0.0, 0.5, np.zeros(6))
    grid = Grid.from_domain(1, 1, (2, 4, 0, 1))
    figure = curves.stress_figure("x", grid, z, section, section[:, :, 0], hottest, "")
    left, right = figure.axes[:2]
    assert left.get_xlim() == pytest.approx((2, 4)) and left.get_ylim() == (1, 0)
    assert left.get_legend().get_texts()[0].get_text().startswith("26395 N/mm²")
    figure.canvas.draw()
    assert right.get_legend().get_window_extent().x0 >= right.bbox.x1


def _rough_path(**shares):
    """Path of eight mean pressures, in contact on 2.2e-4 of them; `shares`: other columns in proportion."""
    p = np.geomspace(1, 3000, 8)
    shares = {"load": 1, "mean_pressure": 1, "contact_fraction": 2.2e-4} | shares
    return load_curves.Path({name: share * p for name, share in shares.items()}, "", scale=1e4)


@pytest.mark.parametrize("patches", [2, 3, 4, 7, 60])
def test_numbers_of_patches_are_whole(result, patches):
    contact = np.zeros_like(result.contact)
    for k in range(patches):
        row, column = divmod(k, 12)
        contact[8 * row : 8 * row + 1 + k % 2, 8 * column] = 1
    drawn = curves.distribution_figure(replace(result, contact=contact)).axes[2]
    drawn.figure.canvas.draw()
    low, high = drawn.get_ylim()
    ticks = [tick for tick in drawn.get_yticks() if low <= tick <= high]
    assert ticks and all(tick == round(tick) for tick in ticks) and high < 1.5 * patches
    assert any(text.get_text() for text in drawn.get_yticklabels())


def test_against_an_option_a_line_of_a_sweep_of_paths_is_of_one_step():
    """Loads of one path stand above each other there; no line goes up and down between them."""
    seeds, steps = ["1", "1", "2", "2", "3", "3"], ["1", "2"] * 3
    columns = {"seed": seeds, "exit_status": ["0"] * 6, "step": steps, "load": ["5", "50"] * 3}
    columns |= {"max_pressure": ["20", "60", "30", "70", "40", "80"]}
    (axes,) = sweeps.sweep_figure(columns, x="seed", y=["max_pressure"]).axes
    assert [line.get_ydata().tolist() for line in axes.lines] == [[20, 30, 40], [60, 70, 80]]
    (axes,) = sweeps.sweep_figure(columns, y=["max_pressure"]).axes
    assert [line.get_ydata().tolist() for line in axes.lines] == [[20, 60], [30, 70], [40, 80]]


@pytest.mark.parametrize(("fall", "times"), [(0.0, 1), (0.5, 1), (0.2, 10)])
def test_legend_of_rough_paths_touches_no_curve(fall, times):
    """Whether kappa is constant, or falls by a light load's few cells to a fiftieth, or by nearly full contact."""
    path = _rough_path(contact_fraction_corrected=2e-4)
    path = path._replace(scale=path.scale / times)  # so that a theory ends before the path does
    share = np.minimum(times * path.columns["contact_fraction"] * (path.columns["load"] / 3000) ** -fall, 1)
    figure = load_curves.path_figure([path._replace(columns=path.columns | {"contact_fraction": share})])
    assert [axes.get_legend() is not None for axes in figure.axes] == [False, True, False, False]
    figure.canvas.draw()
    axes = figure.axes[1]
    assert axes.get_legend().get_window_extent().x0 > axes.get_window_extent().x1


def test_a_displacement_constant_but_for_rounding_is_one_colour():
    result = made_up_result(32, 24)
    u = np.full_like(result.displacement, 2.6e-3) * (1 + 1e-9 * np.arange(32))
    image = figures.deformation_figure(replace(result, displacement=u)).axes[0].images[-1]
    assert image.get_clim() == pytest.approx((2.34, 2.86))


@pytest.mark.parametrize("height", [1.0, -1.0, 30.0])
def test_displacements_and_distances_of_rounding_are_none(height):
    """Of a flat periodic patch in contact they are what is left of its height less the approach."""
    made = made_up_result(32, 24)
    left = (np.hypot(*np.meshgrid(made.x, made.y)) - 5) * 0.1 * np.spacing(abs(height))
    made = with_attributes(made, approach=height, periodic_symbol="spectral", problem="given")
    for times, even in ((1, True), (1e6, False)):
        h = times * left
        result = replace(made, undeformed_distance=h, displacement=-h, pressure=0 * h)
        axes = figures.deformation_figure(result).axes[0]
        image, (bar,) = axes.images[-1], axes.child_axes
        assert (np.unique(image.get_array()).tolist() == [0]) == even
        assert ([text.get_text() for text in bar.get_yticklabels()] == ["0"]) == even
        assert (curves.spectrum_figure(result) is None) == even


def test_a_constant_displacement_below_zero_has_its_value_beside_it():
    result = made_up_result(32, 24)
    u = np.full_like(result.displacement, -2.6e-3)
    axes = figures.deformation_figure(replace(result, displacement=u)).axes[0]
    image, (bar,) = axes.images[-1], axes.child_axes
    assert image.get_clim() == pytest.approx((-2.86, -2.34))
    assert [text.get_text() for text in bar.get_yticklabels()] == ["−2.6"]


@pytest.mark.filterwarnings("error")
def test_a_residual_beyond_all_numbers_is_not_drawn(result):
    residual = np.geomspace(1e-6, 1e300, len(result.history["level"]))
    figure = figures.history_figure(replace(result, history=result.history | {"residual": residual}))
    figure.canvas.draw()
    axes = figure.axes[0]
    drawn = np.concatenate([line.get_ydata() for line in axes.lines if line.get_label() != "tolerance"])
    assert np.array_equal(drawn[np.isfinite(drawn)], residual[residual < 1e200])


def test_residuals_far_below_the_tolerance_are_marked_at_the_bottom(result):
    residual = result.history["residual"].copy()
    residual[[1, 3, 4]] = 1e-17, 3e-14, 0
    axes = figures.history_figure(replace(result, history=result.history | {"residual": residual})).axes[0]
    marked = next(line for line in axes.lines if line.get_label().startswith("lower"))
    assert list(marked.get_xdata()) == [2, 4, 5] and (marked.get_ydata() == 1e-9).all()
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    assert np.nanmin(drawn) > axes.get_ylim()[0]
    assert "lower" not in str([line.get_label() for line in figures.history_figure(result).axes[0].lines])


def test_levels_beyond_the_coarsest_grid_are_named_like_it():
    result = made_up_result(32, 24)
    level = result.history["level"].copy()
    level[0] = -(10**15)
    beyond = replace(result, history=result.history | {"level": level})
    assert names(beyond) == ["4 × 3", *names(result)]


def test_path_without_roughness_is_drawn_by_load_and_approach():
    d = np.geomspace(1e-3, 0.1, 5)
    path = load_curves.Path({"load": 1e5 * d**1.5, "approach": d})
    first = load_curves.path_figure([path, path._replace(name="other")]).axes[0]
    assert first.get_xlabel() == "approach δ  [µm]" and first.lines[0].get_xdata() == pytest.approx(1e3 * d)
    assert len(first.lines) == 2


def _outlines(axes):
    return [outline.vertices for band in axes.collections for outline in band.get_paths()]


def test_estimated_errors_are_bands_around_the_curves_of_a_path():
    """Not where they are 1 or no numbers; that of the approach is relative to the one beyond first touch."""
    load, pressure, area = np.geomspace(1, 32, 6), np.geomspace(100, 400, 6), np.geomspace(0.1, 3, 6)
    columns = {
        "load": load, "approach": 1e-3 * load, "indentation": 5e-4 * load, "max_pressure": pressure,
        "contact_area": area, "load_error": np.zeros(6), "approach_error": np.full(6, 0.2),
        "max_pressure_error": np.array([1, 0.5, 0.1, 0.1, 0.1, np.nan]), "contact_area_error": np.full(6, 1.0),
    }  # fmt: skip
    plain = {name: column for name, column in columns.items() if not name.endswith("_error")}
    assert not any(axes.collections for axes in load_curves.path_figure([load_curves.Path(plain)]).axes)
    approach, high, wide, _ = load_curves.path_figure([load_curves.Path(columns)]).axes
    (band,) = _outlines(approach)
    assert band[:, 0].min() == pytest.approx(1 - 0.1) and band[:, 0].max() == pytest.approx(32 + 3.2)  # um
    (band,) = _outlines(high)
    assert (band[:, 0].min(), band[:, 0].max()) == pytest.approx((load[1], load[4]))
    at_second = band[np.isclose(band[:, 0], load[1]), 1]
    assert (at_second.min(), at_second.max()) == pytest.approx((0.5 * pressure[1], 1.5 * pressure[1]))
    assert not wide.collections
    for axes in approach, high:  # within the picture
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        (band,) = _outlines(axes)
        assert ((x0, y0) < band.min(axis=0)).all() and (band.max(axis=0) < (x1, y1)).all()
    assert "estimated error" in [text.get_text() for text in approach.get_legend().get_texts()]


def test_the_estimated_error_of_the_area_is_a_band_of_contact_fractions():
    path = _rough_path()
    path.columns["contact_area_error"] = np.full(8, 0.1)
    fraction, kappa, *_ = load_curves.path_figure([path]).axes
    for axes, first in (fraction, 2.2e-4), (kappa, 2.2):
        (band,) = _outlines(axes)
        at_first = band[np.isclose(band[:, 0], 1e-4), 1]
        assert (at_first.min(), at_first.max()) == pytest.approx((0.9 * first, 1.1 * first))


def test_the_analytic_solution_stands_beside_the_path_of_a_smooth_body():
    """Where it is known, in the units of its panel."""
    d = np.geomspace(1e-3, 0.1, 5)
    exact = {"load": 1e5 * d**1.5, "approach": d, "max_pressure": 1e4 * d**0.5, "contact_area": 3 * d}
    exact["stiffness"] = 1.5e5 * d**0.5
    computed = {name: 1.3 * values for name, values in exact.items()}
    known = load_curves.Path(computed | {f"analytic_{name}": values for name, values in exact.items()})
    figure = load_curves.path_figure([known, load_curves.Path(computed, "other"), known])
    for axes in figure.axes:
        own, _, _, analytic, again = axes.lines
        assert analytic.get_label() == "analytic" and again.get_label() != "analytic"
        factor = 1e3 if "µm" in axes.get_xlabel() else 1
        x, y = (1e5 * d**1.5, None) if factor == 1 else (factor * d, exact["load"])
        assert analytic.get_xdata() == pytest.approx(x) and own.get_xdata() == pytest.approx(1.3 * x)
        assert own.get_ydata() == pytest.approx(1.3 * analytic.get_ydata())
        assert y is None or analytic.get_ydata() == pytest.approx(y)
        assert (
            axes.get_ylim()[0] < analytic.get_ydata().min()
            and analytic.get_ydata().max() < axes.get_ylim()[1]
        )
    assert len(load_curves.path_figure([load_curves.Path(computed)]).axes[0].lines) == 1


def test_path_by_an_approach_counted_from_within_the_roughness_keeps_its_first_steps():
    d = np.linspace(-1e-3, 3e-3, 5)
    axes = load_curves.path_figure([load_curves.Path({"load": (d + 2e-3) ** 1.5, "approach": d})]).axes[0]
    assert axes.lines[0].get_xdata() == pytest.approx(1e3 * d)
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")


def test_a_path_of_negative_approaches_is_drawn_beyond_first_touch():
    columns = {
        "approach": np.array([-0.3, -0.2]),
        "indentation": np.array([0.01, 0.11]),
        "load": np.array([1.0, 9.0]),
    }
    axes = load_curves.path_figure([load_curves.Path(columns)]).axes[0]
    assert "beyond first touch" in axes.get_xlabel() and axes.get_xscale() == "log"
    np.testing.assert_allclose(axes.lines[0].get_xdata(), 1e3 * columns["indentation"], rtol=1e-12)


def test_sweep_is_drawn_against_the_option_with_most_values():
    columns = {
        "grid": ["32", "64", "128"] * 2,
        "method": ["a"] * 3 + ["b"] * 3,
        "exit_status": ["0"] * 6,
        "work_units": ["10", "11", "12", "20", "22", ""],
        "solve_seconds": [""] * 6,
    }
    figure = sweeps.sweep_figure(columns)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "-grid" and axes.get_ylabel() == "work units"
    assert [list(line.get_ydata()) for line in axes.lines] == [[10, 11, 12], [20, 22]]
    assert sweeps.sweep_figure(columns | {"grid": ["32"] * 6, "method": ["a"] * 6}) is None


def test_a_sweep_of_names_has_a_dot_over_each():
    columns = loads_of_a_sweep(load=["1"] * 6, young=["210e3,inf", "210e3,70e3", ""] * 2)
    columns = {"lcp_type": ["fast"] * 3 + ["active_set_that_is_called_" + "x" * 80] * 3} | columns
    for figure, label, said, drawn in (
        (sweeps.sweep_figure(columns), "-young  [N/mm²]", ["210e3,inf", "210e3,70e3", "left out"], [0, 1, 2]),
        (sweeps.sweep_figure(columns, x="lcp_type"), "-lcp_type", ["fast", "…" + "x" * 23], [0, 1]),
    ):
        assert panels(figure)[-2:] == ["operator applications", "time of the solve"]
        axes = figure.axes[0]
        assert axes.get_xlabel() == label and [tick.get_text() for tick in axes.get_xticklabels()] == said
        assert [(line.get_linestyle(), list(line.get_xdata())) for line in axes.lines] == [
            ("None", drawn)
        ] * (5 - len(drawn))
        assert len(axes.get_legend_handles_labels()[1]) == 5 - len(drawn)
    alone = {name: column[::3] for name, column in columns.items()}
    axes = sweeps.sweep_figure(alone).axes[0]
    assert axes.get_xlabel() == "-lcp_type" and axes.get_legend() is None and len(axes.lines) == 1


@pytest.mark.parametrize(("methods", "said"), [(12, "-method"), (13, "-method: 12 of 13")])
def test_the_legend_of_a_sweep_tells_how_many_lines_are_drawn(methods, said):
    columns = {
        "grid": ["32", "64"] * methods,
        "method": [f"m{k // 2}" for k in range(2 * methods)],
        "exit_status": ["0"] * 2 * methods,
        "work_units": [str(k) for k in range(1, 2 * methods + 1)],
    }
    (axes,) = sweeps.sweep_figure(columns).axes
    assert len(axes.lines) == 12 and axes.get_legend().get_title().get_text() == said


def loads_of_a_sweep(**more):
    """Table of three loads by two moduli: columns of text."""
    loads, moduli = ["1", "8", "27"] * 2, ["70e3,inf"] * 3 + ["210e3,inf"] * 3
    area = [0.01 * float(load) ** (2 / 3) for load in loads]
    pressure = [1.5 * float(load) / a for load, a in zip(loads, area, strict=True)]
    made = {
        "load": loads, "young": moduli, "exit_status": ["0"] * 6,
        "work_units": [str(k) for k in range(6)], "solve_seconds": [str(k) for k in range(1, 7)],
        "operator_applications": [str(2 * k) for k in range(6)], "result_load": loads,
        "approach": [repr(0.1 * a) for a in area], "max_pressure": list(map(repr, pressure)),
        "contact_fraction": [repr(a) for a in area], "contact_area": [repr(4 * a) for a in area],
    }  # fmt: skip
    return made | more


def panels(figure):
    return [axes.get_ylabel().partition("  [")[0] for axes in figure.axes]


def test_a_sweep_of_loads_shows_what_is_physical_once_and_no_work():
    figure = sweeps.sweep_figure(loads_of_a_sweep())
    assert panels(figure) == ["approach δ", "contact fraction", "maximum pressure"]
    assert {axes.get_xlabel() for axes in figure.axes} == {"-load  [N]"}
    approach = figure.axes[0]
    assert approach.get_ylabel().endswith("[µm]") and approach.lines[0].get_ydata()[0] == pytest.approx(1.0)
    patches = loads_of_a_sweep(contact_area=list("123456"))  # of several sizes
    assert "contact area" in panels(sweeps.sweep_figure(patches))


def test_a_sweep_over_solvers_shows_work_after_what_is_physical():
    rows = {"option_files": ["fast"] * 3 + ["norm"] * 3}
    names = panels(sweeps.sweep_figure(rows | loads_of_a_sweep()))
    assert names[3:] == ["operator applications", "time of the solve"]
    nearly = [repr(1 + 1e-6 * k) for k in range(6)]  # to what a solve is accurate
    assert panels(sweeps.sweep_figure(rows | loads_of_a_sweep(approach=nearly)))[0] == "contact fraction"


@pytest.mark.parametrize(
    ("option", "drawn"),
    [("approach", "load F"), ("mean_pressure", "approach δ"), ("sphere_radius", "approach δ, load F")],
)
def test_what_an_option_prescribes_is_not_drawn_against_it(option, drawn):
    steps = [1.0, 8.0, 27.0]
    columns = {
        option: list(map(repr, steps)),
        "exit_status": ["0"] * 3,
        "load": [repr(step / 4 if option == "mean_pressure" else step**1.5) for step in steps],
        "result_approach" if option == "approach" else "approach": list(map(repr, steps)),
    }
    figure = sweeps.sweep_figure(columns)
    assert ", ".join(panels(figure)) == drawn
    unit = "N/mm²" if option == "mean_pressure" else "mm"
    assert figure.axes[0].get_xlabel() == f"-{option}  [{unit}]"


def test_columns_of_a_sweep_are_drawn_as_asked_for():
    figure = sweeps.sweep_figure(loads_of_a_sweep(), x="approach", y=["result_load", "work_units"])
    assert panels(figure) == ["load F", "work units"] and figure.axes[0].get_xlabel() == "approach δ  [µm]"
    assert [len(line.get_xdata()) for line in figure.axes[0].lines] == [3, 3]  # through the loads
    against_nothing = loads_of_a_sweep(load=["1"] * 6, young=["a"] * 6)
    assert sweeps.sweep_figure(against_nothing, y=["work_units"]) is None
    for name in ("approach_", "young_", "exit"):
        with pytest.raises(InputError, match=f"{name}: not a column with numbers; there are load, "):
            sweeps.sweep_figure(loads_of_a_sweep(), y=[name])


def test_lines_of_a_sweep_say_what_tells_them_apart():
    one = sweeps.sweep_figure(loads_of_a_sweep()).axes[1].get_legend()
    assert one.get_title().get_text() == "-young  [N/mm²]"
    assert [text.get_text() for text in one.get_texts()] == ["70e3,inf", "210e3,inf"]
    files = {
        "option_files": ["fast"] * 3 + ["norm"] * 3,
        "poisson": ["0.3,0"] * 6,
        "seed": [""] * 3 + ["7"] * 3,
    }
    several = sweeps.sweep_figure(files | loads_of_a_sweep()).axes[2].get_legend()
    assert [text.get_text() for text in several.get_texts()] == [
        "fast; young 70e3,inf", "norm; seed 7; young 210e3,inf"
    ]  # fmt: skip


def test_axes_of_sweeps_have_the_units_that_options_have():
    for option in PROBLEM_OPTIONS:
        said = [unit for unit in ("mm", "N", "N/mm2", "degrees") if f"[{unit}]" in option.meaning]
        if not option.name.endswith("_path"):
            assert (sweeps.find_unit(option.name) or "").replace("²", "2") == "".join(said), option.name
