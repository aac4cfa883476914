"""Pictures of load paths, and reading of tables.

A *path* is a mapping of columns, one entry per step, as in group ``path`` of a result file: ``load`` [N], ``approach``,
``indentation``, ``mean_gap`` [mm], ``mean_pressure``, ``max_pressure`` [N/mm2], ``contact_fraction``,
``contact_fraction_corrected``,
``contact_area`` [mm2], ``stiffness`` or ``stiffness_by_differences`` [N/mm], ``persson_fraction``. What is missing is
not drawn. Estimated relative errors (``load_error``, ``approach_error``, ``max_pressure_error``,
``contact_area_error``) are light bands around the curves.

Not collective: call on one rank.
"""

from __future__ import annotations

import csv
from functools import partial
from typing import NamedTuple

import numpy as np

from app.base.errors import InputError
from app.base.quantities import axis_label
from app.base.units import choose_length_unit
from app.options import option_table
from app.plots.style import (
    BESIDE,
    DASHED,
    DOTTED,
    annotate_empty,
    new_figure,
    series_style,
    set_log_axes,
    with_style,
)
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction, persson_pressure

# Number whose share an estimated error is, and its column, where they are not called as what is drawn.
_ERRORS = {
    "approach": ("indentation", "approach_error"),
    "indentation": ("indentation", "approach_error"),
    "contact_fraction": ("contact_fraction", "contact_area_error"),
    "mean_pressure": ("mean_pressure", "load_error"),
}
_BAND = {"alpha": 0.2, "linewidth": 0, "zorder": 0.5}


class Path(NamedTuple):
    """Columns of a path, its name, and what its loads are compared with.

    `scale` is E* times rms slope of nominally flat bodies [N/mm2], NaN of others.
    """

    columns: dict
    name: str = ""
    scale: float = np.nan

    def positive(self, *names, lowest=0.0):
        """Columns without the steps at which one of them is no number above `lowest`; None if that leaves nothing."""
        if any(name not in self.columns for name in names):
            return None
        values = np.array([np.asarray(self.columns[name], float) for name in names])
        kept = (np.isfinite(values) & (values > lowest)).all(axis=0)
        return values[:, kept] if kept.any() else None

    @property
    def relative(self):
        """1 / (E* h'rms) [mm2/N], NaN without `scale`."""
        return 1 / self.scale if self.scale > 0 else np.nan


def get_path(result, name=""):
    """Path of a result, None if it has none. Not collective."""
    columns = getattr(result, "path", None)
    return _path(columns, name) if columns else None


def _path(columns, name):
    """Path whose scale Persson's fractions tell; only nominally flat bodies have these."""
    path = Path(columns, name)
    known = path.positive("persson_fraction", "mean_pressure")
    if known is None:
        return path
    light = known[0].argmin()  # where Persson's fraction is far from 1, and tells p' to all digits
    with np.errstate(divide="ignore"):
        return path._replace(scale=float(known[1, light] / persson_pressure(known[0, light])))


@with_style
def path_figure(paths, heading=""):
    """Contact fraction and kappa, mean gap and stiffness of load paths; or load and area against approach.

    The first where mean pressure, Persson's and a contact fraction are known: of rough surfaces on a plane. Persson's
    and Bush, Gibson and Thomas's theories are drawn beside it.

    Parameters
    ----------
    paths : sequence of Path
    heading : str
    """
    rough = all(
        np.isfinite(path.relative) and path.positive("mean_pressure", "contact_fraction") is not None
        for path in paths
    )
    figure = new_figure(14.0, 8.6, heading)
    panels = figure.subplots(2, 2)
    for axes, draw in zip(panels.flat, _ROUGH if rough else _SMOOTH, strict=True):
        draw(axes, paths)
    if not rough and len(panels[0, 0].lines) + len(panels[0, 0].collections) > 1:
        panels[0, 0].legend(loc="best")
    return figure


def _curves(axes, paths, x, y, scale=lambda path: (1.0, 1.0), logs=(True, True)):
    """Draw a column against another for all paths, positive values on logarithmic axes; return whether any."""
    drawn, lowest = False, 0.0 if any(logs) else -np.inf

    def known(*names):
        return [path.positive(*names, lowest=lowest) for path in paths]

    for number, (path, found) in enumerate(zip(paths, known(x, y), strict=True)):
        if found is None:
            continue
        values = found * np.array(scale(path))[:, None]
        axes.plot(*values, **series_style(number), label=path.name or "computed")
        drawn = True
        for name in x, y:
            _draw_band(axes, path, (x, y), name, scale(path), number)
    if not drawn:
        absent = next((name for name in (x, y) if all(one is None for one in known(name))), y)
        annotate_empty(axes, f"no {absent.replace('_', ' ')}")
        return False
    set_log_axes(axes, [name for name, log in zip("xy", logs, strict=True) if log])
    return True


def _draw_band(axes, path, names, name, scale, number):
    """Estimated relative error of column `name`, one of the two `names` drawn, on both sides of the curve.

    An error of 1 is of a number that does not converge: no band there.
    """
    of, error = _ERRORS.get(name, (name, f"{name}_error"))
    of = of if of in path.columns else name
    if any(column not in path.columns for column in (*names, of, error)):
        return
    x, y, size, share = (np.asarray(path.columns[column], float) for column in (*names, of, error))
    across, sideways = names.index(name), name == names[0]
    x, y, half = x * scale[0], y * scale[1], size * share * scale[across]
    known = np.isfinite([x, y, half]).all(axis=0) & (half > 0) & (share < 1)
    if axes.lines[-1].get_xdata().min() > 0 and axes.lines[-1].get_ydata().min() > 0:
        known &= (x > 0) & (y > 0)
    if not (known[1:] & known[:-1]).any():
        return
    along, middle = (y, x) if sideways else (x, y)
    fill = axes.fill_betweenx if sideways else axes.fill_between
    label = None if axes.collections else "estimated error"
    fill(
        along,
        middle - half,
        middle + half,
        where=known,
        color=series_style(number)["color"],
        label=label,
        **_BAND,
    )


def _draw_analytic(axes, paths, x, y, per_mm=1.0):
    """The analytic solutions of smooth bodies, where they are known, beside the computed ones."""
    label = "analytic"
    for path in paths:
        found = path.positive(f"analytic_{x}", f"analytic_{y}")
        if found is not None:
            line = {"color": "0.3", "linestyle": DASHED, "zorder": 1, "label": label}
            axes.plot(found[0] * per_mm, found[1], **line)
            label = None  # once


_RELATIVE = "p / (E* h′rms)"


def _draw_shares(axes, paths, value):
    """Draw ``value(x, contact fraction)`` of paths and theories against x = p / (E* h'rms)."""
    drawn, cross = [], {"color": "0.4", "marker": "x", "linestyle": "none", "zorder": 1}
    for name in "contact_fraction", "contact_fraction_corrected":
        label = "corrected for the stepped boundary"
        for number, path in enumerate(paths):
            found = path.positive("mean_pressure", name)
            if found is None:
                continue
            x = found[0] * path.relative
            drawn.append(x)
            if name == "contact_fraction":
                axes.plot(x, value(x, found[1]), **series_style(number), label=path.name or "computed")
                with np.errstate(divide="ignore"):
                    one = value(np.asarray(path.columns["mean_pressure"], float) * path.relative, 1.0)
                _draw_band(axes, path, ("mean_pressure", name), name, (path.relative, one), number)
            else:
                axes.plot(x, value(x, found[1]), **cross, label=label)
                label = None  # once
    x = np.concatenate(drawn)
    set_log_axes(axes, "x")
    span = np.geomspace(x.min(), x.max() * 1.0001, 200)
    persson, bgt = persson_fraction(span), bush_gibson_thomas_fraction(span)
    axes.plot(span, value(span, persson), color="0.3", linestyle=DASHED, label="Persson")
    axes.plot(span, value(span, bgt), color="0.3", linestyle=DOTTED, label="Bush, Gibson, Thomas")
    axes.set_xlabel(_RELATIVE)


def _draw_fraction(axes, paths):
    _draw_shares(axes, paths, lambda x, share: share)
    axes.set_ylabel("contact fraction")
    set_log_axes(axes, "y")


def _draw_kappa(axes, paths):
    _draw_shares(axes, paths, lambda x, share: share / x)
    axes.set(ylabel="κ = contact fraction · E* h′rms / p", ylim=(0, None))
    axes.legend(**BESIDE)  # for the panel on the left, too


def _draw_gap(axes, paths):
    known = [path.positive("mean_pressure", "mean_gap") for path in paths]
    unit = choose_length_unit(max((found[1].max() for found in known if found is not None), default=1.0))
    # Exponential over much of the range: a straight line here.
    if _curves(
        axes, paths, "mean_gap", "mean_pressure", lambda path: (unit.per_mm, path.relative), (False, True)
    ):
        axes.set(xlabel=f"mean gap  [{unit.name}]", ylabel=_RELATIVE)


def _draw_stiffness_against(axes, paths, x, scale=lambda path: (1.0, 1.0)):
    """Each path's exact stiffness where it is known, else that by differences, which coarse steps make rough."""
    exact = [path.positive("load", "stiffness") is not None for path in paths]
    paths = [
        path if known else path._replace(columns=_by_differences(path.columns))
        for path, known in zip(paths, exact, strict=True)
    ]
    if not _curves(axes, paths, x, "stiffness", scale):
        return False
    others = [path.name for path, known in zip(paths, exact, strict=True) if not known]
    names = ", ".join(others) if len(others) < 4 else f"{len(others)} of {len(paths)} paths"
    of = f"\nby differences{f': {names}' if any(exact) else ''}" if others else ""
    axes.set(ylabel=f"{axis_label('stiffness')}{of}")
    return True


def _by_differences(columns):
    columns = {name: column for name, column in columns.items() if name != "stiffness"}
    if "stiffness_by_differences" in columns:
        columns["stiffness"] = columns["stiffness_by_differences"]
    return columns


def _draw_stiffness(axes, paths):
    if _draw_stiffness_against(axes, paths, "mean_pressure", lambda path: (path.relative, 1.0)):
        axes.set(xlabel=_RELATIVE)


def _draw_smooth_stiffness(axes, paths):
    if _draw_stiffness_against(axes, paths, "load"):
        axes.set(xlabel=axis_label("load"))
        _draw_analytic(axes, paths, "load", "stiffness")


def _draw_load(axes, paths):
    def values(x):
        known = [path.positive(x, "load", lowest=-np.inf) for path in paths]
        return np.concatenate([found[0] for found in known if found is not None] or [[1.0]])

    x, known, columns = "approach", values("approach"), [path.columns for path in paths]
    if known.min() < 0 and all("indentation" in one and "analytic_approach" not in one for one in columns):
        x, known = "indentation", values("indentation")
    unit = choose_length_unit(abs(known).max())
    log = known.min() >= 0  # an approach that is counted from within the roughness has no logarithm
    if _curves(axes, paths, x, "load", lambda path: (unit.per_mm, 1.0), (log, log)):
        axes.set(xlabel=axis_label(x).replace("mm", unit.name), ylabel=axis_label("load"))
        _draw_analytic(axes, paths, "approach", "load", unit.per_mm)


def _draw_against_load(name, axes, paths):
    if _curves(axes, paths, "load", name):
        axes.set(xlabel=axis_label("load"), ylabel=axis_label(name))
        _draw_analytic(axes, paths, "load", name)


_ROUGH = (_draw_fraction, _draw_kappa, _draw_gap, _draw_stiffness)
_SMOOTH = (
    _draw_load,
    partial(_draw_against_load, "max_pressure"),
    partial(_draw_against_load, "contact_area"),
    _draw_smooth_stiffness,
)


# -- tables --------------------------------------------------------------------------------------------


def read_csv(path):
    """Columns of a table written by app.sweep, or of a path, as lists of text.

    Raises
    ------
    InputError
        If it is no such table.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets mark it
            rows = list(csv.DictReader(file, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"table {path}: cannot be read: {error}") from None
    if not rows or None in rows[0] or any(None in row.values() for row in rows):
        raise InputError(f"table {path}: needed: a line of names and lines of as many values")
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    if "exit_status" not in columns and not {"load", "approach"} <= columns.keys():
        raise InputError(f"table {path}: neither a table of app.sweep nor a load path")
    if (
        "exit_status" not in columns
        and get_csv_path(columns).positive("load", "approach", lowest=-np.inf) is None
    ):
        raise InputError(f"table {path}: no step has numbers for load and approach")
    return columns


def parse_numbers(texts):
    """Values of a column, NaN for what is no number; of ``nx,ny`` the first."""

    def value(text):
        try:
            return option_table.number(text.strip().strip("()[]").split(",")[0])
        except ValueError:
            return np.nan

    return np.array([value(text) for text in texts])


def get_csv_path(columns, name=""):
    """Path of a table without ``exit_status``."""
    return _path({key: parse_numbers(texts) for key, texts in columns.items()}, name)
