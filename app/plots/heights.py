"""Picture of a measured surface: map, profiles, distribution of heights, spectrum, and what ISO 25178 calls them.

Not collective: call on one rank.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.patches import Patch

from app.base.units import choose_length_unit
from app.plots.curves import draw_spectrum, extract_roughness
from app.plots.maps import LENGTH_MAP, Canvas
from app.plots.style import BLUE, DASHED, GREY, ORANGE, PALE, annotate_empty, new_figure, with_style

_TAIL = 1e-3  # share of heights at each end that may be left out of colours and distribution,
_FAR = 1.5  # where with them these would span so many times the rest
_BINS = 20, 100
_LOWEST, _BELOW = 4.8, 4.4  # inches of the map's row at least, and of the row below


@with_style
def surface_figure(surface):
    """Map of the heights, profiles through the middle, distribution and radial spectrum; Sq, Sdq, Ssk, Sku above.

    Missing points are grey and have no spectrum.

    Parameters
    ----------
    surface : app.problems.surfaces.measured_surface.Surface
        With a spacing; levelled by "plane", so that what is drawn is what its numbers are about [mm].

    Returns
    -------
    matplotlib.figure.Figure
    """
    grid, heights = surface.grid(), surface.heights()
    low, high, extend = _shown(heights)
    unit = choose_length_unit(max(-low, high))
    heights_shown = heights * unit.per_mm
    limits = low * unit.per_mm, high * unit.per_mm
    patch = SimpleNamespace(grid=grid, undeformed_distance=heights)  # grey is where that is missing
    canvas = Canvas(patch)
    width, height = canvas.size
    rows = max(height - 0.4, _LOWEST)
    figure = new_figure(max(2 * width, 13.0), rows + _BELOW, _title(surface, grid))
    panels = figure.subplot_mosaic(
        [["map", "x"], ["map", "y"], ["heights", "spectrum"]], height_ratios=[rows / 2, rows / 2, _BELOW]
    )
    _draw_map(panels["map"], canvas, heights_shown, limits, extend, unit)
    for along in "xy":
        _draw_profile(panels[along], canvas, heights_shown, along, unit)
    _draw_distribution(panels["heights"], heights_shown[np.isfinite(heights)], limits, unit)
    rest = extract_roughness(patch)
    if surface.missing_points:
        annotate_empty(panels["spectrum"], "no spectrum: points are missing")
    elif rest is None or draw_spectrum(panels["spectrum"], rest, grid, "heights") is None:
        annotate_empty(panels["spectrum"], "no spectrum: too few points, or too smooth")
    return figure


def _title(surface, grid):
    """File, points and cells; below them the numbers."""
    name = Path(surface.file.partition(":/")[0]).name
    unit = choose_length_unit(max(grid.dx, grid.dy))
    cell = " × ".join(f"{side * unit.per_mm:.4g}" for side in (grid.dx, grid.dy))
    holes = f", {surface.missing_points} missing" if surface.missing_points else ""
    unit_z = choose_length_unit(surface.rms_level)
    numbers = [
        f"Sq {surface.rms_level * unit_z.per_mm:.3g} {unit_z.name}",
        f"Sdq {surface.rms_slope(grid):.3g}",
    ]
    if surface.rms_level > 0:
        numbers += [f"Ssk {surface.skewness:.3g}", f"Sku {surface.kurtosis:.3g}"]
    about = "about the best plane:  " + ",   ".join(numbers).replace("-", "−")
    return f"{name}, {grid.nx} × {grid.ny} points{holes}, cells of {cell} {unit.name}\n{about}"


def _shown(heights):
    """Lowest and highest height that is drawn, and what is beyond: a spike must not leave the rest in one colour."""
    known = heights[np.isfinite(heights)]
    lowest, highest = float(known.min()), float(known.max())
    low, high = map(float, np.quantile(known, [_TAIL, 1 - _TAIL]))
    far = _FAR * (high - low)
    below, above = far > 0 and high - lowest > far, far > 0 and highest - low > far
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((below, above), "neither")
    return low if below else lowest, high if above else highest, extend


def _draw_map(axes, canvas, heights, limits, extend, unit):
    low, high = limits
    canvas.field(axes, heights, LENGTH_MAP, f"height z  [{unit.name}]", extend, vmin=low, vmax=high)
    if canvas.outside.any():
        entries = [Patch(color=GREY, label="missing")]
        axes.legend(handles=entries, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _draw_profile(axes, canvas, heights, along, unit):
    """Heights of the middle row or column; a missing point is a gap in the line."""
    grid, lateral = canvas.grid, canvas.unit
    if along == "x":
        row = grid.ny // 2
        at, profile, place = grid.x(), heights[row], f"y = {grid.y()[row] * lateral.per_mm:.3g}"
    else:
        column = grid.nx // 2
        at, profile, place = grid.y(), heights[:, column], f"x = {grid.x()[column] * lateral.per_mm:.3g}"
    axes.plot(at * lateral.per_mm, profile, color=BLUE, linewidth=1.2, marker="" if at.size > 2 else "o")
    place = place.replace("-", "−")
    name = lateral.name
    axes.set(xlabel=f"{along}  [{name}]   at {place} {name}", ylabel=f"height z  [{unit.name}]")
    axes.margins(x=0 if at.size > 1 else 0.05)
    if not np.isfinite(profile).any():
        annotate_empty(axes, "all of it is missing")


def _draw_distribution(axes, values, limits, unit):
    """Probability density of the heights, and the normal one of the same mean and Sq."""
    axes.set(xlabel=f"height z  [{unit.name}]", ylabel=f"probability density  [1/{unit.name}]")
    sq = values.std()
    if not sq > 0:
        return annotate_empty(axes, "all heights are equal")
    bins = int(np.clip(np.sqrt(values.size) / 2, *_BINS))
    share, edges = np.histogram(values, bins, limits)
    density = share / values.size / np.diff(edges)
    axes.stairs(density, edges, fill=True, color=PALE)
    axes.stairs(density, edges, color=BLUE, linewidth=1.4, label="heights")
    z = np.linspace(edges[0], edges[-1], 301)
    normal = np.exp(-(((z - values.mean()) / sq) ** 2) / 2) / (sq * np.sqrt(2 * np.pi))
    axes.plot(z, normal, color=ORANGE, linestyle=DASHED, label="normal, of the same Sq")
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(0, 1.3 * max(density.max(), normal.max()))  # room for the legend
    axes.legend(loc="upper left", ncol=2)
    return None
