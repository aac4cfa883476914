"""Figure of a parameter study, drawn from its table."""

import re

import numpy as np

from app.base.errors import InputError
from app.base.quantities import QUANTITIES, axis_label, scale_for_axis
from app.base.units import choose_unit
from app.plots.load_curves import parse_numbers
from app.plots.maps import format_number
from app.plots.style import add_legend, column_width, new_panels, series_style, set_log_axes, with_style

_PHYSICS = "approach", "contact_fraction", "contact_area", "max_pressure", "mean_gap", "stiffness", "load"
_WORK = {  # columns of the solver's work and accuracy, with their labels
    "operator_applications": "operator applications",
    "work_units": "work units",
    "solve_seconds": "time of the solve  [s]",
    "error_bound": "proved bound of the error",
}
_SOLVER = re.compile("(lcp|ksp|pc|mg|snes)_")  # its options keep their names
_MIN_VARIATION = 1e-4  # relative; smaller differences may be errors of the solver
_MAX_SERIES = 12
_MAX_TICKS = 6
_MAX_TICK_LABEL = 24  # characters


@with_style
def sweep_figure(columns, heading="", x=None, y=(), units=None):
    """Draw columns `y` of a table against `x`.

    `columns` are from `read_columns`; `units` are the units of options, by name. For load paths, `x` is by default the
    load. For other tables `x` is the option with the most different numbers, or, if all options are names, with the
    most names. Names become ticks; points above
    names are not connected. `y` are by default the physical quantities that vary and are not prescribed, and the work
    of the solver if its options vary. Return None if nothing varies. Raises InputError if a column has no numbers.
    """
    names = list(columns)
    varied = names[: names.index("exit_status")] if "exit_status" in names else []
    varied = [name for name in varied if len(set(columns[name])) > 1]
    numeric = [name for name in names if _finite(columns[name]).size]
    abscissae = [name for name in names if name in (*varied, *numeric)]
    for option, name, allowed in (("--x", x, abscissae), *(("--y", name, numeric) for name in y)):
        if name is not None and name not in allowed:
            raise InputError(f"{option} {name}: not a column with numbers; there are {', '.join(allowed)}")
    counts = {name: np.unique(_finite(columns[name])).size for name in varied}
    named = [name for name in varied if counts[name] < 2]
    counts |= {name: 1 - 1 / len(set(columns[name])) for name in named}  # below those of all numeric options
    default = "load" if "step" in names and "load" in numeric else max(counts, key=counts.get, default=None)
    x = x or default
    y = y or (x and _choose_columns(columns, varied, x))
    if not (x and y):
        return None
    # Lines connect the values of one option; the other options distinguish lines.
    others = [name for name in varied if name != (x if x in varied else default)]
    others += ["step"] if "step" in names and x in varied else []
    ticks = list(dict.fromkeys(columns[x])) if x in named else []
    positions, x_label = _in_units(parse_numbers(columns[x]), x, varied, units or {})
    positions = np.array([float(ticks.index(value)) for value in columns[x]]) if ticks else positions
    groups = {}
    for row in range(len(positions)):
        groups.setdefault(tuple(columns[name][row] for name in others), []).append(row)
    across = next((n for n, panels in ((1, 1), (2, 4), (3, 6)) if len(y) <= panels), 4)
    figure, panels = new_panels([(6.0, 4.4)] * len(y), across, heading)
    for axes, name in zip(panels, y, strict=True):
        values, label = _in_units(parse_numbers(columns[name]), name, varied, units or {})
        _draw(axes, positions, values, {_label(others, key): rows for key, rows in groups.items()}, ticks)
        axes.set(xlabel=x_label, ylabel=label)
    if others:
        title = [_option_label(others[0], (units or {}).get(others[0]))] if len(others) == 1 else []
        title += [f"{_MAX_SERIES} of {len(groups)}"] if len(groups) > _MAX_SERIES else []
        add_legend(panels[0 if column_width() else across - 1], title=": ".join(title) or None)
    return figure


def _finite(texts):
    values = parse_numbers(texts)
    return values[np.isfinite(values)]


def _choose_columns(columns, varied, x):
    """Return the columns to draw: those that vary.

    Prescribed columns are left out, and those that show the same as another.
    """
    fraction = "contact_fraction" in columns and "domain" not in varied
    same = {*varied, x, "contact_area" if fraction else "contact_fraction"}
    same |= {"load"} if "mean_pressure" in varied else set()
    same |= {"work_units"} if "operator_applications" in columns else set()
    physics, work = (
        [name for name in names if name in columns and name not in same and _varies(columns[name])]
        for names in (_PHYSICS, _WORK)
    )
    solver = any(name in ("option_files", "grid") or _SOLVER.match(name) for name in varied)
    return physics + work if solver or not physics else physics


def _varies(texts):
    finite = _finite(texts)
    return finite.size > 0 and np.ptp(finite) > _MIN_VARIATION * np.abs(finite).max()


def _option_label(option, unit):
    """Return the axis label of an option."""
    if _SOLVER.match(option):
        return f"-{option}"
    if option in QUANTITIES:
        return axis_label(option)
    return option.replace("_", " ") + (f"  [{unit}]" if unit else "")


def _in_units(values, name, varied, units):
    largest = np.nanmax(np.abs(values), initial=0.0)
    if name in varied and name not in QUANTITIES:
        factor, unit = choose_unit(largest, units.get(name))
        return values * factor, _option_label(name, unit)
    name = name.removeprefix("result_")
    factor, label = scale_for_axis(largest, name)
    return values * factor, _WORK.get(name) or label


def _label(others, key):
    """Return a line's label: the values of the options that vary.

    If several options vary, the label also has their names.
    """
    parts = [
        value if len(others) == 1 or name == "option_files" else f"{name} {value}"
        for name, value in zip(others, key, strict=True)
        if value
    ]
    return "; ".join(parts) or ("left out" if others else None)


def _draw(axes, x, y, groups, names):
    """Draw a line for each group of rows, or single points.

    If x is an option with texts as values, `names` has these texts. Then points are drawn, and the texts label the x
    axis. If x is a number, `names` is empty, and lines are drawn.
    """
    for number, (label, rows) in enumerate(list(groups.items())[:_MAX_SERIES]):
        rows = np.array(rows)[np.argsort(x[rows], kind="stable")]
        valid = rows[np.isfinite(x[rows]) & np.isfinite(y[rows])]
        style = series_style(number) | ({"linestyle": "none"} if names else {})
        axes.plot(x[valid], y[valid], **style, label=label)
    for direction, values in (("x", x), ("y", y))[bool(names) :]:
        values = values[np.isfinite(values)]
        if values.min() > 0 and values.max() >= 4 * values.min():
            set_log_axes(axes, direction)
    if names:
        most = _MAX_TICK_LABEL
        labels = [f"…{name[1 - most :]}" if len(name) > most else name for name in names]
        labels = [label or "left out" for label in labels]
        axes.set_xticks(range(len(names)), labels, rotation=30, ha="right", rotation_mode="anchor")
        axes.set_xlim(-0.5, len(names) - 0.5)
        return
    points = np.unique(x[np.isfinite(x)])
    if len(points) <= _MAX_TICKS:
        axes.set_xticks(points, [format_number(value) for value in points])
        axes.set_xticks([], minor=True)
