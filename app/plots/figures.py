"""Pictures of a result. Each function returns a `matplotlib.figure.Figure` of its own.

Lengths stand in a unit that suits them, pressures in N/mm2. Not collective: call on one rank.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from app.base.units import choose_length_unit
from app.halfspace.grid import plan_grids
from app.plots.maps import LENGTH_MAP, Canvas, cell_edges, draw_map, finite_pressure
from app.plots.style import (
    BLUE,
    DASHED,
    ORANGE,
    PALE,
    annotate_empty,
    new_figure,
    set_log_axes,
    with_style,
)

PROBLEMS = {
    "hertz": "Hertz contact",
    "sphere": "Sphere",
    "cylinder": "Cylinder",
    "cone": "Cone",
    "punch": "Flat punch",
    "file": "Gap from file",
    "rough": "Rough surface",
    "given": "Contact problem",
}

EVEN_VALUES = 1.0001  # largest over smallest: what lies closer is one number, to the digits shown
_ASTRAY = 1e200  # residuals from here on are not drawn: axes compute with larger numbers


_PRESCRIBED = {
    "load": ("loads", "N"),
    "mean_pressure": ("mean pressures", "N/mm²"),
    "approach": ("approaches", "mm"),
    "mean_gap": ("mean gaps", "mm"),
}


def make_title(result, path=False):
    """Problem, grid and load in a line, or all that is prescribed along its path."""
    ny, nx = result.pressure.shape
    values = result.attributes
    problem = values.get("problem", "contact problem")
    state = "" if values["converged"] else ", NOT CONVERGED"
    load = f"load {format_load(values['load'])} N"
    said = str(values.get("command_line", ""))
    kind = max(_PRESCRIBED, key=lambda name: said.rfind(f"-{name}_path"))  # of none, or from Python: loads
    if path and len(steps := result.path[kind]) > 1:
        what, unit = _PRESCRIBED[kind]
        load = f"{len(steps)} {what} from {format_load(min(steps))} to {format_load(max(steps))} {unit}"
    return f"{PROBLEMS.get(problem, problem)}{_surfaces(values)}, {nx} × {ny} cells, {load}{state}"


def _surfaces(values):
    """What is rough on the body: files of measured surfaces, or that there is a surface at all."""
    said = [values[name] for name in ("surface_file", "surface_file2") if values.get(name)]
    files = " and ".join(Path(str(file).partition(":/")[0]).name for file in said)
    if values.get("problem") == "rough":
        return f" {files}".rstrip()
    return f" with {files or 'a rough surface'}" if values.get("surfaces") else ""


def format_load(value):
    """A load as one says it."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"


@with_style
def contact_figure(result):
    """Contact area, its patches told apart, and the inadmissible cells if there are any."""
    return _titled(draw_map(result, Canvas.contact), result)


@with_style
def pressure_figure(result):
    """Map of the pressure; no colour where it is zero."""
    return _titled(draw_map(result, Canvas.pressure), result)


@with_style
def deformation_figure(result):
    """Maps of the normal displacement u and of the gap e; the gap has no colour in the contact area."""
    canvas = Canvas(result)
    width, height = canvas.size
    beside = canvas.height > canvas.width
    figure = new_figure(2 * canvas.width + 6.0, height) if beside else new_figure(width, 2 * height - 0.4)
    first, second = figure.subplots(*(1, 2) if beside else (2, 1))
    canvas.length(first, result.displacement, LENGTH_MAP, "displacement u  [{}]")
    gap = np.where(result.contact == 1, np.nan, result.gap)
    canvas.length(second, gap, LENGTH_MAP + "_r", "gap e  [{}]  (white: contact)")
    return _titled(figure, result)


@with_style
def section_figure(result, reference=None):
    """Pressure and gap along x and along y through `hottest_cell`.

    Parameters
    ----------
    result : Result
    reference : app.reference.hertz.EllipticHertz, optional
        Its pressure is drawn over the computed one.
    """
    figure = new_figure(7.4, 7.2)
    row, column = hottest_cell(result)
    for axes, along in zip(figure.subplots(2, 1), "xy", strict=True):
        draw_section(axes, result, along, row, column, reference)
    return _titled(figure, result)


@with_style
def history_figure(result):
    """Residual, contact cells and changed cells of every active set iteration, with the grids they belong to."""
    figure = new_figure(7.0, 6.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    draw_residual(upper, result)
    _draw_cells(lower, result)
    upper.set_xlabel("")
    return _titled(figure, result)


@with_style
def summary_figure(result, reference=None):
    """Contact area, pressure, section along x and residual history on one page."""
    canvas = Canvas(result)
    width, height = canvas.size
    figure = new_figure(max(2 * width, 13.0), height + 4.2)
    panels = figure.subplots(2, 2, gridspec_kw={"height_ratios": [height - 0.4, 4.2]})
    canvas.contact(panels[0, 0])
    canvas.pressure(panels[0, 1])
    draw_section(panels[1, 0], result, "x", *hottest_cell(result), reference)
    draw_residual(panels[1, 1], result)
    return _titled(figure, result)


def _titled(figure, result):
    figure.suptitle(make_title(result))
    return figure


def hottest_cell(result):
    """Row and column of the cell the sections go through: of those that carry most, to rounding, the middle one."""
    pressure = finite_pressure(result.pressure)
    cells = np.argwhere(pressure >= pressure.max() / EVEN_VALUES)
    return tuple(map(int, cells[np.sum((cells - cells.mean(axis=0)) ** 2, axis=1).argmin()]))


def draw_section(axes, result, along, row, column, reference):
    """Pressure, and over it the gap on a scale of its own."""
    unit = choose_length_unit(max(np.ptp(result.x), np.ptp(result.y)))
    if along == "x":
        across, here = f"y = {result.y[row] * unit.per_mm:.3g}", row
    else:
        across, here = f"x = {result.x[column] * unit.per_mm:.3g}", (slice(None), column)
    values, gap = result.pressure[here], np.where(result.contact[here] == 1, 0.0, result.gap[here])
    sides = cell_edges(result.grid, along) * unit.per_mm
    axes.stairs(values, sides, fill=True, color=PALE)
    axes.stairs(values, sides, color=BLUE, linewidth=1.4, label="computed", baseline=None)
    # Not the whole patch but where the bodies touch, in this section or beside it.
    touching = np.flatnonzero(result.contact.any(axis=0 if along == "x" else 1))
    ends = (sides[touching[0]], sides[touching[-1] + 1]) if touching.size else (sides[0], sides[-1])
    margin = 0.15 * (ends[1] - ends[0])
    ends = max(sides[0], ends[0] - margin), min(sides[-1], ends[1] + margin)
    exact = np.zeros(0)
    if reference is not None:
        s = np.linspace(*ends, 1001)
        mm = s / unit.per_mm
        x, y = (mm, result.y[row]) if along == "x" else (result.x[column], mm)
        exact = reference.pressure(x, y)
        axes.plot(s, exact, color=ORANGE, linestyle=DASHED, label="Hertz")
        axes.legend(loc="upper right")
    across = across.replace("-", "−")
    axes.set(
        xlim=ends, xlabel=f"{along}  [{unit.name}]   at {across} {unit.name}", ylabel="pressure p  [N/mm²]"
    )
    # Room for the legend above what is drawn; without pressure there is no scale.
    highest = max(1.1 * finite_pressure(values).max(), 1.35 * exact.max(initial=0.0))
    axes.set_ylim(0, highest or 1.0)
    if not highest:
        axes.set_yticks([0])
    if reference is None:
        _draw_gap(axes, sides, gap, ends)


def _draw_gap(axes, sides, gap, ends):
    """The gap from above, so that it does not cross the pressure."""
    shown = gap[(sides[1:] > ends[0]) & (sides[:-1] < ends[1])]
    highest = float(np.nanmax(shown, initial=0.0))
    if not 0 < highest < np.inf:
        return
    unit, right = choose_length_unit(highest), axes.twinx()
    right.stairs(gap * unit.per_mm, sides, color=ORANGE, linewidth=1.0, baseline=None)
    right.set(ylim=(2.6 * highest * unit.per_mm, 0))
    right.set_ylabel(f"gap e  [{unit.name}]", color=ORANGE, loc="top")
    right.spines["right"].set_visible(True)
    right.set_yticks([t for t in right.get_yticks() if 0 <= t <= 1.05 * highest * unit.per_mm])
    ticks, top = axes.get_yticks(), axes.get_ylim()[1]
    axes.set_yticks(ticks[ticks <= top])
    axes.set_ylim(0, 1.45 * top)


def draw_residual(axes, result):
    """Residual of every active set iteration."""
    residual = result.history["residual"]
    residual = np.where((residual >= 0) & (residual < _ASTRAY), residual, np.nan)
    iterations = np.arange(1, residual.size + 1)
    axes.set(xlabel="active set iteration", ylabel="residual  ‖r‖ / ‖h‖")
    if not iterations.size:
        annotate_empty(axes, "no iterations")
        return
    _mark_grids(axes, result, label=True)
    tolerance = result.attributes.get("lcp_rtol", 0)
    # Direct solves on the coarsest grid go down to round-off; that is not what the picture is about.
    lowest = 1e-3 * tolerance
    shown = np.maximum(residual, lowest)
    for first, last in _runs(result.history["level"]):
        part = slice(first, last)
        axes.plot(iterations[part], shown[part], "o-", color=BLUE)
    below = residual < lowest
    if below.any():
        style = {"color": BLUE, "markersize": 9, "label": "lower, to round-off"}
        axes.plot(iterations[below], shown[below], "v", **style)
    if tolerance:
        axes.axhline(tolerance, color=ORANGE, linestyle=DASHED, label="tolerance")
        axes.legend(loc="best")
    set_log_axes(axes, "y")


def _draw_cells(axes, result):
    cells, changed = result.history["contact_cells"], result.history["changed_cells"]
    iterations = np.arange(1, cells.size + 1)
    _mark_grids(axes, result)
    for first, last in _runs(result.history["level"]):
        part = slice(first, last)
        end = last == cells.size
        axes.plot(iterations[part], cells[part], "o-", color=BLUE, label="in contact" if end else None)
        axes.plot(iterations[part], changed[part], "s--", color=ORANGE, label="changed" if end else None)
    axes.set_yscale("symlog", linthresh=1)
    axes.set(xlabel="active set iteration", ylabel="cells", ylim=(-0.3, 20 * max(1, cells.max(initial=1))))
    if cells.size:
        axes.legend(loc="upper left", ncol=2)


def _runs(level):
    """Return first and last (exclusive) entry of each stretch of the history on one grid."""
    cuts = [0, *(np.flatnonzero(np.diff(level)) + 1), level.size]
    return [(int(a), int(b)) for a, b in pairwise(cuts) if b > a]


def _mark_grids(axes, result, label=False):
    """Shade every other grid of a nested iteration, and name the grids above the axes."""
    level = result.history["level"]
    runs = _runs(level)
    axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))
    axes.set_xlim(0.5, max(level.size, 2) + 0.5)
    if len(runs) < 2:
        return
    for first, last in runs[-2::-2]:
        axes.axvspan(first + 0.5, last + 0.5, color="0.94", linewidth=0, zorder=0)
    if label:
        above = axes.secondary_xaxis("top")
        above.set_xticks(
            [(first + last + 1) / 2 for first, last in runs],
            [_grid_name(result, abs(int(level[-1] - level[first]))) for first, _ in runs],
            rotation=40,
            ha="left",
            rotation_mode="anchor",
            fontsize=11,
        )
        above.tick_params(length=0)
        above.spines["top"].set_visible(False)


def _grid_name(result, coarsenings):
    """Cells of the grid so many levels below the target grid."""
    said = re.findall(r"-lcp_coarsest (\d+)", result.attributes["options"])
    grids = plan_grids(result.grid, *map(int, said))
    grid = grids[min(coarsenings, len(grids) - 1)]
    return f"{grid.nx} × {grid.ny}"
