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
from app.base.quantities import axis_label, scale_for_axis
from app.base.units import choose_length_unit, to_millimetres
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

# Drawn column -> column to which the error is relative, and column of the error; default: NAME, NAME_error.
_ERRORS = {
    "approach": ("indentation", "approach_error"),
    "indentation": ("indentation", "approach_error"),
    "contact_fraction": ("contact_fraction", "contact_area_error"),
    "mean_pressure": ("mean_pressure", "load_error"),
}
_FORCES = "load", "mean_pressure"


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

    @property
    def relative(self):
        """1 / (E* times rms slope) [mm2/N]; NaN if unknown."""
        return 1 / self.scale if self.scale > 0 else np.nan


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
    """Draw load paths in four panels.

    For nominally flat rough bodies the panels show contact fraction, kappa, mean gap and stiffness against pressure,
    with the theories of Persson and of Bush, Gibson and Thomas. kappa is the contact fraction divided by the relative
    pressure. For other bodies the panels show load, pressure, area and stiffness.
    """
    rough = all(
        np.isfinite(path.relative) and path.select("mean_pressure", "contact_fraction") is not None
        for path in paths
    )
    figure, panels = new_panels([(7.0, 4.3)] * 4, 2, heading)
    for axes, draw in zip(panels, _ROUGH if rough else _SMOOTH, strict=True):
        draw(axes, paths)
    if not rough and len(panels[0].lines) + len(panels[0].collections) > 1:
        panels[0].legend(loc="best")
    return figure


def _draw_curves(axes, paths, x, y, scale=lambda path: (1.0, 1.0), logs=(True, True)):
    """Draw column `y` against column `x` for all paths.

    The function `scale` returns, for a path, the factors of x and of y. `logs` are two values, true if x or y is
    logarithmic; then only positive values are drawn. Return False if there are no values.
    """
    above = 0.0 if any(logs) else -np.inf
    for number, path in enumerate(paths):
        values = path.select(x, y, above=above)
        if values is None:
            continue
        values = values * np.array(scale(path))[:, None]
        axes.plot(*values, **series_style(number), label=path.name or "computed")
        for name in x, y:
            _draw_errors(axes, path, (x, y), name, scale(path), number)
        _mark_unloading(axes, *values, values[0 if x in _FORCES else 1], number)
    if not axes.lines:
        missing = [name for name in (x, y) if all(path.select(name, above=above) is None for path in paths)]
        annotate_empty(axes, f"no {(*missing, y)[0].replace('_', ' ')}")
        return False
    set_log_axes(axes, [name for name, log in zip("xy", logs, strict=True) if log])
    return True


def _mark_unloading(axes, x, y, force, number):
    """Mark steps with less `force` than the step before by open markers."""
    falls = np.diff(force, prepend=force[0]) < 0
    if falls.any():
        label = None if any(line.get_label() == "unloading" for line in axes.lines) else "unloading"
        style = series_style(number) | {"markerfacecolor": "white", "linestyle": "none", "label": label}
        axes.plot(x[falls], y[falls], **style)


def _draw_errors(axes, path, names, name, scale, number):
    """Draw a column's estimated errors as bars on a curve.

    `names` are the columns of the curve, `name` is the column with the error. Where the relative error is 1 there is no
    bar: this number means that the quantity does not converge with the grid.
    """
    reference, error = _ERRORS.get(name, (name, f"{name}_error"))
    reference = reference if reference in path.columns else name
    columns = [path.columns.get(column) for column in (*names, reference, error)]
    if any(column is None for column in columns):
        return
    x, y, size, share = (np.asarray(column, float) for column in columns)
    along = names.index(name)
    half = np.where((share > 0) & (share < 1), np.abs(size) * share * scale[along], np.nan)
    if np.isfinite(half).any():
        label = None if axes.containers else "estimated error"
        style = {"ecolor": series_style(number)["color"], "alpha": 0.5, "fmt": "none", "label": label}
        axes.errorbar(x * scale[0], y * scale[1], **{("xerr", "yerr")[along]: half}, **style)


def _draw_analytic(axes, paths, x, y, scale):
    """Draw the analytic solutions of smooth bodies, column y against x.

    The function `scale` returns the factors of x and of y.
    """
    label = "analytic"
    for path in paths:
        exact = path.select(f"analytic_{x}", f"analytic_{y}")
        if exact is not None and exact.shape[1] > 1:
            axes.plot(
                exact[0] * scale[0], exact[1] * scale[1], color="0.3", linestyle=DASHED, zorder=1, label=label
            )
            label = None  # one entry in the legend


_RELATIVE = "p / (E* h′rms)"


def _draw_shares(axes, paths, value):
    """Draw a function of the contact fraction, ``value(x, fraction)``.

    x is the mean pressure divided by E* times the rms slope. Two theories are drawn, too.
    """
    pressures = []
    for number, path in enumerate(paths):
        p, fraction = path.select("mean_pressure", "contact_fraction")
        x = p * path.relative
        pressures.append(x)
        axes.plot(x, value(x, fraction), **series_style(number), label=path.name or "computed")
        with np.errstate(divide="ignore"):
            one = value(np.asarray(path.columns["mean_pressure"], float) * path.relative, 1.0)
        names = "mean_pressure", "contact_fraction"
        _draw_errors(axes, path, names, names[1], (path.relative, one), number)
        _mark_unloading(axes, x, value(x, fraction), p, number)
    label, cross = "corrected for the stepped boundary", {"color": "0.4", "marker": "x", "linestyle": "none"}
    for path in paths:
        corrected = path.select("mean_pressure", "contact_fraction_corrected")
        if corrected is not None:
            x = corrected[0] * path.relative
            pressures.append(x)
            axes.plot(x, value(x, corrected[1]), **cross, zorder=1, label=label)
            label = None  # one entry in the legend
    x = np.concatenate(pressures)
    set_log_axes(axes, "x")
    span = np.geomspace(x.min(), x.max() * 1.0001, 200)
    persson, bgt = persson_fraction(span), bush_gibson_thomas_fraction(span)
    axes.plot(span, value(span, persson), color="0.3", linestyle=DASHED, label="Persson")
    axes.plot(span, value(span, bgt), color="0.3", linestyle=DOTTED, label="Bush, Gibson, Thomas")
    _draw_hardness_theory(axes, paths, "persson_hardness_fraction", value, "Persson with hardness")
    axes.set_xlabel(_RELATIVE)


def _draw_hardness_theory(axes, paths, name, value, label):
    """Draw a column of Persson's theory with hardness.

    The function ``value(x, column)`` is as in `_draw_shares`. Return the lines.
    """
    lines = []
    for path in paths:
        columns = path.select("mean_pressure", name)
        if columns is not None:
            p, fraction = columns[:, columns[0].argsort()]
            x, style = p * path.relative, {"color": "0.3", "linestyle": DASH_DOTTED, "zorder": 1}
            lines += axes.plot(x, value(x, fraction), **style, label=None if lines else label)
    return lines


def _draw_plastic(axes, paths, x, y, scale, theory=()):
    """Draw the plastic share or area, with a legend."""
    lines = []
    for number, path in enumerate(paths):
        values = path.select(x, y)
        if values is not None:
            style = series_style(number) | {"marker": "x", "linestyle": DOTTED}
            label = f"{path.name} plastic".strip()
            lines += axes.plot(values[0] * scale(path), values[1], **style, label=label)
    if lines:
        axes.legend(handles=[*lines, *theory[:1]], loc="lower right")


def _draw_fraction(axes, paths):
    def share(x, fraction):
        return fraction

    _draw_shares(axes, paths, share)
    theory = _draw_hardness_theory(axes, paths, "persson_plastic_fraction", share, "Persson, plastic")
    _draw_plastic(axes, paths, "mean_pressure", "plastic_fraction", lambda path: path.relative, theory)
    axes.set_ylabel("contact fraction")
    set_log_axes(axes, "y")


def _draw_kappa(axes, paths):
    _draw_shares(axes, paths, lambda x, fraction: fraction / x)
    axes.set(ylabel="κ = contact fraction · E* h′rms / p", ylim=(0, None))
    add_legend(axes)  # also for the panel on the left


def _draw_gap(axes, paths):
    gaps = [path.select("mean_pressure", "mean_gap") for path in paths]
    unit = choose_length_unit(max((gap[1].max() for gap in gaps if gap is not None), default=1.0))
    scale, logs = (
        lambda path: (unit.per_mm, path.relative),
        (False, True),
    )  # nearly exponential: a straight line
    if _draw_curves(axes, paths, "mean_gap", "mean_pressure", scale, logs):
        axes.set(xlabel=f"mean gap  [{unit.name}]", ylabel=_RELATIVE)


def _draw_stiffness(rough, axes, paths):
    """Draw the exact stiffness; if unknown, the stiffness from step differences."""
    names, shown = [], []
    for path in paths:
        if path.select("load", "stiffness") is None:
            names.append(path.name)
            columns = {name: column for name, column in path.columns.items() if name != "stiffness"}
            differences = columns.get("stiffness_by_differences")
            path = path._replace(
                columns=columns if differences is None else columns | {"stiffness": differences}
            )
        shown.append(path)
    x = "mean_pressure" if rough else "load"
    factor, load = _scale_axis(paths, "load")
    if not _draw_curves(axes, shown, x, "stiffness", lambda path: (path.relative if rough else factor, 1.0)):
        return
    which = ", ".join(names) if len(names) < 4 else f"{len(names)} of {len(paths)} paths"
    which = f": {which}" if len(names) < len(paths) else ""
    note = f"\nby differences{which}" if names else ""
    axes.set(xlabel=_RELATIVE if rough else load, ylabel=f"{axis_label('stiffness')}{note}")
    if not rough:
        _draw_analytic(axes, paths, "load", "stiffness", (factor, 1.0))


def _select_all(paths, name):
    columns = [path.select(name, above=-np.inf) for path in paths]
    return np.concatenate([column[0] for column in columns if column is not None] or [[1.0]])


def _scale_axis(paths, name):
    return scale_for_axis(np.abs(_select_all(paths, name)).max(), name)


def _draw_load(axes, paths):
    x, columns = "approach", [path.columns for path in paths]
    values = _select_all(paths, x)
    if values.min() < 0 and all("indentation" in one and "analytic_approach" not in one for one in columns):
        x, values = "indentation", _select_all(paths, "indentation")
    # Approaches counted from within the roughness are negative. Bodies that unload keep an indentation.
    log = values.min() >= 0 and all((np.diff(path.columns["load"]) >= 0).all() for path in paths)
    (across, x_label), (up, y_label) = _scale_axis(paths, x), _scale_axis(paths, "load")
    if _draw_curves(axes, paths, x, "load", lambda path: (across, up), (log, log)):
        axes.set(xlabel=x_label, ylabel=y_label)
        _draw_analytic(axes, paths, "approach", "load", (across, up))


def _draw_area(axes, paths):
    _draw_against_load("contact_area", axes, paths)
    factor, _ = _scale_axis(paths, "load")
    _draw_plastic(axes, paths, "load", "plastic_area", lambda path: factor)


def _draw_against_load(name, axes, paths):
    factor, label = _scale_axis(paths, "load")
    if _draw_curves(axes, paths, "load", name, lambda path: (factor, 1.0)):
        axes.set(xlabel=label, ylabel=axis_label(name))
        _draw_analytic(axes, paths, "load", name, (factor, 1.0))


_ROUGH = (_draw_fraction, _draw_kappa, _draw_gap, partial(_draw_stiffness, True))
_SMOOTH = (
    _draw_load,
    partial(_draw_against_load, "max_pressure"),
    _draw_area,
    partial(_draw_stiffness, False),
)


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
        lines = file.read(1 << 16).splitlines()
    if suffix == ".md":
        lines = [line.replace(b"|", b" ") for line in lines if line.startswith(b"|")]
    # Texts of heights may have the same form, but other names.
    names, rule = (*lines, b"", b"")[:2]
    is_ruled = b"--" in rule and set(b"-: ") >= set(rule)
    return is_ruled and not {b"exit_status", b"load"}.isdisjoint(names.split())


def _read_rows(path):
    """Return the rows of a table as mappings of texts."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        import h5py

        with h5py.File(path) as file:
            columns = {name: file[name] for name in file.attrs.get("columns", file)}
            texts = {name: data.dtype.kind == "O" for name, data in columns.items()}
            columns = {name: (data.asstr() if texts[name] else data)[...] for name, data in columns.items()}
        return [dict(zip(columns, map(str, row), strict=True)) for row in zip(*columns.values(), strict=True)]
    with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets write a byte order mark
        if path.suffix.lower() == ".csv":
            return list(csv.DictReader(file, strict=True))
        lines = file.read().splitlines()
    if path.suffix.lower() == ".md":
        rows = [re.split(r"(?<!\\)\|", line.strip()[1:-1]) for line in lines if line.startswith("|")]
        rows = [[cell.replace(r"\|", "|") for cell in row] for row in rows]
    else:
        widths = [match.span() for match in re.finditer("-+", lines[1])]
        rows = [[line[start:stop] for start, stop in widths] for line in lines]
    names, _, *rows = ([cell.strip() for cell in row] for row in rows)
    return [dict(zip(names, row, strict=True)) for row in rows]


def read_columns(path):
    """Return the columns of a table as texts.

    The table was written by app.sweep, or for a load path.
    """
    try:
        rows = _read_rows(path)
    except (OSError, ValueError, IndexError, csv.Error) as error:
        raise InputError(f"table {path}: cannot be read: {error}") from None
    if not rows or None in rows[0] or any(None in row.values() for row in rows):
        raise InputError(f"table {path}: must have a line of names and lines of as many values")
    columns = {name: [row[name] for row in rows] for name in rows[0]}
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
