"""Style: reproducible files, readable logarithmic axes, distinct lines."""

import matplotlib
import pytest
from matplotlib import pyplot
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from app.plots import figures, style

from .drawn import overlaps


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_equal_results_give_equal_files(result, tmp_path, kind):
    for name in ("a", "b"):
        style.save_figure(figures.history_figure(result), tmp_path / f"{name}.{kind}", dpi=40)
    assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


@pytest.mark.parametrize("values", [[3.0, 3.1], [1.0], [0.9, 4.0], [1e-9, 1e5], [1.1, 95.0], [0.2, 40.0]])
def test_logarithmic_axes_have_two_labels_that_do_not_overlap(values):
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


def test_twelve_lines_have_different_styles():
    drawn = [{name: str(value) for name, value in style.series_style(number).items()} for number in range(12)]
    assert all(one != other for k, one in enumerate(drawn) for other in drawn[:k])


@pytest.mark.parametrize(
    "draw", [figures.summary_figure, figures.pressure_figure, figures.deformation_figure]
)
def test_paper_style_fits_a_column(result, tmp_path, draw):
    with style.use_style("paper"):
        figure = draw(result)
        style.save_figure(figure, tmp_path / "a.svg")
    assert figure.get_figwidth() == pytest.approx(8.5 / 2.54) and figure._suptitle is None
    assert 'width="240.94' in (tmp_path / "a.svg").read_text()  # points
    figure.draw_without_rendering()
    renderer, box = figure.canvas.get_renderer(), figure.bbox
    lefts = []
    for axes in figure.axes:
        assert {text.get_fontsize() for text in (axes.xaxis.label, axes.yaxis.label)} == {8}
        drawn = axes.get_tightbbox(renderer)
        assert box.x0 <= drawn.x0 and drawn.x1 <= box.x1
        lefts.append(axes.get_position().x0)
    assert max(lefts) - min(lefts) < 0.1  # panels below each other


@pytest.mark.parametrize(
    "settings",
    [
        {"text.usetex": True},
        {
            "axes.grid": True,
            "figure.autolayout": True,
            "savefig.transparent": True,
            "lines.linestyle": "none",
        },
        {"axes.facecolor": "black", "font.family": "no such font", "axes.formatter.use_locale": True},
        "xkcd",
    ],
)
def test_settings_of_the_users_program_do_not_change_a_picture(settings, result, tmp_path):
    style.save_figure(figures.history_figure(result), tmp_path / "a.png", dpi=40)
    with pyplot.xkcd() if settings == "xkcd" else matplotlib.rc_context(settings):
        before = dict(matplotlib.rcParams)
        style.save_figure(figures.history_figure(result), tmp_path / "b.png", dpi=40)
        assert dict(matplotlib.rcParams) == before
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_settings_of_windows_stay_while_a_picture_is_drawn():
    settings = {"toolbar": "None", "savefig.directory": "x", "figure.max_open_warning": 0, "figure.dpi": 50}
    with matplotlib.rc_context(settings):
        drawn_with = style.with_style(lambda: {name: matplotlib.rcParams[name] for name in settings})()
        assert drawn_with == settings


def test_without_the_users_backend_a_figure_is_made_all_the_same(monkeypatch):
    def no_display(**_):
        raise ImportError("Cannot load backend 'TkAgg'")

    monkeypatch.setattr(pyplot, "figure", no_display)
    with style.interactive():
        assert style.new_figure(4, 3).get_size_inches().tolist() == [4, 3]


def test_values_that_hardly_vary_are_shown_from_zero():
    axes = Figure().subplots()
    axes.plot([1, 10, 100], [5.0, 5.0 + 1e-9, 5.002])
    style.set_log_axes(axes)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert axes.get_ylim() == pytest.approx((0, 6.5), rel=1e-3)
