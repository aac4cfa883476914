"""Maps of a patch: contact, pressure, any field; readable also where the patch is long and narrow.

White means zero (no pressure, no contact), grey that contact is impossible. Not collective: call on one rank.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.legend_handler import HandlerTuple
from matplotlib.patches import Patch

from app.base.units import choose_length_unit
from app.plots import style
from app.plots.style import BLUE, GREY

PRESSURE_MAP, LENGTH_MAP = "viridis", "cividis"
MOST_PIXELS = 1024  # longer sides of an image are averaged down to this
NARROWEST = 0.22  # side over side of a map; a narrower patch is stretched
_WIDEST, _HIGHEST = 5.1, 6.4  # inches of a map
_LOW = 2.2  # inches
_SLIM = 2.0  # inches of width, in which numbers side by side would touch
_CONSTANT = 1e-4  # of a length: what varies less is one colour
_ROUNDING = 1e-14  # of the lengths that add up to another
_BAR = 0.18  # inches of a colour bar's width
PATCH_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5b4fa2", "#8c6d31", "#117733",
                 "#aa3377")  # fmt: skip


class Canvas:
    """How the patch of a result lies on paper.

    Attributes
    ----------
    unit : Unit
        Of lengths.
    extent : tuple
        x0, x1, y0, y1 in it.
    width, height : float
        Of the map [inch].
    low : bool
        Whether there is no room for a colour bar beside the map, so that it lies below.
    stretched : bool
        Whether the two directions have different scales.
    """

    def __init__(self, result):
        self.result, self.grid = result, (grid := result.grid)
        width, height = grid.nx * grid.dx, grid.ny * grid.dy
        self.unit = choose_length_unit(max(width, height))
        ends = grid.x0, grid.x0 + width, grid.y0, grid.y0 + height
        self.extent = x0, x1, y0, y1 = tuple(end * self.unit.per_mm for end in ends)
        shape = (y1 - y0) / (x1 - x0)
        box = float(np.clip(shape, NARROWEST, 1 / NARROWEST))
        self.stretched = not np.isclose(box, shape)
        self.width = min(_WIDEST, _HIGHEST / box)
        self.height = box * self.width
        self.low = self.height < _LOW

    @property
    def size(self):
        """Width and height [inch] of a picture of the patch with its labels."""
        return max(self.width + 2.0, 6.4), self.height + 1.5 + 0.9 * self.low

    @cached_property
    def outside(self):
        """Where contact is impossible."""
        return np.isnan(self.result.undeformed_distance)

    def image(self, axes, field, colours=None, **limits):
        """Draw a field, NaN transparent, or an image (ny, nx, 4) of colours."""
        pixels, b = (field, 1) if field.ndim == 3 else block_mean(field, MOST_PIXELS)
        return self.pixels(axes, pixels, b, cmap=colours, **limits)

    def pixels(self, axes, pixels, b, **options):
        """Draw what stands for blocks of b x b cells."""
        x0, x1, y0, y1 = self.extent
        right = x0 + pixels.shape[1] * b * self.grid.dx * self.unit.per_mm
        top = y0 + pixels.shape[0] * b * self.grid.dy * self.unit.per_mm
        image = axes.imshow(
            pixels, origin="lower", extent=(x0, right, y0, top), interpolation="nearest", **options
        )
        name = self.unit.name
        axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel=f"x  [{name}]", ylabel=f"y  [{name}]", aspect="auto")
        if self.stretched:
            long, short = ("y", "x") if y1 - y0 > x1 - x0 else ("x", "y")
            times = max((y1 - y0) / (x1 - x0), (x1 - x0) / (y1 - y0)) * NARROWEST
            slim = self.width < _SLIM  # a longer line would be cut off: matplotlib keeps no room for it
            between, within = ("\n", "\n") if slim else ("   ", " ")
            axes.set(xlabel=f"x  [{name}]{between}({short}: {times:.3g} ×{within}the scale of {long})")
        axes.set_box_aspect(self.height / self.width)
        axes.tick_params(axis="x", labelrotation=90 if self.width < _SLIM else 0)
        axes.ticklabel_format(axis="y", style="plain", useOffset=False)  # it would stand where the legend is
        for spine in axes.spines.values():
            spine.set_visible(True)
        return image

    def background(self, axes):
        """Grey where contact is impossible. Return whether that is anywhere."""
        if self.outside.any():
            self.image(axes, np.where(self.outside, 1.0, np.nan), ListedColormap([GREY]))
        return bool(self.outside.any())

    def field(self, axes, field, colours, label, extend="neither", hide_zero=False, ticks=None, **options):
        """Draw a field with its colour bar, which has `ticks` alone where they are given."""
        self.background(axes)
        pixels, b = block_mean(np.where(self.outside, np.nan, field), MOST_PIXELS)
        if hide_zero:
            pixels = np.where(pixels == 0, np.nan, pixels)
        image = self.pixels(axes, pixels, b, cmap=colours, **options)
        if self.low:
            place = axes.inset_axes([0, -0.85 / self.height, 1, _BAR / self.height])
            bar = axes.figure.colorbar(image, cax=place, extend=extend, orientation="horizontal")
        else:
            place = axes.inset_axes([1 + 0.15 / self.width, 0, _BAR / self.width, 1])
            bar = axes.figure.colorbar(image, cax=place, extend=extend)
        bar.set_label(label)
        if np.isnan(pixels).all():
            ticks = []
        if ticks is not None:
            bar.set_ticks(ticks, labels=[f"{tick:.4g}".replace("-", "−") for tick in ticks])
        bar.outline.set_linewidth(0.8)

    def contact(self, axes):
        """Draw the contact area, its patches told apart by colours that mean nothing else."""
        has_outside = self.background(axes)
        result = self.result
        patches = result.patches()
        cells = patches.cells
        share, b = block_mean(result.contact.astype(float), MOST_PIXELS)
        palette = np.array([to_rgb(colour) for colour in (PATCH_COLOURS if len(cells) > 1 else (BLUE,))])
        # The largest differ in colour.
        index = (np.maximum(block_max(patches.labels, b), 1) - 1) % len(palette)
        self.pixels(axes, np.dstack([palette[index], share]), b)
        possible = int(np.count_nonzero(~self.outside))
        text = f"contact: {100 * result.attributes['contact_fraction']:.3g}% of {possible} cells"
        used = palette[: len(cells)] if len(cells) > 1 else palette
        text += f", {len(cells)} patches in {len(used)} colours" if len(cells) > 1 else ""
        entries = {text: tuple(Patch(color=colour) for colour in used)}
        if np.count_nonzero(result.contact == 1) < possible:
            entries["no contact"] = Patch(facecolor="white", edgecolor="0.5")
        if has_outside:
            entries["no contact possible"] = Patch(color=GREY)
        strips = {tuple: HandlerTuple(ndivide=None, pad=0)}
        place = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0.2}
        axes.legend(entries.values(), entries, handler_map=strips, **place)

    def pressure(self, axes):
        """Draw the pressure; no colour where it is zero."""
        pressure = finite_pressure(self.result.pressure)
        highest, extend = float(pressure.max()) or 1.0, "neither"
        if pressure.any():
            # Singular pressure on a few cells at an edge must not leave the rest in the dark.
            most = 1.5 * float(np.quantile(pressure[pressure > 0], 0.99))
            if most < highest:
                highest, extend = most, "max"
        label = "pressure p  [N/mm²]"
        self.field(axes, pressure, PRESSURE_MAP, label, extend, hide_zero=True, vmin=0, vmax=highest)

    def length(self, axes, field, colours, label):
        """Draw a field of lengths [mm] in a unit of its own; ``{}`` in the label stands for it."""
        known = field[np.isfinite(field) & ~self.outside]
        largest, none = float(np.abs(known).max(initial=0.0)), estimate_rounding(self.result)
        unit, limits = choose_length_unit(largest if largest > none else 0.0), {}
        if known.size and np.ptp(known) <= max(_CONSTANT * largest, none):
            value = float(known[0]) * unit.per_mm if largest > none else 0.0
            field, margin = np.where(np.isnan(field), np.nan, value), 0.1 * abs(value) or 1.0
            limits = {"vmin": value - margin, "vmax": value + margin, "ticks": [value]}
        else:
            field = field * unit.per_mm
        self.field(axes, field, colours, label.format(unit.name), **limits)


def cell_edges(grid, along):
    """Sides of the cells of a row, along "x", or of a column [mm]."""
    start, cell, n = (grid.x0, grid.dx, grid.nx) if along == "x" else (grid.y0, grid.dy, grid.ny)
    return start + cell * np.arange(n + 1)


def estimate_rounding(result):
    """Length [mm] that is rounding beside the distances, the approach and the displacements of a result.

    Not collective.
    """
    values, grid = result.attributes, result.grid
    size, modulus = max(grid.nx * grid.dx, grid.ny * grid.dy), values.get("contact_modulus") or np.inf
    pressed = finite_pressure(result.pressure).max() / modulus * size
    lengths = np.append(result.undeformed_distance, [values["approach"], pressed])
    return _ROUNDING * float(np.abs(lengths[np.isfinite(lengths)]).max())


def finite_pressure(pressure):
    """Pressures with those of a diverged run, and negative ones, set to zero."""
    return np.where(np.isfinite(pressure) & (pressure > 0), pressure, 0.0)


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
    with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN that is wanted
        return _blocks(np.add, np.where(valid, field, 0.0), b) / _blocks(np.add, valid.astype(int), b), b


def block_max(field, b):
    """Largest value of blocks of b x b cells."""
    return field if b == 1 else _blocks(np.maximum, field, b)


def _blocks(join, values, b):
    for axis, n in enumerate(values.shape):
        values = join.reduceat(values, np.arange(0, n, b), axis=axis)
    return values


def draw_map(result, draw):
    """Figure of one map: ``draw(canvas, axes)``."""
    canvas = Canvas(result)
    figure = style.new_figure(*canvas.size)
    draw(canvas, figure.subplots())
    return figure
