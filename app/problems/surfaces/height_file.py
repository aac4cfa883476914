"""Heights in a file: units, how rows and columns lie, points x, y, z as a map; what file and options say together."""

from __future__ import annotations

import os
from itertools import islice
from operator import index

import numpy as np

from app.base.errors import InputError
from app.base.memory import check_fits
from app.base.units import ALLOWED, UNITS, find_unit
from app.problems.arrays import real_numbers
from app.problems.surfaces.array_file import ArrayFile
from app.problems.surfaces.points import gridded, listed, looks_like_points
from app.problems.surfaces.text_heads import cells_of, esri_head, gwyddion_head

# What says the unit of heights and of points, that of the heights alone, and that a file is wrong.
_UNIT_OPTIONS = (
    "unit= (-surface_unit)",
    "height_unit= (-surface_height_unit)",
    "override=True (app.convert --override)",
)
_FEW = 8  # heights in a row, that may go by equal steps by chance
_EVEN, _UNEVEN = 0.1, 0.5  # by how much steps differ, in the largest: of printed coordinates, of heights
_MORE_EVEN, _STEEPER = (
    0.01,
    0.05,
)  # steps of coordinates over those of heights: spreads; difference of their means
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
    if rows.shape[1] < _FEW:
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
    clear = spread[0] <= _MORE_EVEN * spread[1:].min() and other >= _STEEPER * np.abs(mean[:2]).max()
    return bool(uneven or clear or (largest[1] > 0 and another))


class HeightArray:
    """Heights in memory, (ny, nx), as if they were a `HeightFile`; see there."""

    file, lateral, other_unit = "(array)", None, None

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
        for name in "file", "lateral", "orient", "other_unit":
            setattr(array, name, getattr(source, name))
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
    channel : str
        As of `ArrayFile`.

    Attributes
    ----------
    unit, lateral : str or None
        Of the heights, and of the spacing, if that is another one.
    other_unit : str or None
        Unit of the values that the file states, if it is no length.
    spacing : pair of float or None
        dx, dy, after the turns.
    orient : tuple of str
        The turns that were done: those asked for, or else ``flip_y`` of an ESRI grid.
    """

    what, missing, preferred, marks = "surface file", "missing points", "heights", True
    elsewhere = "python -m app.convert FILE -o surface.h5 reads what instruments write"
    how_to_skip = (
        "skip the {0} at the head by skip={1} (-surface_skip {1}, app.convert --skip {1}), "
        "or begin them with #"
    )
    how_to_choose = "; choose one by app.convert --channel, or channel= of read_surface"

    def __init__(self, name, skip=0, orient=(), channel=""):
        self._esri = {}
        super().__init__(name, skip, channel)
        self._refuse_other_cells()
        self.unit, self.spacing, self.lateral, self.other_unit = self._said("unit"), None, None, None
        self._read_head()
        if not self.spacing and self.is_text and looks_like_points(self._rows):
            try:
                self._rows, self.spacing = gridded(self._rows)
            except ValueError as error:
                raise InputError(
                    f"surface file {name}: its lines of 3 numbers are no points x, y, z of a grid: {error} "
                    "(a map of 3 columns can be given as .npy)"
                ) from None
        if self._esri and not orient:
            orient = ("flip_y",)  # its rows go from north to south
        self._written, self.orient = self._rows, tuple(orient)
        if orient:
            self._rows = turned(self.rows(), orient)
            self.spacing = turned_spacing(self.spacing, orient)

    def refuse_coordinates(self):
        """Refuse a text whose numbers are coordinates, not heights: those of a line scan, or at the rim of a map.

        Not collective. Coordinates increase by equal steps. A tilted plane does so in the second row, too.
        """
        if not self.is_text or self.spacing:
            return
        (ny, nx), (lines, numbers) = self.shape, self._written.shape
        if what := listed(self._written):
            raise InputError(
                f"surface file {self.file}: {lines} lines of {numbers} numbers are {what}, not a map; needed: heights "
                "in rows and columns, or points x, y, z of a grid; if it is a map all the same, keep it by "
                f"crop=[0,{nx},0,{ny}] (-surface_crop 0,{nx},0,{ny}, app.convert --crop)"
            )
        row, column = (int(_is_even(rows)) for rows in (self._written, self._written.T))
        if row or column:
            what = " and ".join(["row"] * row + ["column"] * column)
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
        self._esri, count = esri_head(lines, skip)
        return count

    def _refuse_other_cells(self):
        """An ESRI grid may go on in the next line wherever it likes; or it is cut off."""
        if not self._esri:
            return
        told = self._esri["nrows"], self._esri["ncols"]
        try:
            whole = self.shape == tuple(map(float, told))
        except ValueError:
            whole = False
        if not whole:
            raise InputError(
                f"surface file {self.file}: its head says nrows {told[0]}, ncols {told[1]}; there are "
                f"{self.shape[0]} lines of {self.shape[1]} numbers; needed: all rows of the map, each in a line"
            )

    def _read_head(self):
        """Take unit and spacing from attributes or from the head of a text."""
        spacing = self.attributes.get("spacing", cells_of(self.comments))
        if spacing is not None:
            self.spacing, self.lateral = _sides(spacing), self._said("spacing_unit")
            if self.spacing is None:
                raise InputError(
                    f"surface file {self.file}: spacing {spacing}: needed: two positive numbers dx, dy"
                )
            return
        unit, sides = gwyddion_head(self.comments)
        if unit:
            self.unit = find_unit(unit)
            self.other_unit = None if self.unit else unit
        if sides:
            self.spacing, self.lateral = (sides[0] / self.shape[1], sides[1] / self.shape[0]), "mm"

    def _said(self, key):
        """Unit that an attribute names, or None."""
        if key not in self.attributes:
            return None
        unit = find_unit(self.attributes[key])
        if unit is None:
            raise InputError(f"surface file {self.file}: {key} {self.attributes[key]!r}; allowed: {ALLOWED}")
        return unit


def open_heights(path, skip=0, orient=(), channel="", coordinates=False):
    """Return a `HeightFile` of a path, or a `HeightArray` of an array.

    Not collective.

    Parameters
    ----------
    path : str or Path, or array_like, shape (ny, nx)
    skip, orient, channel
        As of `HeightFile`.
    coordinates : bool
        Whether coordinates among the numbers of a text are allowed.
    """
    channel = "" if channel is None else str(channel)
    if isinstance(path, str | os.PathLike):
        source = HeightFile(path, skip, orient, channel)
        if not coordinates:
            source.refuse_coordinates()
        return source
    if skip or channel:
        what = (
            f"skip {skip}: of an array there are no lines"
            if skip
            else f"channel {channel}: of an array there are none"
        )
        raise InputError(f"surface {what}")
    return HeightArray(real_numbers("surface", path, "a file name, or an array of real numbers"), orient)


def replace_stated(source, unit, height_unit, spacing, option):
    """Forget what a source states itself where options replace it.

    Not collective.

    Parameters
    ----------
    unit, height_unit, spacing
        As of `agreed_units` and `agreed_spacing`.
    option : str
        Name of the option that asks for it, for messages.

    Raises
    ------
    InputError
        If the options replace nothing.
    """
    stated = source.unit or source.other_unit
    if not (spacing and source.spacing) and not ((unit or height_unit) and stated):
        raise InputError(
            f"{option}: has no effect: surface file {source.file} states no unit or spacing that is given otherwise"
        )
    if height_unit:
        source.lateral = source.lateral or source.unit
    if unit or height_unit:
        source.unit = source.other_unit = None
    if spacing:
        source.spacing = source.lateral = None


def agreed_units(source, unit, height_unit, names=_UNIT_OPTIONS):
    """Unit of the heights and that of the spacing, from the file or from options, which must not say another one.

    Not collective.
    """
    given, (of_unit, of_height, override) = height_unit or unit, names
    allowed = f"allowed: {ALLOWED}"
    if source.other_unit:
        raise InputError(
            f"surface file {source.file}: says {source.other_unit}, which is no length that is known here; if its "
            f"values are heights all the same, state their unit by {of_unit} and {override}; {allowed}"
        )
    if source.unit is None and given is None:
        cells = ", nor of its cells of {:g} x {:g}".format(*source.spacing) if source.spacing else ""
        raise InputError(
            f"{of_unit} is missing: surface file {source.file} does not say the unit of its heights{cells}; {allowed}"
        )
    if source.unit and given and given != source.unit:
        option = of_height if height_unit else of_unit
        raise InputError(
            f"{option} {given}: surface file {source.file} says {source.unit}; if that is wrong, add {override}"
        )
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
            raise InputError(
                f"spacing: surface file {source.file} says it itself; if that is wrong, add {_UNIT_OPTIONS[2]}"
            )
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
    try:
        i0, i1, j0, j1 = crop = tuple(map(index, (0, nx, 0, ny) if crop is None else crop))
    except (TypeError, ValueError):
        raise InputError(f"surface crop {crop!r}: needed: four whole numbers i0, i1, j0, j1") from None
    if not (0 <= i0 < i1 <= nx and 0 <= j0 < j1 <= ny):
        raise InputError(
            f"surface crop {i0},{i1},{j0},{j1}: not allowed; surface file {source.file} has columns 0,{nx} and rows "
            f"0,{ny}: needed: i0 < i1 and j0 < j1 within them"
        )
    check_fits(8.0 * (i1 - i0) * (j1 - j0), f"surface file {source.file}: {i1 - i0} x {j1 - j0} heights")
    return crop


def cropped(source, crop, start, stop):
    """Rows start to stop - 1 of the crop, in the file's unit. Not collective."""
    i0, i1, j0, _ = crop
    return np.ascontiguousarray(source.rows(slice(j0 + start, j0 + stop))[:, i0:i1])
