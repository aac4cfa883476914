"""Maps of fields, also on long and narrow patches.

White means zero (no pressure, no contact), grey that contact is impossible.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.legend_handler import HandlerTuple
from matplotlib.patches import Ellipse, Patch

from app.base.errors import InputError
from app.base.units import choose_length_unit
from app.plots.style import BLUE, DASHED, GREY, ORANGE, annotate_empty, column_width
from app.plots.zoom import draw_inset, find_view

PRESSURE_MAP, LENGTH_MAP = "viridis", "cividis"
LEGEND_ABOVE = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0.2, "frameon": False}
MAX_TICKS = 5  # so that labels of many digits do not touch
MAX_PIXELS = 1024  # per side of an image; larger fields are averaged
MAX_UPRIGHT = 1.8  # height over width of a map that need not lie
MIN_ASPECT = 1 / 3  # short over long side of a map; narrower patches are stretched
_MAX_WIDTH, _MAX_HEIGHT = 5.1, 6.4  # of a map [inch]
_LABELS_WIDTH, _MIN_FIGURE_WIDTH = 2.0, 6.4  # of a map's labels and colour bar; of a figure [inch]
_MIN_VARIATION = 1e-4  # of a length; fields that vary less have one colour
_ROUNDING = 1e-14  # relative error of a sum of lengths
_BAR_WIDTH = 0.18  # inch
PATCH_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5b4fa2", "#8c6d31", "#117733",
                 "#aa3377")  # fmt: skip


class Canvas:
    """Layout of a result's maps; its methods draw fields on axes.

    `extent` is x0, x1, y0, y1 in `unit`; `width` and `height` are the sides of the map [inch]. `stretched` is True if
    x and y have different scales. With `zoom` the map shows only the contact, if the contact is small in its patch; an
    inset shows the patch. With `lie` a map that is long in y is
    turned, so that y points to the right. If `titled`, the label of the colours is the title, because at the bar it
    would look like a label of the next panel; else it is at the bar, and the title is the user's.
    """

    def __init__(self, result, zoom=False, lie=False, titled=True):
        self.result, self.titled, whole = result, titled, result.grid
        self.view = rows, columns = find_view(result) if zoom else (slice(0, whole.ny), slice(0, whole.nx))
        self.grid = grid = replace(
            whole,
            nx=columns.stop - columns.start,
            ny=rows.stop - rows.start,
            x0=whole.x0 + columns.start * whole.dx,
            y0=whole.y0 + rows.start * whole.dy,
        )
        self.unit = choose_length_unit(max(grid.sides))
        self.extent = x0, x1, y0, y1 = tuple(end * self.unit.per_mm for end in grid.domain)
        shape = (y1 - y0) / (x1 - x0)
        self.lies = lie and shape > MAX_UPRIGHT
        if self.lies:
            shape = 1 / shape
        box = float(np.clip(shape, MIN_ASPECT, 1 / MIN_ASPECT))
        self.stretched = not np.isclose(box, shape)
        self.width = min(_MAX_WIDTH, _MAX_HEIGHT / box, (column_width() or np.inf) - _LABELS_WIDTH)
        self.height = box * self.width

    @property
    def size(self):
        """Size of the map with its labels [inch]."""
        return max(self.width + _LABELS_WIDTH, column_width() or _MIN_FIGURE_WIDTH), self.height + 1.5

    @cached_property
    def outside(self):
        """Mask of the shown cells where contact is impossible."""
        return np.isnan(self.result.undeformed_distance[self.view])

    def _draw_patch(self, axes):
        whole = self.result.grid
        if self.grid.n == whole.n:
            return
        patch = tuple(end * self.unit.per_mm for end in whole.domain)
        view = self.extent
        if self.lies:
            patch, view = patch[2:] + patch[:2], view[2:] + view[:2]
        draw_inset(axes, (self.width, self.height), patch, view)

    def _draw_image(self, axes, pixels, b, **options):
        """Draw an image whose pixels are blocks of b x b cells."""
        x0, x1, y0, y1 = self.extent
        name, (across, up) = self.unit.name, "xy"
        right = x0 + pixels.shape[1] * b * self.grid.dx * self.unit.per_mm
        top = y0 + pixels.shape[0] * b * self.grid.dy * self.unit.per_mm
        if self.lies:
            pixels, across, up = np.swapaxes(pixels, 0, 1), "y", "x"
            x0, x1, right, y0, y1, top = y0, y1, top, x0, x1, right
        options |= {"origin": "lower", "interpolation": "nearest"}
        image = axes.imshow(pixels, extent=(x0, right, y0, top), **options)
        axes.set(
            xlim=(x0, x1),
            ylim=(y0, y1),
            xlabel=f"{across}  [{name}]",
            ylabel=f"{up}  [{name}]",
            aspect="auto",
        )
        if self.stretched:
            long, short = (up, across) if y1 - y0 > x1 - x0 else (across, up)
            times = max((y1 - y0) / (x1 - x0), (x1 - x0) / (y1 - y0)) * MIN_ASPECT
            axes.set(xlabel=f"{across}  [{name}]\n({short}: {times:.3g} × the scale of {long})")
        axes.set_box_aspect(self.height / self.width)
        axes.ticklabel_format(style="plain", useOffset=False)
        axes.locator_params(nbins=MAX_TICKS)
        axes.tick_params(axis="x", labelrotation=90 if self.height > MAX_UPRIGHT * self.width else 0)
        for spine in axes.spines.values():
            spine.set_visible(True)
        return image

    def _draw_outside(self, axes):
        """Draw cells without possible contact in grey; return whether any exist."""
        if self.outside.any():
            pixels, b = block_mean(np.where(self.outside, 1.0, np.nan), MAX_PIXELS)
            self._draw_image(axes, pixels, b, cmap=ListedColormap([GREY]))
        return bool(self.outside.any())

    def draw_field(
        self, axes, field, colours, label, extend="neither", hide_zero=False, ticks=None, **options
    ):
        """Draw a field with a colour bar.

        With `hide_zero` zero is white. `ticks` are the ticks of the colour bar, if given.
        """
        self._draw_outside(axes)
        pixels, b = block_mean(np.where(self.outside, np.nan, field), MAX_PIXELS)
        if hide_zero:
            pixels = np.where(pixels == 0, np.nan, pixels)
        image = self._draw_image(axes, pixels, b, cmap=colours, **options)
        inset = axes.inset_axes([1 + 0.15 / self.width, 0, _BAR_WIDTH / self.width, 1])
        bar = axes.figure.colorbar(image, cax=inset, extend=extend)
        axes.set_title(label) if self.titled else bar.set_label(label)
        ticks = [] if np.isnan(pixels).all() else ticks
        if ticks is not None:
            bar.set_ticks(ticks, labels=[f"{tick:.4g}".replace("-", "−") for tick in ticks])
        bar.outline.set_linewidth(0.8)

    def draw_contact(self, axes):
        """Draw the contact area, with colours for spots.

        With a hardness there are two colours, of elastic and of plastic cells.
        """
        has_outside, result = self._draw_outside(axes), self.result
        possible = int(np.count_nonzero(~np.isnan(result.undeformed_distance)))
        if getattr(result, "plastic", None) is None:
            entries = self._draw_spots(axes)
        else:
            entries = self._draw_elastic_and_plastic(axes, possible)
        if np.count_nonzero(result.contact) < possible:
            entries["no contact"] = Patch(facecolor="white", edgecolor="0.5")
        if has_outside:
            entries["no contact possible"] = Patch(color=GREY)
        handlers = {tuple: HandlerTuple(ndivide=None, pad=0)}
        axes.legend(entries.values(), entries, handler_map=handlers, **LEGEND_ABOVE)
        self._draw_patch(axes)

    def _draw_elastic_and_plastic(self, axes, possible):
        """Draw elastic and plastic contact; return legend entries.

        `possible` is the number of admissible cells.
        """
        plastic = self.result.plastic
        masks = self.result.contact & ~plastic, plastic
        shown = (mask[self.view].astype(float) for mask in masks)
        (elastic, b), (overlapping, _) = (block_mean(part, MAX_PIXELS) for part in shown)
        total = elastic + overlapping
        share = np.divide(overlapping, total, out=np.zeros_like(total), where=total > 0)[..., None]
        self._draw_image(axes, np.dstack([(1 - share) * to_rgb(BLUE) + share * to_rgb(ORANGE), total]), b)
        names = zip(("elastic", "plastic"), masks, (BLUE, ORANGE), strict=True)
        return {
            f"{name} contact: {100 * np.count_nonzero(mask) / possible:.3g}%": Patch(color=colour)
            for name, mask, colour in names
        }

    def _draw_spots(self, axes):
        """Draw the contact spots; return legend entries."""
        result = self.result
        patches = result.patches()
        cells = patches.cells
        share, b = block_mean(result.contact[self.view].astype(float), MAX_PIXELS)
        palette = np.array([to_rgb(colour) for colour in (PATCH_COLOURS if len(cells) > 1 else (BLUE,))])
        # A block has the colour of its smallest spot; the largest spots have different colours.
        index = (np.maximum(block_max(patches.labels[self.view], b), 1) - 1) % len(palette)
        self._draw_image(axes, np.dstack([palette[index], share]), b)
        text = f"contact: {100 * result.attributes['contact_fraction']:.3g}%"
        used = palette[: max(len(cells), 1)]
        text += f", {len(cells)} contact spots" if len(cells) > 1 else ""
        return {text: tuple(Patch(color=colour) for colour in used)}

    def draw_pressure(self, axes, reference=None):
        """Draw the pressure, and the contact ellipse of a `reference` solution.

        Zero is white.
        """
        pressure = finite_pressure(self.result.pressure)
        maximum = float(pressure.max())
        highest, extend = maximum or 1.0, "neither"
        if pressure.any():
            # Singular pressures in a few cells at an edge must not darken all others.
            limit = 1.5 * float(np.quantile(pressure[pressure > 0], 0.99))
            if limit < highest:
                highest, extend = limit, "max"
        remarks = [f"maximum {format_number(maximum)}"] if maximum else []
        remarks += ["dashed: Hertz's ellipse"] if reference is not None else []
        label = "\n".join(filter(None, ["pressure p  [N/mm²]", ", ".join(remarks)]))
        shown = pressure[self.view]
        self.draw_field(axes, shown, PRESSURE_MAP, label, extend, hide_zero=True, vmin=0, vmax=highest)
        if reference is not None:
            a, b = (2 * half * self.unit.per_mm for half in (reference.a, reference.b))
            ellipse = Ellipse((0, 0), *((b, a) if self.lies else (a, b)), fill=False)
            ellipse.set(edgecolor=ORANGE, linestyle=DASHED, linewidth=1.2)
            axes.add_patch(ellipse)
        self._draw_patch(axes)

    def draw_length(self, axes, field, colours, label):
        """Draw a field of lengths in a suitable unit.

        Its name replaces ``[mm]`` in the label.
        """
        known = field[np.isfinite(field) & ~self.outside]
        largest, rounding = float(np.abs(known).max(initial=0.0)), estimate_rounding(self.result)
        unit, limits = choose_length_unit(largest if largest > rounding else 0.0), {}
        if known.size and np.ptp(known) <= max(_MIN_VARIATION * largest, rounding):
            value = float(known[0]) * unit.per_mm if largest > rounding else 0.0
            field, margin = np.where(np.isnan(field), np.nan, value), 0.1 * abs(value) or 1.0
            limits = {"vmin": value - margin, "vmax": value + margin, "ticks": [value]}
        else:
            field = field * unit.per_mm
        self.draw_field(axes, field, colours, label.replace("[mm]", f"[{unit.name}]"), **limits)

    def draw_displacement(self, axes):
        """Draw a map of the displacement u."""
        self.draw_length(axes, self.result.displacement, LENGTH_MAP, "displacement u  [mm]")

    def draw_plastic_depth(self, axes):
        """Draw a map of permanent indentation; zero is white."""
        if self.result.plastic_depth is None:
            raise InputError("plot 'plastic_depth': the result has no hardness")
        self.draw_other(axes, self.result.plastic_depth, "permanent indentation", "mm")

    def draw_other(self, axes, field, label, unit):
        """Draw any field of all cells; zero is white unless some values are negative."""
        field = field[self.view].astype(float)
        hidden = ~np.isfinite(field) | ((field == 0) & ~(field < 0).any())
        field = np.where(hidden, np.nan, field)
        label += f"  [{unit.replace('2', '²').replace('3', '³')}]" if unit != "1" else ""
        if unit == "mm":
            self.draw_length(axes, field, LENGTH_MAP + "_r", label)
        else:
            self.draw_field(axes, field, PRESSURE_MAP, label)
        self._draw_patch(axes)

    def draw_gap(self, axes):
        """Draw the gap e, white in contact."""
        gap = np.where(self.result.contact, np.nan, self.result.gap)
        if not np.isfinite(gap).any():
            annotate_empty(axes, "no gap: contact everywhere")
            axes.set_box_aspect(self.height / self.width)
            return
        self.draw_length(axes, gap, LENGTH_MAP + "_r", "gap e  [mm]\nwhite: contact")


def format_number(value):
    """Return a number as text: four digits, or a whole number."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"


def cell_edges(grid, along):
    """Return cell edges along "x" or "y" [mm]."""
    start, cell, n = (grid.x0, grid.dx, grid.nx) if along == "x" else (grid.y0, grid.dy, grid.ny)
    return start + cell * np.arange(n + 1)


def estimate_rounding(result):
    """Estimate the rounding error of a result's gaps [mm]."""
    values, grid = result.attributes, result.grid
    size, modulus = max(grid.sides), values.get("contact_modulus") or np.inf
    displacement = finite_pressure(result.pressure).max() / modulus * size
    lengths = np.append(result.undeformed_distance, [values["approach"], displacement])
    return _ROUNDING * float(np.abs(lengths[np.isfinite(lengths)]).max())


def finite_pressure(pressure):
    """Return pressures, with zero for negative and non-finite ones."""
    return np.where(np.isfinite(pressure) & (pressure > 0), pressure, 0.0)


def block_mean(field, limit):
    """Average b x b cells to at most `limit` blocks per side.

    b is as small as possible. NaN cells are left out; a block of NaN cells is NaN. Return the means and b.
    """
    b = -(-max(field.shape) // limit)
    if b == 1:
        return field, 1
    valid = ~np.isnan(field)
    with np.errstate(invalid="ignore"):  # 0 / 0 gives the NaN of an empty block
        means = _reduce_blocks(np.add, np.where(valid, field, 0.0), b) / _reduce_blocks(
            np.add, valid.astype(int), b
        )
    return means, b


def block_max(field, b):
    """Return the largest value in each block of b x b cells."""
    return field if b == 1 else _reduce_blocks(np.maximum, field, b)


def _reduce_blocks(function, values, b):
    for axis, n in enumerate(values.shape):
        values = function.reduceat(values, np.arange(0, n, b), axis=axis)
    return values
