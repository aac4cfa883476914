"""Figures of load paths, and reading of their tables.

A load path is a mapping of columns with an entry for each step, as in the group ``path`` of a result file; their units
are in `app.base.quantities`. Missing columns are not drawn. Estimated relative errors, such as ``load_error``, are bars
on the curves.
"""

import csv
import re
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from app.base.errors import InputError
from app.base.quantities import scale_for_axis
from app.base.units import to_millimetres
from app.options import option_table
from app.plots.style import (
    DASH_DOTTED,
    DASHED,
    DOTTED,
    add_legend,
    annotate_empty,
    new_panels,
    series_style,
    set_log_axes,
    with_style,
)
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction, persson_pressure

_AXES = (  # drawn columns
    "load", "approach", "indentation", "max_pressure", "contact_area", "stiffness", "contact_fraction", "mean_gap",
    "transmissivity_x", "time", "sliding_distance",
)  # fmt: skip
# Drawn column -> column to which the error is relative, and column of the error; default: NAME, NAME_error.
_ERRORS = {
    "approach": ("indentation", "approach_error"),
    "indentation": ("indentation", "approach_error"),
    "contact_fraction": ("contact_fraction", "contact_area_error"),
    "mean_pressure": ("mean_pressure", "load_error"),
}
_FORCES = "load", "mean_pressure"
_HISTORIES = "time", "sliding_distance"
_MIN_LOG_SPAN = 100  # of the largest to the smallest time on a logarithmic axis
_FRACTION = "contact_fraction"
# Drawn column -> columns of the plastic part, and of its theory.
_PLASTIC = {
    "contact_area": ("plastic_area", ""),
    _FRACTION: ("plastic_fraction", "persson_plastic_fraction"),
}
_SHARES = (  # other contact fractions: column, label, style
    (
        "contact_fraction_corrected",
        "corrected for the stepped boundary",
        {"marker": "x", "linestyle": "none"},
    ),
    ("persson", "Persson", {"linestyle": DASHED}),
    ("bush_gibson_thomas", "Bush, Gibson, Thomas", {"linestyle": DOTTED}),
    ("persson_hardness_fraction", "Persson with hardness", {"linestyle": DASH_DOTTED}),
)


class Path(NamedTuple):
    """Load path to draw: columns, name, pressure scale.

    `scale` is E* times the rms slope of nominally flat bodies [N/mm2]; NaN for other bodies.
    """

    columns: dict
    name: str = ""
    scale: float = np.nan

    def select(self, *names, above=0.0):
        """Return columns at steps where every column exceeds `above`.

        Return None if a column is missing, or if there is no such step.
        """
        if any(name not in self.columns for name in names):
            return None
        values = np.array([np.asarray(self.columns[name], float) for name in names])
        valid = (np.isfinite(values) & (values > above)).all(axis=0)
        return values[:, valid] if valid.any() else None

    def multiply(self, factor, name):
        """Return the path with a column, its error and its analytic values times a factor."""
        names = {name, f"{name}_bar", f"analytic_{name}"} & self.columns.keys()
        return self._replace(
            columns=self.columns | {key: factor * np.asarray(self.columns[key], float) for key in names}
        )


def get_path(result, name=""):
    """Return the load path of a result, or None."""
    columns = getattr(result, "path", None)
    return make_path(columns, name) if columns else None


def make_path(columns, name):
    """Make the `Path` of a load path from columns.

    The scale of the path follows from the columns of Persson's contact fraction.
    """
    path = Path(columns, name)
    theory = path.select("persson_fraction", "mean_pressure")
    if theory is None:
        return path
    lightest = theory[0].argmin()  # near full contact Persson's fraction loses digits of the scale
    with np.errstate(divide="ignore"):
        return path._replace(scale=float(theory[1, lightest] / persson_pressure(theory[0, lightest])))


@with_style
def path_figure(paths, heading=""):
    """Draw load paths in four panels, and in a fifth the transmissivity if it is known.

    For nominally flat rough bodies the panels show contact fraction, kappa, mean gap and stiffness against pressure,
    with the theories of Persson and of Bush, Gibson and Thomas. kappa is the contact fraction divided by the relative
    pressure. For other bodies the panels show load, pressure, area and stiffness. If the bodies creep or wear, they
    show load, approach, pressure and area against time or sliding distance.
    """
    history = next((x for x in _HISTORIES if all(x in path.columns for path in paths)), None)
    rough = all(path.scale > 0 and path.select("mean_pressure", _FRACTION) is not None for path in paths)
    has_flow = any("transmissivity_x" in path.columns for path in paths)
    figure, panels = new_panels([(7.0, 4.3)] * (4 + has_flow), 2, heading)
    shown, note = _complete_stiffness(list(map(_add_bars, paths)))
    labels = {}
    for name in _AXES:
        factor, labels[name] = scale_for_axis(np.abs(_select_all(paths, name)).max(), name)
        shown = [path.multiply(factor, name) for path in shown]
    labels["stiffness"] += note
    draw = partial(_draw_history, history) if history else _draw_rough if rough else _draw_smooth
    draw(panels[:4], shown, labels)
    if has_flow:
        _draw_panel(panels[4], shown, labels, "load", "transmissivity_x")
    return figure


def _add_bars(path):
    """Return a path with estimated errors, in the units of their columns.

    Where the relative error is 1 there is no bar: this number means that the quantity does not converge with the grid.
    """
    columns = dict(path.columns)
    for name in (*_AXES, "mean_pressure"):
        reference, error = _ERRORS.get(name, (name, f"{name}_error"))
        size = path.columns.get(reference, path.columns.get(name))
        if size is not None and error in path.columns:
            share = np.asarray(path.columns[error], float)
            size = np.abs(np.asarray(size, float)) * share
            columns[f"{name}_bar"] = np.where((share > 0) & (share < 1), size, np.nan)
    return path._replace(columns=columns)


def _complete_stiffness(paths):
    """Return the paths with stiffness by differences where the exact one is unknown.

    Also return a note for the axis, which names these paths.
    """
    shown, names = [], []
    for path in paths:
        if path.select("load", "stiffness") is None:
            names.append(path.name)
            if (differences := path.columns.get("stiffness_by_differences")) is not None:
                path = path._replace(columns=path.columns | {"stiffness": differences})
        shown.append(path)
    which = ", ".join(names) if len(names) < 4 else f"{len(names)} of {len(paths)} paths"
    which = f": {which}" if len(names) < len(paths) else ""
    return shown, f"\nby differences{which}" if names else ""


def _select_all(paths, name):
    columns = [path.select(name, above=-np.inf) for path in paths]
    return np.concatenate([column[0] for column in columns if column is not None] or [[1.0]])


def _draw_rough(panels, paths, labels):
    paths = [path.multiply(1 / path.scale, "mean_pressure") for path in paths]
    labels = labels | {"mean_pressure": "p / (E* h′rms)"}
    p = np.concatenate([path.select("mean_pressure", _FRACTION)[0] for path in paths])
    span = np.geomspace(p.min(), p.max() * 1.0001, 200)
    theories = {"persson": persson_fraction(span), "bush_gibson_thomas": bush_gibson_thomas_fraction(span)}
    theory = Path({"mean_pressure": span, **theories})
    for axes, shown, logs in (
        (panels[0], [*paths, theory], "xy"), (panels[1], [*map(_divide, paths), _divide(theory)], "x"),
    ):  # fmt: skip
        others = [(shown, "mean_pressure", *row) for row in _SHARES]
        _draw_panel(axes, shown[:-1], labels, "mean_pressure", _FRACTION, logs, others)
    panels[1].set(ylabel="κ = contact fraction · E* h′rms / p", ylim=(0, None))
    add_legend(panels[1])  # also for the panel on the left
    _draw_panel(panels[2], paths, labels, "mean_gap", "mean_pressure", "y")  # nearly a straight line
    _draw_panel(panels[3], paths, labels, "mean_pressure", "stiffness")


def _divide(path):
    """Return a path with contact fractions divided by the relative pressure."""
    p, names = path.columns["mean_pressure"], (_FRACTION, f"{_FRACTION}_bar", *(row[0] for row in _SHARES))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = {name: path.columns[name] / p for name in names if name in path.columns}
    return path._replace(columns={"mean_pressure": p} | shares)


def _draw_history(x, panels, paths, labels):
    """Draw numbers against time or sliding distance; times that span decades on a logarithmic axis."""
    positive = [time for time in _select_all(paths, x) if time > 0]
    log = x == "time" and positive and max(positive) >= _MIN_LOG_SPAN * min(positive)
    for axes, y in zip(panels, ("load", "indentation", "max_pressure", "contact_area"), strict=True):
        _draw_panel(axes, paths, labels, x, y, "")
        set_log_axes(axes, "x" if log else "")


def _draw_smooth(panels, paths, labels):
    x, columns = "approach", [path.columns for path in paths]
    values = _select_all(paths, x)
    if values.min() < 0 and all("indentation" in one and "analytic_approach" not in one for one in columns):
        x, values = "indentation", _select_all(paths, "indentation")
    # Approaches counted from within the roughness are negative. Bodies that unload keep an indentation.
    log = values.min() >= 0 and all((np.diff(one["load"]) >= 0).all() for one in columns)
    rows = (x, "load"), *(("load", y) for y in ("max_pressure", "contact_area", "stiffness"))
    for axes, (x, y) in zip(panels, rows, strict=True):
        theory = paths, f"analytic_{x}", f"analytic_{y}", "analytic", {"linestyle": DASHED}
        _draw_panel(axes, paths, labels, x, y, "xy" if log or y != "load" else "", [theory])
    if len(panels[0].lines) + len(panels[0].collections) > 1:
        panels[0].legend(loc="best")


def _draw_panel(axes, paths, labels, x, y, logs="xy", others=()):
    """Draw column `y` against column `x` for all paths, with marks, errors and theories.

    The axes named in `logs` are logarithmic; then only positive values are drawn. `others` are arguments of
    `_draw_theory`.
    """
    above = 0.0 if logs else -np.inf
    for number, path in enumerate(paths):
        values = path.select(x, y, above=above)
        if values is not None:
            axes.plot(*values, **series_style(number), label=path.name or "computed")
            _draw_errors(axes, path, x, y, number)
            if x not in _HISTORIES:
                _mark_unloading(axes, *values, values[0 if x in _FORCES else 1], number)
    if not axes.lines:
        missing = [name for name in (x, y) if all(path.select(name, above=above) is None for path in paths)]
        annotate_empty(axes, f"no {(*missing, y)[0].replace('_', ' ')}")
        return
    for other in others:
        _draw_theory(axes, *other)
    _draw_plastic(axes, paths, x, *_PLASTIC.get(y, ("", "")))
    set_log_axes(axes, logs)
    axes.set(xlabel=labels[x], ylabel=labels[y])


def _draw_errors(axes, path, x, y, number):
    """Draw the estimated errors of two columns as bars on their curve."""
    bars = {"xerr": path.columns.get(f"{x}_bar", np.nan), "yerr": path.columns.get(f"{y}_bar", np.nan)}
    bars = {along: bar for along, bar in bars.items() if np.isfinite(bar).any()}
    if bars:
        style = {"ecolor": series_style(number)["color"], "alpha": 0.5, "fmt": "none"}
        label = None if axes.containers else "estimated error"
        axes.errorbar(path.columns[x], path.columns[y], **bars, **style, label=label)


def _mark_unloading(axes, x, y, force, number):
    """Mark steps with less `force` than the step before by open markers."""
    falls = np.diff(force, prepend=force[0]) < 0
    if falls.any():
        label = None if any(line.get_label() == "unloading" for line in axes.lines) else "unloading"
        style = series_style(number) | {"markerfacecolor": "white", "linestyle": "none", "label": label}
        axes.plot(x[falls], y[falls], **style)


def _draw_theory(axes, paths, x, y, label, style):
    """Draw a column of a theory in grey, with one entry in the legend; return the lines."""
    lines = []
    for path in paths:
        columns = path.select(x, y)
        if columns is not None:
            columns = columns[:, columns[0].argsort()]
            lines += axes.plot(*columns, color="0.3", zorder=1, **style, label=None if lines else label)
    return lines


def _draw_plastic(axes, paths, x, y, theory):
    """Draw the plastic part of a contact and its theory, with a legend."""
    grey, lines = _draw_theory(axes, paths, x, theory, "Persson, plastic", {"linestyle": DASH_DOTTED}), []
    for number, path in enumerate(paths):
        values = path.select(x, y)
        if values is not None:
            style = series_style(number) | {"marker": "x", "linestyle": DOTTED}
            lines += axes.plot(*values, **style, label=f"{path.name} plastic".strip())
    if lines:
        axes.legend(handles=[*lines, *grey[:1]], loc="lower right")


def is_table(path):
    """Return whether a file is a table, in a format of `app.io.table.write_table`."""
    suffix = path.suffix.lower()
    if suffix == ".csv" or not path.is_file():  # a pipe would not end
        return suffix == ".csv"
    if suffix in (".h5", ".hdf5"):
        import h5py  # loads slowly

        with suppress(OSError), h5py.File(path) as file:
            return "exit_status" in file
    if suffix not in (".txt", ".md"):
        return False
    with path.open("rb") as file:
        lines = file.read(1 << 16).decode(errors="replace").splitlines()
    # Texts of heights may have the same form, but other names.
    names, rule = (*_split_rows(lines, suffix), [], [])[:2]
    return set("-:") == {"-", *"".join(rule), ":"} and not {"exit_status", "load"}.isdisjoint(names)


def _split_rows(lines, suffix):
    """Return the cells of a table in Markdown or text; the second row is a rule."""
    if suffix == ".md":
        rows = [re.split(r"(?<!\\)\|", line.strip()[1:-1]) for line in lines if line.startswith("|")]
        return [[cell.replace(r"\|", "|").strip() for cell in row] for row in rows]
    widths = [match.span() for match in re.finditer("-+", (*lines, "", "")[1])]
    return [[line[start:stop].strip() for start, stop in widths] for line in lines]


def _read_rows(path):
    """Return the rows of a table as lists of texts; the first one has the names."""
    suffix = path.suffix.lower()
    if suffix in (".h5", ".hdf5"):
        import h5py

        with h5py.File(path) as file:
            names = list(file.attrs.get("columns", file))
            columns = [file[name].asstr() if file[name].dtype.kind == "O" else file[name] for name in names]
            return [names, *([*map(str, row)] for row in zip(*columns, strict=True))]
    with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets write a byte order mark
        if suffix == ".csv":
            return [row for row in csv.reader(file, strict=True) if row]
        names, _, *rows = _split_rows(file.read().splitlines(), suffix)
    return [names, *rows]


def read_columns(path):
    """Return the columns of a table as texts.

    The table was written by app.sweep, or for a load path.
    """
    try:
        names, *rows = _read_rows(path)
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"table {path}: cannot be read: {error}") from None
    if not rows or any(len(row) != len(names) for row in rows):
        raise InputError(f"table {path}: must have a line of names and lines of as many values")
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    if "exit_status" not in columns:
        if not {"load", "approach"} <= columns.keys():
            raise InputError(f"table {path}: neither a table of app.sweep nor a load path")
        if get_csv_path(columns).select("load", "approach", above=-np.inf) is None:
            raise InputError(f"table {path}: no step has numbers for load and approach")
    return columns


def parse_numbers(texts):
    """Convert texts to numbers.

    For a pair of numbers, its first number is taken. Lengths with units become numbers of mm. A text without a number
    becomes NaN.
    """

    def value(text):
        try:
            return option_table.number(to_millimetres(text.strip().strip("()[]")).split(",")[0])
        except ValueError:
            return np.nan

    return np.array([value(text) for text in texts])


def get_csv_path(columns, name=""):
    """Return the `Path` of a load path's table; `columns` are from `read_columns`."""
    return make_path({key: parse_numbers(texts) for key, texts in columns.items()}, name)
