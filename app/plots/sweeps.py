"""Picture of the table of a sweep. Not collective: call on one rank."""

from __future__ import annotations

import re

import numpy as np

from app.base.errors import InputError
from app.base.quantities import axis_label
from app.base.units import choose_length_unit
from app.plots.load_curves import parse_numbers
from app.plots.style import BESIDE, new_figure, series_style, set_log_axes, with_style

_PHYSICS = "approach", "contact_fraction", "contact_area", "max_pressure", "mean_gap", "stiffness", "load"
_WORK = {  # and labels
    "operator_applications": "operator applications",
    "work_units": "work units",
    "solve_seconds": "time of the solve  [s]",
    "error_bound": "proved bound of the error",
}
_SAME = {"load": "mean_pressure", "contact_area": "contact_fraction"}  # but for the area of the patch
_OF_SOLVERS = re.compile("(option_files|grid)$|(lcp|ksp|pc|mg|tao|snes)_")  # they change the work of a solve
_UNITS = (
    ("N", "load"),
    ("N/mm²", "young|.+_modulus|mean_pressure"),
    ("degrees", ".+_angle"),
    ("mm", "domain|approach|mean_gap|hertz_r.|.+_radi(us|i)|.+_length|.+_diameter"),
    ("mm", "surface_(sigma|rolloff|cutoff|rms_height|._filter)"),
)
_EVEN = 1e-4  # of the largest: what differs by less is the same to what a solve is accurate to
_MOST_SERIES = 12
_MOST_TICKS = 6
_LONGEST = 24  # letters of a name at a tick


def find_unit(option):
    """Unit of an option's numbers, None if they have none."""
    return next((unit for unit, names in _UNITS if re.fullmatch(names, option)), None)


@with_style
def sweep_figure(columns, heading="", x=None, y=()):
    """What a sweep has measured, against one of its options: what is physical, and work where solvers are compared.

    Columns of the table of a load path are drawn in the same way, against the load.

    Parameters
    ----------
    columns : mapping of str to list of str
        See `app.plots.load_curves.read_csv`.
    heading : str
    x : str, optional
        Column to draw against; default: the option that has the most numbers, or else names. Names are ticks, and no
        lines join what stands over them.
    y : sequence of str
        Columns to draw; default: those that differ, and are not what an option prescribes.

    Returns
    -------
    Figure, or None if there is nothing to draw

    Raises
    ------
    InputError
        If `x` or `y` are not columns with numbers.
    """
    names = list(columns)
    varied = names[: names.index("exit_status")] if "exit_status" in names else []
    varied = [name for name in varied if len(set(columns[name])) > 1]
    known = [name for name in names if _finite(columns[name]).size]
    against = [name for name in names if name in (*varied, *known)]  # of an option names will do
    for option, name, allowed in (("--x", x, against), *(("--y", name, known) for name in y)):
        if name is not None and name not in allowed:
            raise InputError(f"{option} {name}: not a column with numbers; there are {', '.join(allowed)}")
    spread = {name: np.unique(_finite(columns[name])).size for name in varied}
    named = [name for name in varied if spread[name] < 2]
    spread |= {name: 1 - 1 / len(set(columns[name])) for name in named}  # any option with numbers comes first
    # Steps of load paths make lines of their own, whatever varies beside.
    most = "load" if "step" in names and "load" in known else max(spread, key=spread.get, default=None)
    x = x or most
    y = y or (x and _worth_drawing(columns, varied, x))
    if not (x and y):
        return None
    # Against what was measured a line goes through the values of an option, too.
    others = [name for name in varied if name != (x if x in varied else most)]
    others += ["step"] if "step" in names and x in varied else []  # against an option, of one load each
    ticks = list(dict.fromkeys(columns[x])) if x in named else []
    at, unit = _in_units(parse_numbers(columns[x]), x, varied)
    at = np.array([float(ticks.index(value)) for value in columns[x]]) if ticks else at
    groups = {}
    for row in range(len(at)):
        groups.setdefault(tuple(columns[name][row] for name in others), []).append(row)
    across = next((n for n, panels in ((1, 1), (2, 4), (3, 6)) if len(y) <= panels), 4)
    down = -(-len(y) // across)
    figure = new_figure(6.0 * across, 4.4 * down, heading)
    for axes, name in zip(np.ravel(figure.subplots(down, across)), y, strict=False):
        values, label = _in_units(parse_numbers(columns[name]), name, varied)
        _draw(axes, at, values, {_label(others, key): rows for key, rows in groups.items()}, ticks)
        axes.set(xlabel=unit, ylabel=label)
    for axes in figure.axes[len(y) :]:
        axes.remove()
    if others:
        said = [_axis_label(others[0])] if len(others) == 1 else []
        said += [f"{_MOST_SERIES} of {len(groups)}"] if len(groups) > _MOST_SERIES else []
        figure.axes[across - 1].legend(**BESIDE, title=": ".join(said) or None)
    return figure


def _finite(texts):
    values = parse_numbers(texts)
    return values[np.isfinite(values)]


def _worth_drawing(columns, varied, x):
    """Columns that differ and do not say again what an option, x or another column says."""
    named = {name: f"result_{name}" if name in varied else name for name in (*_PHYSICS, *_WORK)}
    named = {name: column for name, column in named.items() if column in columns and column != x}
    drawn = {}
    for name, column in named.items():
        found, values = _finite(columns[column]), parse_numbers(columns[column])
        same = [drawn.get(other, other) for other in (name, _SAME.get(name)) if other in (*varied, *drawn)]
        if (
            found.size
            and np.ptp(found) > _EVEN * np.abs(found).max()
            and not any(_proportional(values, parse_numbers(columns[other])) for other in same)
        ):
            drawn[name] = column
    physics = [column for name, column in drawn.items() if name in _PHYSICS]
    if "operator_applications" in drawn:
        drawn.pop("work_units", None)
    work = [column for name, column in drawn.items() if name in _WORK]
    return physics + work if not physics or any(map(_OF_SOLVERS.match, varied)) else physics


def _proportional(values, other):
    kept = np.isfinite(values)
    values, other = values[kept], other[kept]
    k = np.abs(values).argmax()
    return np.allclose(values * other[k], other * values[k], rtol=1e-9, atol=0)


def _axis_label(option):
    unit = find_unit(option)
    return ("option file" if option == "option_files" else f"-{option}") + (f"  [{unit}]" if unit else "")


def _in_units(values, name, varied):
    """Values of a column and the label of their axis; lengths that were measured in a unit that suits them."""
    if name in varied:
        return values, _axis_label(name)
    name = name.removeprefix("result_")
    label = _WORK.get(name) or axis_label(name)
    if "[mm]" not in label:
        return values, label
    unit = choose_length_unit(np.nanmax(np.abs(values)))
    return values * unit.per_mm, label.replace("mm", unit.name)


def _label(others, key):
    """What tells a line from the others: values, of several options with their names."""
    named = [(name, value) for name, value in zip(others, key, strict=True) if value]
    bare = len(others) == 1
    told = [value if bare or name == "option_files" else f"{name} {value}" for name, value in named]
    return "; ".join(told) or ("left out" if others else None)


def _draw(axes, x, y, groups, names):
    """Draw values of several groups against numbers; or against names, of which x has the places."""
    for number, (label, rows) in enumerate(list(groups.items())[:_MOST_SERIES]):
        rows = np.array(rows)[np.argsort(x[rows], kind="stable")]
        kept = rows[np.isfinite(x[rows]) & np.isfinite(y[rows])]
        axes.plot(
            x[kept], y[kept], **series_style(number) | ({"linestyle": "none"} if names else {}), label=label
        )
    for direction, values in (("x", x), ("y", y))[bool(names) :]:
        values = values[np.isfinite(values)]
        if values.min() > 0 and values.max() >= 4 * values.min():
            set_log_axes(axes, direction)
    if names:
        told = [f"…{name[1 - _LONGEST :]}" if len(name) > _LONGEST else name or "left out" for name in names]
        axes.set_xticks(range(len(names)), told, rotation=30, ha="right", rotation_mode="anchor")
        axes.set_xlim(-0.5, len(names) - 0.5)
        return
    points = np.unique(x[np.isfinite(x)])
    if len(points) <= _MOST_TICKS:
        axes.set_xticks(points, [f"{value:.4g}" for value in points])
        axes.set_xticks([], minor=True)
