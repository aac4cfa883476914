"""Heights in a file: units, how rows and columns lie, points x, y, z as a map; what file and options say together."""

from __future__ import annotations

import re
from itertools import islice, takewhile
from operator import index

import numpy as np

from app.errors import InputError
from app.problems.array_file import ArrayFile
from app.problems.points import gridded, looks_like_points
from app.units import ALLOWED, UNITS, unit_named

# At the head of Gwyddion's ASCII export: the size of the map, and the unit of its heights.
_SAID = re.compile(r"#\s*(Width|Height|Value units):\s*([\d.,eE+-]*)\s*(\S+)\s*")
# At the head of an ESRI grid: the size of a cell, in the unit of x and y, which it does not say.
_CELLS = re.compile(r"\s*(cellsize|dx|dy)\s+(\S+)\s*", re.IGNORECASE)

# All that such a head has, of which the first two say what it is.
_ESRI = re.compile(
    r"\s*(ncols|nrows|[xy]ll(?:corner|cent(?:er|re))|cellsize|dx|dy|nodata_value)\s+(\S+)\s*", re.IGNORECASE
)

# What says the unit of heights and of points, and that of the heights alone.
_UNIT_OPTIONS = "unit= (-surface_unit)", "height_unit= (-surface_height_unit)"
_FEW = 8  # heights in a row, that may go by equal steps by chance
_EVEN, _UNEVEN = 0.1, 0.5  # by how much steps differ, in the largest: of printed coordinates, of heights
_OTHER = 0.01  # by which slopes of two rows differ, in the largest step, that are not of one plane

TURNS = {
    "transpose": lambda rows: rows.T,
    "flip_x": lambda rows: rows[:, ::-1],
    "flip_y": lambda rows: rows[::-1],
}


def turned(rows, orient):
    """Rows and columns of an array after some `TURNS`. Not collective."""
    for turn in orient:
        rows = TURNS[turn](rows)
    return rows


def turned_spacing(spacing, orient):
    """Spacing dx, dy, or None, after some `TURNS`, or before them. Not collective."""
    return spacing[::-1] if spacing and orient.count("transpose") % 2 else spacing


def _largest(steps):
    return np.abs(steps).max()


def _is_even(rows):
    """Whether the first row goes by equal steps, its corner apart, and the next ones do not, or by other ones.

    Missing points count for nothing, nor do rows where nearly all are.
    """
    if min(rows.shape) < _FEW:
        return False
    beside = (steps for row in rows[1:] if np.isfinite(steps := np.diff(row[1:])).sum() >= _FEW - 2)
    steps = [np.diff(rows[0, 1:]), *islice(beside, 2)]
    if len(steps) < 3 or not np.isfinite(steps[0]).all():
        return False
    steps = [row[np.isfinite(row)] for row in steps]
    spread, largest, mean = (np.array([of(row) for row in steps]) for of in (np.ptp, _largest, np.mean))
    if not (largest[0] > 0 and spread[0] <= _EVEN * largest[0]):
        return False
    # A plane is even in the second row, too; heights that are tapered at the rim are less uneven there.
    uneven = spread[1] >= _UNEVEN * max(largest[1], spread[2]) and spread[1] > 0
    # Tilted heights are nearly even; but a row of theirs has the slope of the next one, but for roughness or a twist.
    other, next_one = np.abs(np.diff(mean))
    another = other > max(*spread[1:], 10 * next_one, _OTHER * largest[:2].max())
    return bool(uneven or (largest[1] > 0 and another))


def _may_be_of_head(line):
    """Whether a line may stand at the head of an ESRI grid: empty ones, and comments, too."""
    return not line.strip() or line.lstrip().startswith(("#", "%")) or _ESRI.fullmatch(line)


class HeightArray:
    """Heights in memory, (ny, nx), as if they were a `HeightFile`; see there."""

    file, lateral = "(array)", None

    def __init__(self, heights, orient=(), unit=None, spacing=None):
        heights = np.array(heights)
        if heights.ndim != 2 or not heights.size:
            raise InputError(
                f"surface {self.file}: has shape {heights.shape}; needed: (ny, nx), or a file name"
            )
        self._rows, self.unit, self.orient = turned(heights, orient), unit, tuple(orient)
        self.spacing = turned_spacing(spacing, orient)
        self.shape = self._rows.shape

    @classmethod
    def of(cls, source, crop):
        """Part of a source, which knows what that does. Not collective."""
        array = cls(cropped(source, crop, 0, crop[3] - crop[2]), (), source.unit, source.spacing)
        array.file, array.lateral, array.orient = source.file, source.lateral, source.orient
        return array

    def rows(self, rows=slice(None)):
        """Return some rows as float64. Not collective."""
        return np.array(self._rows[rows], dtype=np.float64, order="C")


class HeightFile(ArrayFile):
    """Heights in a file, which may know their unit and spacing.

    Parameters
    ----------
    name : str
        As of `ArrayFile`.
    skip : int
        Lines at the head of a text that are none of the map.
    orient : sequence of str
        Some of `TURNS`, done one after the other, before all else. All of an HDF5 file is read then.

    Attributes
    ----------
    unit, lateral : str or None
        Of the heights, and of the spacing, if that is another one.
    spacing : pair of float or None
        dx, dy, after the turns.
    orient : tuple of str
        The turns that were done: those asked for, or else ``flip_y`` of an ESRI grid.
    """

    what, missing, preferred, marks = "surface file", "missing points", "heights", True
    _is_esri = False
    elsewhere = "python -m app.convert FILE -o surface.h5 reads what instruments write; else: "
    how_to_skip = (
        "skip the {0} at the head by skip={1} (-surface_skip {1}, app.convert --skip {1}), "
        "or begin them with #"
    )

    def __init__(self, name, skip=0, orient=()):
        super().__init__(name, skip)
        if self._is_esri:
            self._refuse_other_cells()
        self.unit, self.spacing, self.lateral = self._said("unit"), None, None
        given = self.attributes.get("spacing", self._cells_of_head())
        if given is not None:
            self.lateral = self._said("spacing_unit") or self.unit
            self.spacing = _sides(given)
            if self.spacing is None:
                raise InputError(f"surface file {name}: spacing {given}: needed: two positive numbers dx, dy")
        elif self._read_head():
            pass
        elif self.is_text and looks_like_points(self._rows):
            try:
                self._rows, self.spacing = gridded(self._rows)
            except ValueError as error:
                raise InputError(
                    f"surface file {name}: its lines of 3 numbers are no points x, y, z of a grid: {error} "
                    "(a map of 3 columns can be given as .npy)"
                ) from None
        if self._is_esri and not orient:
            orient = ("flip_y",)  # its rows go from north to south
        self._written, self.orient = self._rows, tuple(orient)
        if orient:
            self._rows = turned(self._rows[...], orient)
            self.spacing = turned_spacing(self.spacing, orient)

    def refuse_coordinates(self):
        """Refuse a text whose first row or column goes by equal steps, as x and y do, not heights.

        Not collective. A tilted plane is none: it does so in the second one, too.
        """
        if not self.is_text or self.spacing:
            return
        row, column = (int(_is_even(rows)) for rows in (self._written, self._written.T))
        if row or column:
            (ny, nx), what = self.shape, " and ".join(["row"] * row + ["column"] * column)
            heights = np.zeros(self._written.shape, bool)
            heights[row:, column:] = True
            j, i = np.nonzero(turned(heights, self.orient))
            crop = f"{i.min()},{i.max() + 1},{j.min()},{j.max() + 1}"
            raise InputError(
                f"surface file {self.file}: the first {what}: equal steps, as of coordinates, not of heights; leave "
                f"them out in the file or by crop=[{crop}] (-surface_crop {crop}, app.convert --crop), or keep them by "
                f"0,{nx},0,{ny}"
            )

    def _lines_of_head(self, lines, skip):
        head = lines[:skip] if skip else list(takewhile(_may_be_of_head, lines))
        said = {found[1].lower(): found[2] for found in map(_ESRI.fullmatch, head) if found}
        self._is_esri = {"ncols", "nrows"} <= said.keys()
        if not self._is_esri:
            return skip
        self._told = said["nrows"], said["ncols"]
        return len(head)

    def _refuse_other_cells(self):
        """An ESRI grid may go on in the next line wherever it likes; or it is cut off."""
        try:
            whole = self.shape == tuple(map(float, self._told))
        except ValueError:
            whole = False
        if not whole:
            raise InputError(
                f"surface file {self.file}: its head says nrows {self._told[0]}, ncols {self._told[1]}; there are "
                f"{self.shape[0]} lines of {self.shape[1]} numbers; needed: all rows of the map, each in a line"
            )

    def _read_head(self):
        """Take unit and spacing from comments as Gwyddion writes them; whether there is a spacing."""
        said = {found[1]: found.groups()[1:] for line in self.comments if (found := _SAID.fullmatch(line))}
        if "Value units" in said:
            self.unit = unit_named(said["Value units"][1])
        try:
            sides = [
                float(number.replace(",", ".")) * UNITS[unit_named(unit)]
                for number, unit in (said["Width"], said["Height"])
            ]
        except (LookupError, ValueError):
            return False
        if min(sides) > 0:
            self.spacing, self.lateral = (sides[0] / self.shape[1], sides[1] / self.shape[0]), "mm"
        return min(sides) > 0

    def _cells_of_head(self):
        """dx, dy as the head of an ESRI grid writes them; None if it has none."""
        found = filter(None, map(_CELLS.fullmatch, self.comments))
        said = {cell[1].lower(): cell[2].replace(",", ".") for cell in found}
        both = said.get("cellsize")
        return (said.get("dx", both), said.get("dy", both)) if said else None

    def _said(self, key):
        """Unit that an attribute names, or None."""
        if key not in self.attributes:
            return None
        unit = unit_named(self.attributes[key])
        if unit is None:
            raise InputError(f"surface file {self.file}: {key} {self.attributes[key]!r}; allowed: {ALLOWED}")
        return unit


def agreed_units(source, unit, height_unit, names=_UNIT_OPTIONS):
    """Unit of the heights and that of the spacing, from the file or from options, which must not say another one.

    Not collective.
    """
    given, of_unit, of_height = height_unit or unit, *names
    allowed = f"allowed: {ALLOWED}"
    if source.unit is None and given is None:
        cells = ", nor of its cells of {:g} x {:g}".format(*source.spacing) if source.spacing else ""
        raise InputError(
            f"{of_unit} is missing: surface file {source.file} does not say the unit of its heights{cells}; {allowed}"
        )
    if source.unit and given and given != source.unit:
        option = of_height if height_unit else of_unit
        raise InputError(f"{option} {given}: surface file {source.file} says {source.unit}")
    lateral = source.lateral or source.unit or unit
    if source.spacing and lateral is None:
        raise InputError(
            f"{of_unit} is missing: surface file {source.file} does not say the unit of its x and y, and {of_height} "
            f"is of z alone; {allowed}"
        )
    return source.unit or given, lateral


def agreed_spacing(source, lateral, given, orient):
    """Size of a cell, from the file or given [mm], or None. Not collective."""
    if source.spacing:
        if given is not None:
            raise InputError(f"spacing: surface file {source.file} says it itself")
        return tuple(UNITS[lateral] * side for side in source.spacing)
    if given is None:
        return None
    sides = _sides(given)
    if sides is None:
        raise InputError(f"spacing {given!r}: needed: two positive numbers dx, dy [mm]")
    return turned_spacing(sides, orient)


def _sides(given):
    """dx, dy; None if they are no two positive numbers."""
    try:
        dx, dy = map(float, given)
    except (TypeError, ValueError):
        return None
    return (dx, dy) if 0 < dx < np.inf and 0 < dy < np.inf else None


def checked_crop(source, crop):
    """Columns i0 to i1 - 1 and rows j0 to j1 - 1: those asked for, or all. Not collective."""
    ny, nx = source.shape
    if crop is None:
        return 0, nx, 0, ny
    try:
        i0, i1, j0, j1 = crop = tuple(map(index, crop))
    except (TypeError, ValueError):
        raise InputError(f"surface crop {crop!r}: needed: four whole numbers i0, i1, j0, j1") from None
    if not (0 <= i0 < i1 <= nx and 0 <= j0 < j1 <= ny):
        raise InputError(
            f"surface crop {i0},{i1},{j0},{j1}: not allowed; surface file {source.file} has columns 0,{nx} and rows "
            f"0,{ny}: needed: i0 < i1 and j0 < j1 within them"
        )
    return crop


def cropped(source, crop, start, stop):
    """Rows start to stop - 1 of the crop, in the file's unit. Not collective."""
    i0, i1, j0, _ = crop
    return np.ascontiguousarray(source.rows(slice(j0 + start, j0 + stop))[:, i0:i1])
