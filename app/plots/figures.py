"""Figures of a result: maps, sections and history."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from app.base.quantities import label_of, unit_of
from app.base.units import choose_length_unit, choose_unit, round_to_cell
from app.halfspace.grid import plan_grids
from app.plots.maps import MAX_TICKS, Canvas, cell_edges, finite_pressure, format_number
from app.plots.stress import draw_section_stress
from app.plots.style import (
    BLUE,
    DASHED,
    ORANGE,
    PALE,
    annotate_empty,
    new_figure,
    new_panels,
    set_log_axes,
    with_style,
)

PROBLEMS = {
    "hertz": "Hertz contact",
    "sphere": "Sphere",
    "cylinder": "Cylinder",
    "roller": "Roller",
    "cone": "Cone",
    "punch": "Flat punch",
    "file": "Gap from file",
    "rough": "Rough surface",
    "given": "Contact problem",
}

MIN_RATIO = 1.0001  # of two values that are shown as different
_HIGH_SHARE = 0.9  # of the highest pressure, in cells of the sections
_MAX_RESIDUAL = 1e200  # axes overflow beyond
_PATH_OPTION = re.compile(r"-(\w+)_path\b")


def make_title(result, path=False):
    """Return the title of a figure.

    The title is the user's, or else it names problem, grid and load. If `path` is true, it has the range of loads.
    """
    ny, nx = result.pressure.shape
    values = result.attributes
    state = "" if values["converged"] else ", NOT CONVERGED"
    if values.get("title"):
        return f"{values['title']}{state}"
    problem = values.get("problem", "contact problem")
    command = str(values.get("command_line", ""))
    [*_, kind] = ["load", *(name for name in _PATH_OPTION.findall(command) if name in result.path)]
    if path and len(steps := result.path[kind]) > 1:
        unit = unit_of(kind).replace("2", "²")
        load = f"{len(steps)} steps, {label_of(kind)} from {_format_range(min(steps), max(steps), unit)}"
    else:
        load = f"load {_format_range(values['load'], values['load'], 'N')}"
    measured = [values[name] for name in ("surface_file", "surface_file2") if values.get(name)]
    surfaces = " and ".join(Path(str(file).partition(":/")[0]).name for file in measured)
    surfaces = surfaces.replace("(array)", "an array of heights")
    if problem == "rough":
        surfaces = f" {surfaces}".rstrip()
    else:
        surfaces = f" with {surfaces or 'a rough surface'}" if values.get("surfaces") else ""
    return f"{PROBLEMS.get(problem, problem)}{surfaces}, {nx} × {ny} cells, {load}{state}"


def _format_range(low, high, unit):
    factor, unit = choose_unit(abs(high), unit)
    ends = dict.fromkeys(format_number(end * factor) for end in (low, high))
    return f"{' to '.join(ends)} {unit}"


def _map_figure(result, draw, *arguments):
    canvas = Canvas(result, zoom=True, lie=True)
    figure = new_figure(*canvas.size, make_title(result))
    draw(canvas, figure.subplots(), *arguments)
    return figure


@with_style
def contact_figure(result):
    """Draw a map of contact spots and cells where contact is impossible."""
    return _map_figure(result, Canvas.draw_contact)


@with_style
def pressure_figure(result, reference=None):
    """Draw a map of the pressure, with the ellipse of a `reference`."""
    return _map_figure(result, Canvas.draw_pressure, reference)


@with_style
def deformation_figure(result):
    """Draw maps of displacement u and gap e."""
    canvas = Canvas(result, lie=True)
    figure, (first, second) = new_panels([canvas.size] * 2, 2, make_title(result))
    canvas.draw_displacement(first)
    canvas.draw_gap(second)
    return figure


@with_style
def section_figure(result, reference=None):
    """Draw pressure and gap along x and y at the `section_place`.

    If there is a `reference` solution, its pressure is drawn instead of the gap.
    """
    figure, panels = new_panels([(7.4, 3.6)] * 2, title=make_title(result))
    for axes, along in zip(panels, "xy", strict=True):
        draw_section(axes, result, along, *section_place(result), reference)
    return figure


@with_style
def history_figure(result):
    """Draw each iteration's residual, contact cells and changed cells."""
    figure, (upper, lower) = new_panels([(7.0, 3.3)] * 2, title=make_title(result))
    draw_residual(upper, result)
    _draw_cells(lower, result)
    upper.set_xlabel("")
    return figure


@with_style
def summary_figure(result, reference=None, with_stress=True):
    """Draw contact area, pressure, a section along x, and a fourth panel.

    The fourth panel is the stress below the section. If the contact is long in y, Poisson's ratio is unknown, or
    `with_stress` is false, it is the section along y.
    """
    canvas = Canvas(result, zoom=True, lie=True)
    width, height = canvas.size
    sizes = [(max(width, 6.5), size) for size in (height, height, 4.2, 4.2)]
    figure, (contact, pressure, section, last) = new_panels(sizes, 2, make_title(result))
    canvas.draw_contact(contact)
    canvas.draw_pressure(pressure, reference)
    place = section_place(result)
    ends = draw_section(section, result, "x", *place, reference)
    if canvas.lies or not (with_stress and draw_section_stress(last, result, "x", *place, ends)):
        draw_section(last, result, "y", *place, reference)
    return figure


def section_place(result):
    """Return the row and the column of the sections along x and along y.

    Both contain pressures near the highest one. Of these rows and columns they are next to the middle, so that they
    cross a ring, and do not follow its rim.
    """
    pressure = finite_pressure(result.pressure)
    cells = np.argwhere(pressure >= _HIGH_SHARE * pressure.max())
    apart = np.abs(cells - cells.mean(axis=0))
    return tuple(int(cells[k, axis]) for axis, k in enumerate(apart.argmin(axis=0)))


def draw_section(axes, result, along, row, column, reference):
    """Draw the pressure along a row or column.

    With a `reference` solution its pressure is drawn, too, otherwise the gap. Return the ends of the axis [mm].
    """
    unit = choose_length_unit(max(np.ptp(result.x), np.ptp(result.y)))
    if along == "x":
        line, across = row, f"y = {round_to_cell(result.y[row], 100 * result.grid.dy) * unit.per_mm:.8g}"
    else:
        line, at = (slice(None), column), round_to_cell(result.x[column], 100 * result.grid.dx)
        across = f"x = {at * unit.per_mm:.8g}"
    values, gap = result.pressure[line], np.where(result.contact[line], 0.0, result.gap[line])
    sides = cell_edges(result.grid, along) * unit.per_mm
    axes.stairs(values, sides, fill=True, color=PALE)
    axes.stairs(values, sides, color=BLUE, linewidth=1.4, label="computed", baseline=None)
    # Show the part of the patch that is in contact in any section.
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
    axes.ticklabel_format(style="plain", useOffset=False, axis="x")
    axes.locator_params(axis="x", nbins=MAX_TICKS)
    axes.set(
        xlim=ends, xlabel=f"{along}  [{unit.name}]   at {across} {unit.name}", ylabel="pressure p  [N/mm²]"
    )
    # Leave room for the legend; without pressure there is no scale.
    highest = max(1.1 * finite_pressure(values).max(), 1.35 * exact.max(initial=0.0))
    axes.set_ylim(0, highest or 1.0)
    if not highest:
        axes.set_yticks([0])
    if reference is None:
        _draw_gap(axes, sides, gap, ends)
    return tuple(end / unit.per_mm for end in ends)


def _draw_gap(axes, sides, gap, ends):
    """Draw the gap in a section, on an axis that points down."""
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
    """Draw the residual of each active set iteration."""
    residual = result.history["residual"]
    residual = np.where((residual >= 0) & (residual < _MAX_RESIDUAL), residual, np.nan)
    iterations = np.arange(1, residual.size + 1)
    axes.set(xlabel="active set iteration", ylabel="residual  ‖r‖ / ‖h‖")
    if not iterations.size:
        annotate_empty(axes, "no iterations")
        return
    _mark_grids(axes, result, label=True)
    tolerance = result.attributes.get("lcp_rtol", 0)
    # Direct solves on the coarsest grid reach rounding error, far below the tolerance.
    lowest = 1e-3 * tolerance
    shown = np.maximum(residual, lowest)
    for part in _find_grids(result.history["level"]):
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
    for part in _find_grids(result.history["level"]):
        labels = ("in contact", "changed") if part.stop == cells.size else (None, None)
        axes.plot(iterations[part], cells[part], "o-", color=BLUE, label=labels[0])
        axes.plot(iterations[part], changed[part], "s--", color=ORANGE, label=labels[1])
    axes.set_yscale("symlog", linthresh=1)
    axes.set(xlabel="active set iteration", ylabel="cells", ylim=(-0.3, 20 * max(1, cells.max(initial=1))))
    if cells.size:
        axes.legend(loc="upper left", ncol=2)


def _find_grids(level):
    """Return, for each grid, the slice of the history on this grid.

    `level` has the number of the grid for each entry of the history.
    """
    cuts = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), level.size]
    return [slice(first, last) for first, last in pairwise(cuts) if last > first]


def _mark_grids(axes, result, label=False):
    """Shade the iterations on every other grid; if `label`, label all grids."""
    level = result.history["level"]
    parts = _find_grids(level)
    axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))
    axes.set_xlim(0.5, max(level.size, 2) + 0.5)
    if len(parts) < 2:
        return
    for part in parts[-2::-2]:
        axes.axvspan(part.start + 0.5, part.stop + 0.5, color="0.94", linewidth=0, zorder=0)
    if label:
        coarsest = re.findall(r"-lcp_coarsest (\d+)", result.attributes["options"])
        grids = plan_grids(result.grid, *map(int, coarsest))
        coarsenings = [min(abs(int(level[-1] - level[part.start])), len(grids) - 1) for part in parts]
        above = axes.secondary_xaxis("top")
        above.set_xticks(
            [(part.start + part.stop + 1) / 2 for part in parts],
            [f"{grids[k].nx} × {grids[k].ny}" for k in coarsenings],
            rotation=40, ha="left", rotation_mode="anchor", fontsize="small",
        )  # fmt: skip
        above.tick_params(length=0)
        above.spines["top"].set_visible(False)
