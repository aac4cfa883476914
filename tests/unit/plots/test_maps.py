"""Maps of fields: colours, units, legends, narrow patches."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from results import made_up_result, with_attributes

from app.base.errors import InputError
from app.halfspace.grid import Grid
from app.plots import curves, figures, maps
from app.plots.pictures import plot

from .drawn import image_values, overlaps


def test_pressure_map_is_white_without_pressure(result):
    values, x, y = image_values(figures.pressure_figure(result))
    assert np.array_equal(np.ma.getmaskarray(values), result.pressure == 0)
    assert np.array_equal(values.compressed(), result.pressure[result.pressure > 0])
    assert x == pytest.approx(result.x) and y == pytest.approx(result.y)


def test_averaged_image_keeps_the_position_of_a_cell(result, monkeypatch):
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


def test_contact_legend_explains_colours_and_white(result):
    contact = np.zeros_like(result.contact)
    contact[::8, ::8] = 1
    for pattern, colours, text in (
        (contact, 10, "%, 192 contact spots"),
        (contact * (np.arange(contact.size) < 20).reshape(contact.shape), 3, "%, 3 contact spots"),
        (result.contact, 1, "%"),
    ):
        axes = figures.contact_figure(replace(result, contact=pattern)).axes[0]
        told, none = axes.get_legend().get_texts()
        assert told.get_text().endswith(text) and none.get_text() == "no contact"
        shown = {patch.get_facecolor() for patch in axes.get_legend().findobj(Rectangle)}
        assert len(shown) == colours + 1 and (1, 1, 1, 1) in shown
        pixels = axes.images[-1].get_array()
        assert {tuple(colour) for colour in pixels[pixels[..., 3] > 0]} == shown - {(1, 1, 1, 1)}


def test_contact_legend_has_only_colours_of_the_map():
    texts = figures.contact_figure(made_up_result(punch_radius=3.0)).axes[0].get_legend().get_texts()
    assert [text.get_text() for text in texts] == ["contact: 100%", "no contact possible"]


def test_displacement_constant_to_rounding_has_one_colour():
    result = made_up_result(32, 24)
    u = np.full_like(result.displacement, 2.6e-3) * (1 + 1e-9 * np.arange(32))
    image = figures.deformation_figure(replace(result, displacement=u)).axes[0].images[-1]
    assert image.get_clim() == pytest.approx((2.34, 2.86))


@pytest.mark.parametrize("height", [1.0, -1.0, 30.0])
def test_rounding_errors_are_drawn_as_zero(height):
    made = made_up_result(32, 24)
    left = (np.hypot(*np.meshgrid(made.x, made.y)) - 5) * 0.1 * np.spacing(abs(height))
    facts = {"periodic_symbol": "spectral", "problem": "given", "surfaces": 1}
    made = with_attributes(made, approach=height, **facts)
    for times, even in ((1, True), (1e6, False)):
        h = times * left
        result = replace(made, undeformed_distance=h, displacement=-h, pressure=0 * h)
        axes = figures.deformation_figure(result).axes[0]
        image, (bar,) = axes.images[-1], axes.child_axes
        assert (np.unique(image.get_array()).tolist() == [0]) == even
        assert ([text.get_text() for text in bar.get_yticklabels()] == ["0"]) == even
        assert (curves.spectrum_figure(result) is None) == even


def test_map_that_is_long_in_y_lies_flat():
    grid = Grid.from_domain(30, 50, (0, 1, 0, 9))
    result = replace(made_up_result(30, 50), x=grid.x(), y=grid.y())
    lying = figures.pressure_figure(result).axes[0]
    assert lying.get_xlabel()[0] == "y" and lying.get_ylabel()[0] == "x"
    assert "(x: " in lying.get_xlabel() and lying.get_xlim() == pytest.approx((0, 9))
    pixels = np.ma.filled(lying.images[-1].get_array(), 0)
    np.testing.assert_array_equal(pixels, maps.finite_pressure(result.pressure).T)
    sections = [axes.get_xlabel()[:1] for axes in figures.summary_figure(result).axes[2:]]
    assert "".join(sections) == "xy"  # no stress below: along the contact the pressure says more


def test_title_of_a_map_says_what_its_colours_mean(result):
    """A label of the colour bar would look like one of the next panel."""
    axes = figures.pressure_figure(result).axes[0]
    bar = axes.child_axes[0]
    assert f"maximum {result.pressure.max():.4g}" in axes.get_title() and "[N/mm²]" in axes.get_title()
    assert not bar.get_ylabel() + bar.get_xlabel()


@pytest.mark.parametrize("corner", [0.0, -1000.2, 12345.6])
@pytest.mark.parametrize("lie", [False, True])
def test_tick_labels_of_tall_contacts_do_not_touch(corner, lie):
    result = made_up_result(64, 64)
    contact = np.zeros((64, 64), bool)
    contact[18:46, 30:34] = True
    grid = replace(result.grid, x0=corner, y0=corner, dx=1 / 64, dy=1 / 64)
    result = replace(
        result, contact=contact, pressure=1.0 * contact, undeformed_distance=np.ones((64, 64)),
        x=grid.x(), y=grid.y(),
    )  # fmt: skip
    figure = Figure(figsize=(5, 4))
    renderer = FigureCanvasAgg(figure).get_renderer()
    if lie:
        figure = figures.summary_figure(result)
    else:
        plot(result, "pressure", figure.subplots())
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert not overlaps([tick.label1 for tick in axes.xaxis.get_major_ticks()], renderer)
        assert not axes.xaxis.get_offset_text().get_text()


@pytest.mark.parametrize("pixels", [1024, 50])
def test_contact_map_has_three_colours_with_a_hardness(result, monkeypatch, pixels):
    monkeypatch.setattr(maps, "MAX_PIXELS", pixels)
    plastic = (result.contact == 1) & (result.pressure > np.median(result.pressure[result.contact == 1]))
    depth = np.where(plastic, 1e-4, 0.0)
    capped = replace(result, plastic=plastic, plastic_depth=depth)
    figure = figures.contact_figure(capped)
    axes = figure.axes[0]
    elastic, plastic_text, *others = [text.get_text() for text in axes.get_legend().get_texts()]
    possible = np.count_nonzero(np.isfinite(result.undeformed_distance))
    assert plastic_text == f"plastic contact: {100 * plastic.sum() / possible:.3g}%"
    assert elastic == f"elastic contact: {100 * (result.contact.sum() - plastic.sum()) / possible:.3g}%"
    assert "no contact" in others
    pixels = np.asarray(axes.images[-1].get_array())
    covered = pixels[..., 3] == 1
    assert {tuple(np.round(colour, 2)) for colour in pixels[covered][:, :3]} >= {
        (0, 0.45, 0.7),
        (0.84, 0.37, 0),
    }
    values, *_ = image_values(plot(capped, "plastic_depth")[0])
    assert (values.compressed() > 0).all() and values.count() > 0
    with pytest.raises(InputError, match="the result has no hardness"):
        plot(result, "plastic_depth")
