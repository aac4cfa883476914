"""Figures of parameter studies."""

from functools import partial

import numpy as np
import pytest

from app.base.errors import InputError
from app.cli.problem_options import UNITS
from app.plots.sweeps import sweep_figure as draw

from .drawn import panel_names

sweep_figure = partial(draw, units=UNITS)


def test_lines_against_an_option_have_one_load_step():
    """Loads of one path stand above each other there; no line goes up and down between them."""
    seeds, steps = ["1", "1", "2", "2", "3", "3"], ["1", "2"] * 3
    columns = {"seed": seeds, "exit_status": ["0"] * 6, "step": steps, "load": ["5", "50"] * 3}
    columns |= {"max_pressure": ["20", "60", "30", "70", "40", "80"]}
    (axes,) = sweep_figure(columns, x="seed", y=["max_pressure"]).axes
    assert [line.get_ydata().tolist() for line in axes.lines] == [[20, 30, 40], [60, 70, 80]]
    (axes,) = sweep_figure(columns, y=["max_pressure"]).axes
    assert [line.get_ydata().tolist() for line in axes.lines] == [[20, 60], [30, 70], [40, 80]]


def test_default_abscissa_is_the_option_with_most_values():
    columns = {
        "grid": ["32", "64", "128"] * 2,
        "method": ["a"] * 3 + ["b"] * 3,
        "exit_status": ["0"] * 6,
        "work_units": ["10", "11", "12", "20", "22", ""],
        "solve_seconds": [""] * 6,
    }
    figure = sweep_figure(columns)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "grid" and axes.get_ylabel() == "work units"
    assert [list(line.get_ydata()) for line in axes.lines] == [[10, 11, 12], [20, 22]]
    assert sweep_figure(columns | {"grid": ["32"] * 6, "method": ["a"] * 6}) is None


def test_names_have_unconnected_points():
    columns = loads_of_a_sweep(load=["1"] * 6, young=["210e3,inf", "210e3,70e3", ""] * 2)
    columns = {"lcp_type": ["fast"] * 3 + ["active_set_that_is_called_" + "x" * 80] * 3} | columns
    for figure, label, said, drawn in (
        (
            sweep_figure(columns),
            "young  [N/mm²]",
            ["210e3,inf", "210e3,70e3", "left out"],
            [0, 1, 2],
        ),
        (sweep_figure(columns, x="lcp_type"), "-lcp_type", ["fast", "…" + "x" * 23], [0, 1]),
    ):
        assert panel_names(figure)[-2:] == ["operator applications", "time of the solve"]
        axes = figure.axes[0]
        assert axes.get_xlabel() == label and [tick.get_text() for tick in axes.get_xticklabels()] == said
        assert [(line.get_linestyle(), list(line.get_xdata())) for line in axes.lines] == [
            ("None", drawn)
        ] * (5 - len(drawn))
        assert len(axes.get_legend_handles_labels()[1]) == 5 - len(drawn)
    alone = {name: column[::3] for name, column in columns.items()}
    axes = sweep_figure(alone).axes[0]
    assert axes.get_xlabel() == "-lcp_type" and axes.get_legend() is None and len(axes.lines) == 1


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


def test_loads_are_drawn_with_each_physical_quantity_once():
    figure = sweep_figure(loads_of_a_sweep())
    assert panel_names(figure) == ["approach δ", "contact fraction", "maximum pressure"]
    assert {axes.get_xlabel() for axes in figure.axes} == {"load F  [N]"}
    approach = figure.axes[0]
    assert approach.get_ylabel().endswith("[µm]") and approach.lines[0].get_ydata()[0] == pytest.approx(1.0)
    patches = {"domain": ["0,1,0,1", "0,2,0,1"] * 3} | loads_of_a_sweep()
    assert "contact area" in panel_names(sweep_figure(patches))


def test_solver_options_are_drawn_with_work():
    rows = {"option_files": ["fast"] * 3 + ["norm"] * 3}
    names = panel_names(sweep_figure(rows | loads_of_a_sweep()))
    assert names[3:] == ["operator applications", "time of the solve"]
    nearly = [repr(1 + 1e-6 * k) for k in range(6)]  # to what a solve is accurate
    assert panel_names(sweep_figure(rows | loads_of_a_sweep(approach=nearly)))[0] == "contact fraction"


@pytest.mark.parametrize(
    ("option", "drawn"),
    [("approach", "load F"), ("mean_pressure", "approach δ"), ("sphere_radius", "approach δ, load F")],
)
def test_prescribed_quantities_are_not_drawn(option, drawn):
    steps = [1.0, 8.0, 27.0]
    columns = {
        option: list(map(repr, steps)),
        "exit_status": ["0"] * 3,
        "load": [repr(step / 4 if option == "mean_pressure" else step**1.5) for step in steps],
        "result_approach" if option == "approach" else "approach": list(map(repr, steps)),
    }
    figure = sweep_figure(columns)
    assert ", ".join(panel_names(figure)) == drawn
    labels = {"approach": "approach δ  [mm]", "mean_pressure": "mean pressure  [N/mm²]"}
    assert figure.axes[0].get_xlabel() == labels.get(option, "sphere radius  [mm]")


def test_large_loads_are_drawn_in_kilonewtons():
    columns = {"roller_design_load": ["5e3", "2e4"], "exit_status": ["0"] * 2, "load": ["6000", "12000"]}
    axes = sweep_figure(columns).axes[0]
    assert axes.get_xlabel() == "roller design load  [kN]" and axes.get_ylabel() == "load F  [kN]"
    assert axes.lines[0].get_xydata() == pytest.approx(np.array([[5, 6], [20, 12]]))


def test_requested_columns_are_drawn():
    figure = sweep_figure(loads_of_a_sweep(), x="approach", y=["result_load", "work_units"])
    assert (
        panel_names(figure) == ["load F", "work units"] and figure.axes[0].get_xlabel() == "approach δ  [µm]"
    )
    assert [len(line.get_xdata()) for line in figure.axes[0].lines] == [3, 3]  # through the loads
    against_nothing = loads_of_a_sweep(load=["1"] * 6, young=["a"] * 6)
    assert sweep_figure(against_nothing, y=["work_units"]) is None
    for name in ("approach_", "young_", "exit"):
        with pytest.raises(InputError, match=f"{name}: not a column with numbers; there are load, "):
            sweep_figure(loads_of_a_sweep(), y=[name])


def test_legend_names_the_options_that_differ():
    one = sweep_figure(loads_of_a_sweep()).axes[1].get_legend()
    assert one.get_title().get_text() == "young  [N/mm²]"
    assert [text.get_text() for text in one.get_texts()] == ["70e3,inf", "210e3,inf"]
    files = {
        "option_files": ["fast"] * 3 + ["norm"] * 3,
        "poisson": ["0.3,0"] * 6,
        "seed": [""] * 3 + ["7"] * 3,
    }
    several = sweep_figure(files | loads_of_a_sweep()).axes[2].get_legend()
    assert [text.get_text() for text in several.get_texts()] == [
        "fast; young 70e3,inf", "norm; seed 7; young 210e3,inf"
    ]  # fmt: skip
