"""Figures of the stress below the contact."""

import numpy as np
from matplotlib import rcParams

from app.base.units import choose_length_unit
from app.halfspace.stress.layered import LayeredStress
from app.halfspace.stress.subsurface import SubsurfaceStress, coarsen, is_largest, max_shear, von_mises
from app.io.result import find_layer, find_poisson_ratio
from app.plots.maps import MAX_TICKS, cell_edges, format_number
from app.plots.style import (
    BLUE,
    DASH_DOUBLE_DOTTED,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    add_legend,
    column_width,
    new_mosaic,
    with_style,
)

MIN_STRESS_VARIATION = 1e-9  # relative to the largest stress; below, the stress is uniform
_SHOWN_SHARE = 0.05  # of the largest stress; a section ends where less is below all points
_DEPTHS = 33  # of the section in the summary, denser near the surface
_MAX_CELLS = 512**2  # of a pressure whose stresses are quickly computed; larger ones are averaged
_SCALE_SHARE = 0.98  # of a section's points whose stresses the colours must show
_SHAPES = 0.3, 0.7  # smallest and largest height over width of a section
_MAX_RATIO = 2.5  # of the lengths of two sections with the same scale
_MAX_WIDENING = 1.5  # of a section's length, for the same scale of depth
_THIN = 0.05  # of the depth shown; a thinner coating has its own panel
_MAX_CONTRAST = 2.0  # of the largest stresses of a layer and its base that share a colour scale
PANEL_SHAPE = 0.5  # depth over width of the section in the summary


def _draw_mises(axes, along, grid, ends, depths, mises, highest, shape, interface, remark=""):
    """Draw the von Mises stress on a vertical section.

    Return the units of lengths and depths. The section goes `along` "x" or "y" and is shown between `ends` [mm].
    `mises` has the shape (depths, cells). `highest` [N/mm2] is the end of the colour scale, or the two ends of the
    layer's and its base's, `shape` is height over width of the panel, and `remark` is a text in the label of the axis.
    """
    unit = choose_length_unit(max(ends[1] - ends[0], depths[-1]))
    z_scale = shape * (ends[1] - ends[0]) / (depths[-1] or 1.0)
    same = np.isclose(z_scale, 1, rtol=0.02)
    gap = "\n" if column_width() else "   "
    remark += "" if same else f"{gap}(depth scaled by {z_scale:.3g})"
    z_unit = unit if same else choose_length_unit(depths[-1])
    z = depths * z_unit.per_mm
    bottom = z[-1] or 1.0
    z_edges = np.concatenate([z[:1], (z[1:] + z[:-1]) / 2, [bottom]])
    sides, tops = cell_edges(grid, along) * unit.per_mm, np.atleast_1d(highest)
    bodies = _split(depths, interface) if len(tops) > 1 else [slice(0, len(depths))]
    for number, (body, top) in enumerate(zip(bodies, tops, strict=True)):
        edges, field = z_edges[body.start : body.stop + 1], mises[body]
        image = axes.pcolormesh(sides, edges, field, rasterized=True, cmap="magma_r", vmin=0, vmax=top or 1.0)
        extend = "max" if field.max() > 1.001 * top else "neither"
        place = [1.02, 0, 0.03, 1] if len(tops) == 1 else [1.02, 0.54 * (1 - number), 0.03, 0.46]
        bar = axes.figure.colorbar(image, cax=axes.inset_axes(place), extend=extend)
        bar.set_label(("layer", "base")[number] if len(tops) > 1 else "")
    _draw_interface(axes, interface, depths, z_unit)
    axes.set_box_aspect(shape)
    axes.set_title("von Mises stress  [N/mm²]")
    axes.set(
        xlabel=f"{along}  [{unit.name}]{remark}",
        ylabel=f"depth z  [{z_unit.name}]",
        xlim=(ends[0] * unit.per_mm, ends[1] * unit.per_mm),
        ylim=(bottom, 0),
    )
    return unit, z_unit


def _split(depths, interface):
    """Return slices of the depths in the layer and in its base."""
    first = len(depths) if interface is None else int(np.searchsorted(depths, interface, "right"))
    return [part for part in (slice(0, first), slice(first, len(depths))) if part.start < part.stop]


def _scale(fields, depths, interface):
    """Return the ends of colour scales for stresses on sections [N/mm2].

    There is one end. If the stresses of a layer and its base are very different, each of the two has its own.
    """
    tops = [max(field[body].max() for field in fields) for body in _split(depths, interface)]
    return tops if max(tops) > _MAX_CONTRAST * min(tops) > 0 else max(tops)


def _draw_interface(axes, interface, depths, unit):
    """Draw a line at an interface's depth [mm]."""
    if interface is not None and interface < depths[-1]:
        axes.axhline(interface * unit.per_mm, color="0.5", linestyle=DASHED, linewidth=1)


def _mark(axes, at, depth, text=""):
    """Mark a point of a section by a cross, whose meaning the title has."""
    size = 2.4 * rcParams["lines.markersize"]
    style = {"color": GREEN, "marker": "+", "markersize": size, "markeredgewidth": size / 6}
    axes.plot(at, depth, clip_on=False, linestyle="none", **style)
    if text:
        axes.set_title(f"{axes.get_title()}\n+ {text}")


def _describe(stress, depth):
    unit = choose_length_unit(depth)
    return f"{format_number(stress)} N/mm² at depth {depth * unit.per_mm:.3g} {unit.name}"


def draw_section_stress(axes, result, along, row, column, ends):
    """Draw the von Mises stress below a row or column of cells.

    The section is shown between `ends` [mm]. Return False if the pressure is zero or not finite, or if Poisson's ratio
    is unknown.
    """
    poisson_ratio, layer = find_poisson_ratio(result.attributes), find_layer(result.attributes)
    pressure, grid = result.pressure, result.grid
    if (poisson_ratio is None and layer is None) or not np.isfinite(pressure).all() or not pressure.any():
        return False
    place = {"y": result.y[row]} if along == "x" else {"x": result.x[column]}
    while grid.n > _MAX_CELLS and (coarse := coarsen(pressure, grid)):
        pressure, grid = coarse
    if layer is not None:
        below = LayeredStress(pressure, grid, layer)
    else:
        below = SubsurfaceStress(pressure, grid, poisson_ratio)
    depths = below.include_interface(PANEL_SHAPE * (ends[1] - ends[0]) * np.linspace(0, 1, _DEPTHS) ** 2)
    mises = von_mises(below.section(depths, **place))
    largest = mises.max()
    highest = _scale([mises], depths, below.interface)
    if np.ndim(highest) == 0:
        highest = min(largest, 1.5 * float(np.quantile(mises, _SCALE_SHARE)))
    remark = f"   {below.describe('ν')}" if layer is None else "   (coated body)"
    shown = grid, ends, depths, mises, highest, PANEL_SHAPE, below.interface
    unit, z_unit = _draw_mises(axes, along, *shown, remark)
    k, cell = np.unravel_index(is_largest(mises).argmax(), mises.shape)
    if grid.n == result.grid.n and np.ptp(mises) > MIN_STRESS_VARIATION * largest:
        centres = grid.x() if along == "x" else grid.y()
        depth = _peak(depths, mises[:, cell], k)
        _mark(axes, centres[cell] * unit.per_mm, depth * z_unit.per_mm, _describe(largest, depth))
    return True


def _peak(depths, values, k):
    """Return the interpolated depth of the largest value.

    The depth is the peak of the parabola through the value with number k and its neighbours. At an interface, where the
    stress jumps, there is no parabola.
    """
    if not 0 < k < len(depths) - 1 or min(np.diff(depths[k - 1 : k + 2])) < 1e-9 * depths[-1]:
        return float(depths[k])
    a, b, _ = np.polyfit(depths[k - 1 : k + 2] - depths[k], values[k - 1 : k + 2], 2)
    return float(depths[k] - b / (2 * a)) if a < 0 else float(depths[k])


def _find_ends(grid, along, mises):
    sides, largest = cell_edges(grid, along), mises.max(axis=0)
    shown = np.flatnonzero(largest >= _SHOWN_SHARE * largest.max())
    return sides[shown[0]], sides[shown[-1] + 1]


def _widen(low, high, length):
    """Return the ends of an interval, widened to `length` about its middle."""
    middle = (low + high) / 2
    return middle - length / 2, middle + length / 2


@with_style
def stress_figure(grid, stresses, heading):
    """Draw stresses on vertical sections and a line.

    `stresses` is the result of `app.api.subsurface.survey`. Both sections have the same scales of depth and colour; x
    and y have the same scale, too, unless one section is much longer.
    """
    mises = {"x": von_mises(stresses.section_x), "y": von_mises(stresses.section_y)}
    depths, at, line = stresses.depths, stresses.at, stresses.line
    ends = {along: _find_ends(grid, along, mises[along]) for along in "xy"}
    lengths = [high - low for low, high in ends.values()]
    if max(lengths) <= _MAX_RATIO * min(lengths):
        length = max(*lengths, min(depths[-1] / _SHAPES[1], _MAX_WIDENING * max(lengths)))
        ends = {along: _widen(*pair, length) for along, pair in ends.items()}
        lengths = [length] * 2
    shape = float(np.clip((depths[-1] or 1.0) / min(lengths), *_SHAPES))
    thin = stresses.interface is not None and stresses.interface < _THIN * depths[-1]
    layout = [["x", "coating" if thin else "line"], ["y", "line"]]
    figure, panels = new_mosaic(layout, [7.4, 5.4], [5.4 * shape + 1.8] * 2, heading)
    highest, scale = (
        max(field.max() for field in mises.values()),
        _scale(mises.values(), depths, stresses.interface),
    )
    varies = max(np.ptp(field) for field in mises.values()) > MIN_STRESS_VARIATION * highest
    text = _describe(at.von_mises, at.depth) if varies else f"{format_number(highest)} N/mm² everywhere"
    for along, other in ("xy", "yx"):
        unit = choose_length_unit(max(lengths))
        across = f"   at {other} = {getattr(at, other) * unit.per_mm:.3g} {unit.name}".replace("-", "−")
        shown = grid, ends[along], depths, mises[along], scale, shape, stresses.interface
        unit, z_unit = _draw_mises(panels[along], along, *shown, across if varies else "")
        place = getattr(at, along) * unit.per_mm, at.depth * z_unit.per_mm
        _mark(panels[along], *place, text if along == "x" else "")
    _draw_line(panels["line"], line, depths, stresses.interface)
    if thin:
        coating = _split(depths, stresses.interface)[0]
        _draw_line(panels["coating"], line[:, coating], depths[coating], None)
        panels["coating"].set_title("in the coating")
    add_legend(panels["coating" if thin else "line"])
    return figure


def _draw_line(axes, line, depths, interface):
    """Draw stresses on a vertical line against the depth."""
    unit = choose_length_unit(depths[-1])
    z = depths * unit.per_mm
    for values, label, colour, style in (
        (line[0], "σx", GREEN, "-."), (line[1], "σy", PURPLE, DOTTED), (line[2], "σz", BLUE, DASHED),
        (von_mises(line), "von Mises", ORANGE, "-"), (max_shear(line), "largest shear", "0.3", DASH_DOUBLE_DOTTED),
    ):  # fmt: skip
        axes.plot(values, z, color=colour, linestyle=style, label=label)
    axes.axvline(0, color=GREY, linewidth=0.8, zorder=0)
    _draw_interface(axes, interface, depths, unit)
    axes.set(xlabel="stress  [N/mm²]", ylabel=f"depth z  [{unit.name}]", ylim=(z[-1] or 1.0, 0))
    axes.locator_params(axis="x", nbins=MAX_TICKS)
