"""Pictures and small tables of solutions and other objects, for notebooks."""

import base64
import html
import io

import numpy as np
from matplotlib.axes import Axes
from tabulate import tabulate

from app.api.subsurface import survey
from app.api.summary import remark, summary
from app.base.errors import InputError, check_type
from app.base.quantities import ESTIMATED, label_of, unit_of
from app.base.units import format_lengths, format_quantity
from app.io.contact_fields import PATCH_UNITS
from app.io.result import FIELDS, PLASTIC_FIELDS, Result
from app.plots import figures, heights, load_curves, pictures, style
from app.plots.stress import stress_figure

_ROWS = *ESTIMATED, "contact_fraction"
_PERIODIC_ROWS = "mean_pressure", "mean_gap"
_DPI = 60  # of pictures in tables
_MAX_ROWS = 12  # of a table


def as_result(solution):
    """Return a solution as a `Result`; InputError if rows are missing."""
    if isinstance(solution, Result):
        return solution
    if solution.pressure.shape != solution.grid.shape:
        raise InputError("solution: has the rows of one rank; use solution.gather() on one rank")
    names = *FIELDS, *PLASTIC_FIELDS, "x", "y"
    return Result(
        **{name: getattr(solution, name) for name in names},
        attributes=solution.attributes | solution.count_patches(),
        history={name: np.asarray(column) for name, column in solution.history.items()},
        extra=solution.extra,
    )


def summarize(solution):
    """Return the text that app.solve prints on a solution."""
    facts = solution.attributes
    facts = facts if "contact_patches" in facts else facts | solution.count_patches()
    return summary(facts, solution.grid, fields=solution.extra)


def plot_solution(solution, name=None, axes=None):
    """Draw a picture of a solution; see `app.plots.pictures.plot`."""
    default = "summary" if axes is None else "pressure"
    return pictures.plot(as_result(solution), name or default, axes)


def _path_figure(path):
    columns = {name: np.asarray(column, float) for name, column in path.table.items()}
    heading = f"{len(path.rows)} steps" + " of a load path" * (not path.coordinates)
    return load_curves.path_figure([load_curves.make_path(columns, "")], heading)


def plot_path(path):
    """Draw the curves of a load path."""
    return pictures.show(lambda: _path_figure(path), "path")


def plot_surface(surface, axes=None):
    """Draw heights, profiles, distribution and spectrum of a surface.

    On given axes only the heights are drawn.
    """
    if axes is not None:
        check_type("ax", axes, Axes, "axes of matplotlib")
        heights.draw_heights(axes, surface)
        return pictures.on_axes(axes)
    return pictures.show(lambda: heights.surface_figure(surface), "surface")


def plot_stress(below):
    """Draw the stress on vertical sections and a line.

    Sections and line contain the point of the largest von Mises stress.
    """
    grid = below.grid
    heading = f"Stress below {grid.nx} × {grid.ny} cells, {below.describe('ν')}"
    return pictures.show(lambda: stress_figure(grid, survey(below), heading), "stress")


def _as_html(heading, table, figure=None, lines=()):
    """Return HTML of a heading, a table, notes (`lines`), and a picture."""
    parts = [f"<b>{html.escape(heading)}</b>", table]
    parts += [f"<p style='margin:2px'>note: {html.escape(line)}</p>" for line in lines]
    text = f"<div style='max-width:36em'>{''.join(parts)}</div>"
    if figure is None:
        return text
    png = io.BytesIO()
    style.write_figure(figure, png, "png", _DPI)
    code = base64.b64encode(png.getvalue()).decode()
    picture = f"<img alt='{html.escape(heading)}' src='data:image/png;base64,{code}'>"
    return f"<div style='display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start'>{text}{picture}</div>"


def _quantities_table(solution, names):
    values = [(name, getattr(solution, name)) for name in names]
    rows = [
        (label_of(name), format_quantity(value, unit_of(name)) + remark(solution.attributes, name))
        for name, value in values
        if value == value
    ]
    rows += [
        ("proved error bound", f"{solution.error_bound:.2g}"),
        ("converged", "yes" if solution.converged else "NO"),
    ]
    return tabulate(rows, tablefmt="html", disable_numparse=True)


def _rows_table(columns):
    """Return an HTML table, shortened in its middle."""
    shown = {label: [*map(str, column)] for label, column in columns.items()}
    rows = [*zip(*shown.values(), strict=True)]
    if len(rows) > _MAX_ROWS:
        rows[_MAX_ROWS // 2 : -_MAX_ROWS // 2] = [("...",) * len(shown)]
    return tabulate(rows, [*shown], tablefmt="html", disable_numparse=True, stralign="right")


def _four_digits(values):
    """Format numbers with four digits, large ones with more."""
    return [f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}" for value in values]


def _format_columns(columns, names):
    """Return columns as texts of four digits, by their labels with units."""
    units = {name: unit_of(name) for name in names}
    labels = {name: label_of(name) + (f" [{unit}]" if unit != "1" else "") for name, unit in units.items()}
    return {labels[name]: _four_digits(columns[name]) for name in names}


def _pressure_picture(solution):
    """Return the figure of the pressure; None if rows are missing here."""
    whole = solution.pressure.shape == solution.grid.shape
    return figures.pressure_figure(as_result(solution)) if whole else None


def solution_html(solution):
    """Return HTML with a solution's numbers, notes and pressure."""
    grid = solution.grid
    names = (*_ROWS, *_PERIODIC_ROWS) if grid.doubly_periodic else _ROWS
    return _as_html(
        f"{type(solution).__name__}, {grid.nx} x {grid.ny} cells",
        _quantities_table(solution, names),
        _pressure_picture(solution),
        solution.notes,
    )


def path_html(path):
    """Return HTML with the table of a load path and its curves."""
    heading = f"Load path, {len(path.rows)} of {len(path)} steps done"
    if not path.rows:
        return _as_html(heading + ": call list(path) to solve them", "")
    columns = path.table
    table = _rows_table(_format_columns(columns, _ROWS) | {"converged": columns["converged"]})
    return _as_html(heading, table, _path_figure(path) if len(path.rows) > 1 else None)


def many_html(many):
    """Return HTML with the table of many problems."""
    table = {"problem": many["problem"]} | _format_columns(many.table, ESTIMATED)
    return _as_html(f"{len(many)} solutions", _rows_table(table | {"converged": many["converged"]}))


def refinement_html(refined):
    """Return HTML with the grids of a refinement and the finest pressure."""
    solution = refined.solution
    columns = {name: [row[name] for row in refined.rows] for name in refined.rows[0]}
    table = {"cells": [f"{nx}\u00a0x\u00a0{ny}" for nx, ny in zip(columns["nx"], columns["ny"], strict=True)]}
    table |= _format_columns(columns, ESTIMATED)
    largest = [max(row[f"{name}_error"] for name in ESTIMATED) for row in refined.rows]
    table["largest error"] = [f"{100 * error:.2g}%" for error in largest]
    state = "reached" if refined.reached else "NOT reached"
    return _as_html(
        f"Refinement, {len(refined.rows)} grids, {state}",
        _rows_table(table),
        _pressure_picture(solution),
        solution.notes,
    )


def surface_html(surface):
    """Return HTML with a surface's numbers and picture."""
    ny, nx = surface.shape
    rows = [("file", surface.file)] if surface.file != "(array)" else []
    rows += [("points", f"{nx} x {ny}"), ("level", surface.level)]
    if surface.spacing:
        rows.append(("cell", format_lengths(*surface.spacing, digits=4)))
        rows.append(("rms slope", f"{surface.rms_slope():.3g}"))
    rows += [
        ("rms height", format_quantity(surface.rms_level, "mm")),
        ("missing points", surface.missing_points),
    ]
    table = tabulate(rows, tablefmt="html", disable_numparse=True)
    figure = heights.heights_figure(surface) if surface.spacing else None
    return _as_html("Surface", table, figure, surface.notes)


def patches_html(patches):
    """Return HTML with contact spots: table and map."""
    columns = {"spot": [*range(1, len(patches.cells) + 1)], "cells": patches.cells}
    for name, unit in PATCH_UNITS.items():
        columns[f"{name.replace('_', ' ')} [{unit}]"] = _four_digits(getattr(patches, name))
    whole = patches.grid is not None and patches.labels.shape == patches.grid.shape
    figure = pictures.spots_figure(patches) if whole else None
    count = len(patches.cells)
    return _as_html(f"{count} contact spot{'s'[: count != 1]}", _rows_table(columns), figure)
