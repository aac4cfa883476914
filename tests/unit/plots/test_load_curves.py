"""Load paths: curves, theories, error bands."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from results import with_attributes

from app.plots import load_curves
from app.reference.rough import persson_fraction

from .drawn import overlaps


def test_tick_labels_of_a_load_path_do_not_overlap():
    columns = {"load": np.zeros(3), "approach": np.array([-0.1, -0.2, -0.3])}
    figure = load_curves.path_figure([load_curves.Path(columns | {"indentation": columns["approach"]})])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert not overlaps(figure.axes[0].get_xticklabels(), canvas.get_renderer())


def test_result_and_table_of_a_path_have_the_same_theories(result):
    """Where Persson's fractions are known, whatever the problem is called; they tell E* h'rms."""
    columns = {"mean_pressure": np.array([3.0, 300.0, 3e5]), "contact_fraction": np.array([0.1, 0.5, 1.0])}
    columns |= {"load": columns["mean_pressure"], "approach": np.array([1.0, 2.0, 3.0])}
    persson = {"persson_fraction": persson_fraction(columns["mean_pressure"] / 5000)}
    # As of a ball, a function.
    known = with_attributes(result, problem="given", contact_modulus=1e5, rms_slope=0.02)
    for flat in (True, False):
        found = columns | persson if flat else columns
        table = {name: list(map(repr, map(float, column))) for name, column in found.items()}
        for path in (load_curves.get_path(replace(known, path=found)), load_curves.get_csv_path(table)):
            assert path.scale == pytest.approx(5000 if flat else np.nan, rel=1e-12, nan_ok=True)
            assert ("κ" in load_curves.path_figure([path]).axes[1].get_ylabel()) == flat


def test_rough_paths_are_drawn_with_theories():
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


def test_each_path_has_its_exact_stiffness_if_known():
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


def _rough_path(**shares):
    """Path of eight mean pressures, in contact on 2.2e-4 of them; `shares`: other columns in proportion."""
    p = np.geomspace(1, 3000, 8)
    shares = {"load": 1, "mean_pressure": 1, "contact_fraction": 2.2e-4} | shares
    return load_curves.Path({name: share * p for name, share in shares.items()}, "", scale=1e4)


@pytest.mark.parametrize(("fall", "times"), [(0.0, 1), (0.5, 1), (0.2, 10)])
def test_legend_of_rough_paths_is_clear_of_curves(fall, times):
    """Whether kappa is constant, or falls by a light load's few cells to a fiftieth, or by nearly full contact."""
    path = _rough_path(contact_fraction_corrected=2e-4)
    path = path._replace(scale=path.scale / times)  # so that a theory ends before the path does
    share = np.minimum(times * path.columns["contact_fraction"] * (path.columns["load"] / 3000) ** -fall, 1)
    figure = load_curves.path_figure([path._replace(columns=path.columns | {"contact_fraction": share})])
    assert [axes.get_legend() is not None for axes in figure.axes] == [False, True, False, False]
    figure.canvas.draw()
    axes = figure.axes[1]
    assert axes.get_legend().get_window_extent().x0 > axes.get_window_extent().x1


def _bars(axes):
    return np.array([bar for bars in axes.collections for bar in bars.get_segments() if len(bar)])


def test_estimated_errors_are_bars_on_the_curves_of_a_path():
    load, pressure, area = np.geomspace(1, 32, 6), np.geomspace(100, 400, 6), np.geomspace(0.1, 3, 6)
    columns = {
        "load": load, "approach": 1e-3 * load, "indentation": 5e-4 * load, "max_pressure": pressure,
        "contact_area": area, "load_error": np.zeros(6), "approach_error": np.full(6, 0.2),
        "max_pressure_error": np.array([1, 0.5, 0.1, 0.1, 0.1, np.nan]), "contact_area_error": np.full(6, 1.0),
    }  # fmt: skip
    plain = {name: column for name, column in columns.items() if not name.endswith("_error")}
    assert not any(axes.collections for axes in load_curves.path_figure([load_curves.Path(plain)]).axes)
    approach, high, wide, _ = load_curves.path_figure([load_curves.Path(columns)]).axes
    bars = _bars(approach)
    assert bars[..., 0].min() == pytest.approx(1 - 0.1) and bars[..., 0].max() == pytest.approx(
        32 + 3.2
    )  # um
    bars = _bars(high)
    assert [bar[0, 0] for bar in bars] == pytest.approx(load[1:5])
    assert bars[0][:, 1] == pytest.approx([0.5 * pressure[1], 1.5 * pressure[1]])
    assert not wide.collections
    for axes in approach, high:  # within the picture
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        bars = _bars(axes)
        assert ((x0, y0) < np.nanmin(bars, axis=(0, 1))).all() and (
            np.nanmax(bars, axis=(0, 1)) < (x1, y1)
        ).all()
    assert "estimated error" in [text.get_text() for text in approach.get_legend().get_texts()]


def test_loading_and_unloading_have_bars_of_their_own():
    load, error = np.array([1.0, 2, 3, 2, 1]), np.full(5, 0.1)
    area = np.array([1.0, 2, 3, 2.1, 1.2])
    path = load_curves.Path({"load": load, "contact_area": area, "contact_area_error": error})
    bars = _bars(load_curves.path_figure([path]).axes[2])
    assert bars[:, :, 0] == pytest.approx(np.array([load, load]).T)
    assert bars[:, :, 1] == pytest.approx(np.array([0.9 * area, 1.1 * area]).T)


def test_steps_of_unloading_have_open_markers():
    load = np.array([1.0, 2, 3, 2, 1, 0, 1])
    p = {"load": load, "mean_pressure": load}
    smooth = p | {
        "approach": np.arange(1.0, 8),
        "max_pressure": 9 * load,
        "contact_area": load,
        "stiffness": load,
    }
    rough = p | {"contact_fraction": 1e-2 * load, "mean_gap": 5 - load, "stiffness": load}
    for path in load_curves.Path(smooth), load_curves.Path(rough, scale=1e2):
        figure = load_curves.path_figure([path, path])
        for axes in figure.axes:
            curves = [line for line in axes.lines if line.get_label() == "computed"]
            marks = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
            assert [mark.get_label() for mark in marks].count("unloading") == 1
            for curve, mark in zip(curves, marks, strict=True):
                falling = slice(3, 5 + (curve.get_xdata().size == load.size))  # no load 0 on logarithmic axes
                np.testing.assert_array_equal(mark.get_xydata(), curve.get_xydata()[falling])
        legends = [axes.get_legend() for axes in figure.axes if axes.get_legend()]
        assert [
            [text.get_text() for text in legend.get_texts()].count("unloading") for legend in legends
        ] == [1]


def test_smooth_paths_are_drawn_with_their_analytic_solution():
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


def test_paths_with_indentation_are_drawn_beyond_first_touch():
    columns = {
        "approach": np.array([-0.3, -0.2]),
        "indentation": np.array([0.01, 0.11]),
        "load": np.array([1.0, 9.0]),
    }
    axes = load_curves.path_figure([load_curves.Path(columns)]).axes[0]
    assert "beyond first touch" in axes.get_xlabel() and axes.get_xscale() == "log"
    np.testing.assert_allclose(axes.lines[0].get_xdata(), 1e3 * columns["indentation"], rtol=1e-12)


def test_paths_with_a_hardness_have_plastic_curves_and_their_theory():
    p = np.geomspace(10, 1e3, 7)
    columns = {"load": p, "mean_pressure": p, "contact_fraction": 2.2e-4 * p, "plastic_fraction": 1e-4 * p}
    theory = {"persson_hardness_fraction": 2e-4 * p, "persson_plastic_fraction": 0.9e-4 * p}
    fraction, kappa, *_ = load_curves.path_figure([load_curves.Path(columns | theory, "", scale=1e4)]).axes
    lines = {line.get_label(): line.get_ydata() for line in fraction.lines}
    assert lines["plastic"] == pytest.approx(columns["plastic_fraction"])
    assert lines["Persson, plastic"] == pytest.approx(theory["persson_plastic_fraction"])
    assert lines["Persson with hardness"] == pytest.approx(theory["persson_hardness_fraction"])
    assert [text.get_text() for text in fraction.get_legend().get_texts()] == ["plastic", "Persson, plastic"]
    assert "Persson with hardness" in [text.get_text() for text in kappa.get_legend().get_texts()]
    smooth = {"load": p, "approach": p, "contact_area": p, "plastic_area": p / 2}
    area = load_curves.path_figure([load_curves.Path(smooth)]).axes[2]
    assert [text.get_text() for text in area.get_legend().get_texts()] == ["plastic"]


def test_loads_of_unloading_or_at_negative_approaches_have_linear_axes():
    load = np.array([1.0, 2.0, 1.0, 0.0])
    for columns, scale in (
        ({"load": load, "approach": load + 1}, "linear"),
        ({"load": np.arange(1.0, 5), "approach": np.linspace(-1e-3, 3e-3, 4)}, "linear"),
        ({"load": load + np.arange(4) * 3, "approach": load + 1}, "log"),
    ):
        axes = load_curves.path_figure([load_curves.Path(columns)]).axes[0]
        assert axes.get_xscale() == axes.get_yscale() == scale
        assert len(axes.lines[0].get_xdata()) == 4


@pytest.mark.parametrize(("largest", "unit"), [(9e3, "N"), (2e4, "kN")])
def test_loads_have_a_readable_unit(largest, unit):
    loads = np.array([largest / 10, largest])
    columns = {
        "load": loads,
        "approach": loads / 1e6,
        "max_pressure": loads / 10,
        "contact_area": loads / 1e4,
    }
    figure = load_curves.path_figure([load_curves.make_path(columns, "")])
    load, pressure = figure.axes[:2]
    assert load.get_ylabel() == pressure.get_xlabel() == f"load F  [{unit}]"
    assert pressure.lines[0].get_xdata() == pytest.approx(loads / (1000 if unit == "kN" else 1))


@pytest.mark.parametrize(
    ("name", "ends", "scale"),
    [("time", (1e-2, 10), "log"), ("time", (1, 12), "linear"), ("sliding_distance", (1, 1000), "linear")],
)
def test_creep_and_wear_are_drawn_against_time_and_distance(name, ends, scale):
    at = np.concatenate([[0], np.geomspace(*ends, 5)])
    columns = {name: at, "load": np.array([0, 2, 3, 2, 1, 0.0]), "approach": at, "indentation": at}
    columns |= {"max_pressure": columns["load"], "contact_area": columns["load"]}
    for path in load_curves.Path(columns), load_curves.Path(columns | {"mean_pressure": at}, "", 1e3):
        figure = load_curves.path_figure([path])
        assert [axes.get_ylabel().split("  ")[0] for axes in figure.axes] == [
            "load F", "approach beyond first touch", "maximum pressure", "contact area",
        ]  # fmt: skip
        for axes in figure.axes:
            assert axes.get_xscale() == scale and axes.get_xlabel().startswith(name.replace("_", " "))
            assert len(axes.lines) == 1 and axes.lines[0].get_xdata() == pytest.approx(at)
        assert figure.axes[0].lines[0].get_ydata() == pytest.approx(columns["load"])
