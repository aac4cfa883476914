"""Figure of a measured surface, with ISO 25178 numbers."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from app.base.units import choose_length_unit
from app.plots.curves import draw_spectrum, extract_roughness
from app.plots.maps import LENGTH_MAP, Canvas
from app.plots.style import (
    BLUE,
    DASHED,
    ORANGE,
    PALE,
    annotate_empty,
    new_figure,
    new_mosaic,
    with_style,
)

_TAIL = 1e-3  # share of the heights at each end that may lie outside the colour scale
_MAX_TAIL_RANGE = 1.5  # range up to a tail's end over the range without tails; beyond, the tail is cut
_BINS = 20, 100  # smallest and largest number of bins of the distribution
_MIN_MAP_ROW, _LOWER_ROW = 4.8, 4.4  # heights of rows [inch]


@with_style
def surface_figure(surface):
    """Draw heights, middle profiles, distribution and radial spectrum.

    The surface must have a spacing. The best plane is subtracted. Missing points are grey. If there are missing points,
    the spectrum is left out.
    """
    canvas, shown, limits, extend, unit = _prepare(surface)
    grid, heights = canvas.grid, canvas.result.undeformed_distance
    width, height = canvas.size
    rows = max(height - 0.4, _MIN_MAP_ROW)
    layout = [["map", "x"], ["map", "y"], ["heights", "spectrum"]]
    figure, panels = new_mosaic(
        layout, [max(width, 6.5)] * 2, [rows / 2, rows / 2, _LOWER_ROW], _title(surface, grid)
    )
    _draw_map(panels["map"], canvas, shown, limits, extend, unit)
    for along in "xy":
        _draw_profile(panels[along], canvas, shown, along, unit)
    _draw_distribution(panels["heights"], shown[np.isfinite(heights)], limits, unit)
    roughness = extract_roughness(canvas.result)
    if surface.missing_points:
        annotate_empty(panels["spectrum"], "no spectrum: points are missing")
    elif roughness is None or draw_spectrum(panels["spectrum"], roughness, grid, "heights") is None:
        annotate_empty(panels["spectrum"], "no spectrum: too few points, or too smooth")
    return figure


def _prepare(surface):
    """Return the data that a drawing of a height map needs.

    The results are canvas, heights in a suitable unit, limits of the colours, the ends of the colour bar beyond which
    heights lie (`extend`), and the unit.
    """
    heights = surface.heights_about_plane()
    low, high, extend = _find_limits(heights)
    unit = choose_length_unit(max(-low, high))
    canvas = Canvas(SimpleNamespace(grid=surface.grid(), undeformed_distance=heights))
    return canvas, heights * unit.per_mm, (low * unit.per_mm, high * unit.per_mm), extend, unit


def _draw_map(axes, canvas, shown, limits, extend, unit):
    (low, high), missing = limits, "\ngrey: missing" if canvas.outside.any() else ""
    label = f"height z  [{unit.name}]{missing}"
    canvas.draw_field(axes, shown, LENGTH_MAP, label, extend, vmin=low, vmax=high)


def draw_heights(axes, surface):
    """Draw a surface's map of heights on axes of the user."""
    canvas, *shown = _prepare(surface)
    canvas.titled = False
    _draw_map(axes, canvas, *shown)


@with_style
def heights_figure(surface):
    """Return a figure with a surface's heights."""
    canvas, *shown = _prepare(surface)
    figure = new_figure(*canvas.size)
    _draw_map(figure.subplots(), canvas, *shown)
    return figure


def _title(surface, grid):
    """Return a title: file, points, cells and roughness."""
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


def _find_limits(heights):
    """Return the range of the colour scale, and `extend` of its bar.

    A few heights far outside, such as spikes, are left out, because otherwise all other heights would have one colour.
    """
    known = heights[np.isfinite(heights)]
    lowest, highest = float(known.min()), float(known.max())
    low, high = map(float, np.quantile(known, [_TAIL, 1 - _TAIL]))
    far = _MAX_TAIL_RANGE * (high - low)
    below, above = far > 0 and high - lowest > far, far > 0 and highest - low > far
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((below, above), "neither")
    return low if below else lowest, high if above else highest, extend


def _draw_profile(axes, canvas, heights, along, unit):
    x, y = canvas.grid.x() * canvas.unit.per_mm, canvas.grid.y() * canvas.unit.per_mm
    if along == "x":
        s, profile, across = x, heights[y.size // 2], f"y = {y[y.size // 2]:.3g}"
    else:
        s, profile, across = y, heights[:, x.size // 2], f"x = {x[x.size // 2]:.3g}"
    axes.plot(s, profile, color=BLUE, linewidth=1.2, marker="" if s.size > 2 else "o")
    across, name = across.replace("-", "−"), canvas.unit.name
    axes.set(xlabel=f"{along}  [{name}]   at {across} {name}", ylabel=f"height z  [{unit.name}]")
    axes.margins(x=0 if s.size > 1 else 0.05)
    if not np.isfinite(profile).any():
        annotate_empty(axes, "all of it is missing")


def _draw_distribution(axes, values, limits, unit):
    """Draw the heights' probability density and normal fit."""
    axes.set(xlabel=f"height z  [{unit.name}]", ylabel=f"probability density  [1/{unit.name}]")
    sq = values.std()
    if not sq > 0:
        annotate_empty(axes, "all heights are equal")
        return
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
