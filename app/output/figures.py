"""Pictures of a result, in one style.

Each function takes a `Result` and returns a `matplotlib.figure.Figure` of its own; nothing here touches
pyplot, so that pictures need no display and do not pile up. Lengths are mm, pressures N/mm2. White means
zero (no pressure, or no gap), grey means that contact is impossible.

Not collective: call on one rank.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from itertools import pairwise
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from app.halfspace.grid import Grid
from app.output.files import whole_file

BLUE, ORANGE, GREY, PALE = "#0072b2", "#d55e00", "#c8c8c8", "#cfe3f1"  # told apart by colour-blind readers
PRESSURE_MAP, LENGTH_MAP = "viridis", "cividis"
MOST_PIXELS = 1024  # longer sides of an image are averaged down to this
STYLE = {
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
    "font.family": "DejaVu Sans",
    "font.size": 13,
    "axes.titlesize": 13,
    "figure.titlesize": 14,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 12,
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "svg.hashsalt": "contact",  # the same picture is the same file
}
PROBLEMS = {
    "hertz": "Hertz contact",
    "punch": "Rough flat punch",
    "file": "Gap from file",
    "rough": "Self-affine surface",
}


class Reference(NamedTuple):
    """An analytic pressure to compare with: ``pressure(x, y)`` [N/mm2] of arrays [mm], and its name."""

    pressure: Callable
    label: str


def _styled(draw):
    @wraps(draw)
    def styled(*args, **kwargs):
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


@_styled
def contact_figure(result):
    """Contact area, and the inadmissible cells if there are any."""
    figure, axes = _map_figure(result)
    _draw_contact(axes, result)
    return figure


@_styled
def pressure_figure(result):
    """Map of the pressure; no colour where it is zero."""
    figure, axes = _map_figure(result)
    _draw_pressure(axes, result)
    return figure


@_styled
def deformation_figure(result):
    """Maps of the normal displacement u and of the gap e; the gap has no colour in the contact area."""
    width, height = _map_size(result)
    figure = _figure(result, (width, 2 * height - 0.4))
    upper, lower = figure.subplots(2, 1)
    _draw_map(upper, result, result.displacement, LENGTH_MAP, "displacement u  [mm]")
    gap = np.where(result.contact == 1, np.nan, result.gap)
    _draw_map(lower, result, gap, LENGTH_MAP + "_r", "gap e  [mm]   (white: contact)")
    return figure


@_styled
def section_figure(result, reference=None, at=None):
    """Pressure along x and along y through one point.

    Parameters
    ----------
    result : Result
    reference : Reference, optional
        Drawn over the computed pressure.
    at : (float, float), optional
        The point (x, y) [mm], moved to the nearest cell centre; default: the row and the column that
        carry most, or the middle of the patch if there is no pressure.
    """
    figure = _figure(result, (7.0, 7.2))
    row, column = _cell(result, at)
    for axes, along in zip(figure.subplots(2, 1), "xy", strict=True):
        _draw_section(axes, result, along, row, column, reference)
    return figure


@_styled
def history_figure(result):
    """Residual, contact cells and changed cells of every active set iteration, with the grids they belong to."""
    figure = _figure(result, (7.0, 6.6))
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_residual(upper, result)
    _draw_cells(lower, result)
    upper.set_xlabel("")
    return figure


@_styled
def summary_figure(result, reference=None):
    """Contact area, pressure, section along x and residual history on one page."""
    figure = _figure(result, (13.0, 2 * _map_size(result)[1] - 0.4))
    panels = figure.subplots(2, 2)
    _draw_contact(panels[0, 0], result)
    _draw_pressure(panels[0, 1], result)
    _draw_section(panels[1, 0], result, "x", *_cell(result), reference)
    _draw_residual(panels[1, 1], result)
    return figure


@_styled
def save_figure(figure, path, dpi=200):
    """Write a figure; the suffix of `path` chooses the format. The file appears whole or not at all."""
    kind = path.suffix.lstrip(".")
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(kind)
    with whole_file(path) as temporary:
        figure.savefig(
            temporary, format=kind, dpi=dpi, metadata=undated, bbox_inches="tight", pad_inches=0.08
        )


def block_mean(field, most):
    """Average blocks of b x b cells, with the smallest b that leaves at most `most` cells per side.

    NaN cells do not count; a block of nothing else is NaN.

    Returns
    -------
    ndarray
        The averages; blocks at the upper ends may hold fewer cells.
    int
        b
    """
    b = -(-max(field.shape) // most)
    if b == 1:
        return field, 1
    valid = ~np.isnan(field)

    def total(values):
        for axis, n in enumerate(field.shape):
            values = np.add.reduceat(values, np.arange(0, n, b), axis=axis)
        return values

    with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN that is wanted
        return total(np.where(valid, field, 0.0)) / total(valid.astype(int)), b


def title(result):
    """Problem, grid and load in a line."""
    ny, nx = result.pressure.shape
    values = result.attributes
    problem = values.get("problem", "contact problem")
    load = values["load"]
    number = f"{load:.0f}" if 1e3 <= abs(load) < 1e7 else f"{load:.4g}"
    state = "" if values["converged"] else ", NOT CONVERGED"
    return f"{PROBLEMS.get(problem, problem)}, {nx} × {ny} cells, load {number} N{state}"


def _figure(result, size):
    figure = Figure(figsize=size)
    FigureCanvasAgg(figure)
    figure.suptitle(title(result))
    return figure


def _map_figure(result):
    figure = _figure(result, _map_size(result))
    return figure, figure.subplots()


def _map_size(result):
    """Width and height [inch] of a picture of the patch with its labels."""
    x0, x1, y0, y1 = _extent(result)
    return 7.0, float(np.clip(5.1 * (y1 - y0) / (x1 - x0) + 1.3, 3.0, 8.0))


def _extent(result):
    """Return x0, x1, y0, y1 of the patch [mm]."""
    ends = []
    for centres in (result.x, result.y):
        half = _spacing(centres) / 2
        ends += [centres[0] - half, centres[-1] + half]
    return ends


def _spacing(centres):
    return (centres[-1] - centres[0]) / (centres.size - 1) if centres.size > 1 else 1.0


def _finite(pressure):
    """Pressures with those of a diverged run, and negative ones, set to zero."""
    return np.where(np.isfinite(pressure) & (pressure > 0), pressure, 0.0)


def _inadmissible(result):
    return np.isnan(result.undeformed_distance)


def _image(axes, result, field, colours, hide_zero=False, **limits):
    """Draw a field, NaN (and zero) transparent, in mm."""
    pixels, b = block_mean(field, MOST_PIXELS)
    if hide_zero:
        pixels = np.where(pixels == 0, np.nan, pixels)
    x0, x1, y0, y1 = _extent(result)
    right = x0 + pixels.shape[1] * b * _spacing(result.x)
    top = y0 + pixels.shape[0] * b * _spacing(result.y)
    image = axes.imshow(
        pixels, cmap=colours, origin="lower", extent=(x0, right, y0, top), interpolation="nearest", **limits
    )
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x  [mm]", ylabel="y  [mm]", aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    for spine in axes.spines.values():
        spine.set_visible(True)
    return image


def _draw_background(axes, result):
    """Grey for the inadmissible cells. Return whether there are any."""
    outside = _inadmissible(result)
    if outside.any():
        _image(axes, result, np.where(outside, 1.0, np.nan), ListedColormap([GREY]))
    return bool(outside.any())


def _draw_contact(axes, result):
    has_outside = _draw_background(axes, result)
    contact = np.where(_inadmissible(result), np.nan, result.contact)
    fading = LinearSegmentedColormap.from_list("contact", ["white", BLUE])
    _image(axes, result, contact, fading, vmin=0, vmax=1)
    possible = int(np.count_nonzero(~_inadmissible(result)))
    share = result.attributes["contact_fraction"]
    entries = [Patch(color=BLUE, label=f"contact: {share:.1%} of {possible} cells")]
    if has_outside:
        entries.append(Patch(color=GREY, label="no contact possible"))
    axes.legend(handles=entries, loc="lower left", bbox_to_anchor=(0, 1), ncol=2, borderaxespad=0.2)


def _draw_pressure(axes, result):
    pressure = _finite(result.pressure)
    highest = float(pressure.max()) or 1.0
    extend = "neither"
    if pressure.any():
        # Singular pressure on a few cells at an edge must not leave the rest in the dark.
        most = 1.5 * float(np.quantile(pressure[pressure > 0], 0.99))
        if most < highest:
            highest, extend = most, "max"
    _draw_map(
        axes,
        result,
        pressure,
        PRESSURE_MAP,
        "pressure p  [N/mm²]",
        extend=extend,
        hide_zero=True,
        vmin=0,
        vmax=highest,
    )


def _draw_map(axes, result, field, colours, label, extend="neither", **options):
    _draw_background(axes, result)
    field = np.where(_inadmissible(result), np.nan, field)
    image = _image(axes, result, field, colours, **options)
    bar = axes.figure.colorbar(image, cax=axes.inset_axes([1.03, 0, 0.035, 1]), extend=extend)
    bar.set_label(label)
    bar.outline.set_linewidth(0.8)


def _cell(result, at=None):
    """Row and column of the cell the sections go through."""
    if at is not None:
        return int(np.argmin(abs(result.y - at[1]))), int(np.argmin(abs(result.x - at[0])))
    pressure = _finite(result.pressure)
    if pressure.any():
        return int(np.argmax(pressure.sum(axis=1))), int(np.argmax(pressure.sum(axis=0)))
    return result.y.size // 2, result.x.size // 2


def _draw_section(axes, result, along, row, column, reference):
    if along == "x":
        centres, values, fixed = result.x, result.pressure[row], f"y = {result.y[row]:.3g} mm"
    else:
        centres, values, fixed = result.y, result.pressure[:, column], f"x = {result.x[column]:.3g} mm"
    edges = centres[0] + _spacing(centres) * (np.arange(centres.size + 1) - 0.5)
    axes.stairs(values, edges, fill=True, color=PALE)
    axes.stairs(values, edges, color=BLUE, linewidth=1.4, label="computed", baseline=None)
    # Not the whole patch but where the bodies touch, in this section or beside it.
    touching = np.flatnonzero(result.contact.any(axis=0 if along == "x" else 1))
    ends = (edges[touching[0]], edges[touching[-1] + 1]) if touching.size else (edges[0], edges[-1])
    margin = 0.15 * (ends[1] - ends[0])
    ends = max(edges[0], ends[0] - margin), min(edges[-1], ends[1] + margin)
    if reference is not None:
        s = np.linspace(*ends, 1001)
        x, y = (s, result.y[row]) if along == "x" else (result.x[column], s)
        axes.plot(s, reference.pressure(x, y), color=ORANGE, linestyle=(0, (5, 2)), label=reference.label)
        axes.legend(loc="upper right")
    at = fixed.replace("-", "−")
    axes.set(xlim=ends, xlabel=f"{along}  [mm]   at {at}", ylabel="pressure p  [N/mm²]")
    axes.set_ylim(0, 1.1 * _finite(values).max() or 1.0)


def _draw_residual(axes, result):
    residual = result.history["residual"]
    residual = np.where((residual > 0) & np.isfinite(residual), residual, np.nan)
    iterations = np.arange(1, residual.size + 1)
    _mark_grids(axes, result, label=True)
    for first, last in _runs(result.history["level"]):
        part = slice(first, last)
        axes.semilogy(iterations[part], residual[part], "o-", color=BLUE)
    if "lcp_rtol" in result.attributes:
        axes.axhline(result.attributes["lcp_rtol"], color=ORANGE, linestyle=(0, (5, 2)), label="tolerance")
        axes.legend(loc="lower left")
        # Direct solves on the coarsest grid go down to round-off; that is not what the picture is about.
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-3 * result.attributes["lcp_rtol"]))
    axes.set(xlabel="active set iteration", ylabel="residual  ‖r‖ / ‖h‖")


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
    axes.xaxis.get_major_locator().set_params(integer=True)
    if len(runs) < 2:
        return
    axes.set_xlim(0.5, level.size + 0.5)
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
    grid = Grid(result.x.size, result.y.size, 1.0, 1.0)
    for _ in range(coarsenings):
        grid = grid.coarsen() or grid
    return f"{grid.nx} × {grid.ny}"
