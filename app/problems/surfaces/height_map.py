"""Height maps with unit, spacing and orientation."""

import os
from itertools import islice
from operator import index

import numpy as np

from app.base.errors import InputError, to_float
from app.base.memory import check_fits
from app.base.units import ALLOWED, UNITS, find_unit
from app.problems.arrays import real_numbers
from app.problems.surfaces.array_file import StoredArray, read_array
from app.problems.surfaces.points import POINTS, arrange, detect_list
from app.problems.surfaces.text_heads import find_esri_entries, read_gwyddion_head

OPTIONS = (
    "unit= (-surface_unit)",
    "height_unit= (-surface_height_unit)",
    "spacing=",
    "override=True (app.convert --override)",
)  # names of options of `read_surface`, for messages; fmt: skip
MIN_COORDINATES = 8  # in a row; fewer heights may have equal steps by chance
MIN_LABELS = 4  # in a row whose corner is the only empty place of the table
MAX_COORDINATE_SPREAD = 0.1  # range of the steps of printed coordinates, over the largest step
MIN_HEIGHT_SPREAD = 0.5  # range of the steps of rough heights, over the largest step

TURNS = {
    "transpose": lambda rows: rows.T,
    "flip_x": lambda rows: rows[:, ::-1],
    "flip_y": lambda rows: rows[::-1],
}


def turn(rows, orient):
    """Apply turns to an array, one after the other.

    `orient` has names of `TURNS`, such as "flip_x".
    """
    for name in orient:
        rows = TURNS[name](rows)
    return rows


def turn_spacing(spacing, orient):
    """Return the spacing (dx, dy) after the turns `orient`, see `turn`."""
    return spacing[::-1] if spacing and orient.count("transpose") % 2 else spacing


class HeightMap(StoredArray):
    """Heights after turns, with unit and spacing as their source states them.

    The argument `spacing` is the size (dx, dy) of a cell before the turns; the attribute is the size after the turns.
    Units: `unit` of the heights, `lateral` of the spacing if it differs, and `other_unit` of values which are no
    lengths, such as V. What is unknown is None.
    """

    label = "surface file"

    def __init__(self, file, array, orient=(), spacing=None, unit=None, lateral=None, other_unit=None):
        super().__init__(file, array)
        self.orient, self.spacing = tuple(orient), turn_spacing(spacing, orient)
        self.unit, self.lateral, self.other_unit = unit, lateral, other_unit
        if orient:
            self._array = turn(self.rows(), orient)

    def check_crop(self, crop):
        """Return a checked crop; None means all."""
        ny, nx = self.shape
        try:
            i0, i1, j0, j1 = crop = tuple(map(index, (0, nx, 0, ny) if crop is None else crop))
        except (TypeError, ValueError):
            raise InputError(f"surface crop {crop!r}: must be four whole numbers i0, i1, j0, j1") from None
        if not (0 <= i0 < i1 <= nx and 0 <= j0 < j1 <= ny):
            raise InputError(
                f"surface crop {i0},{i1},{j0},{j1}: must be i0 < i1 and j0 < j1 within columns 0,{nx} and rows 0,{ny} "
                f"of surface file {self.file}"
            )
        check_fits(8.0 * (i1 - i0) * (j1 - j0), f"surface file {self.file}: {i1 - i0} x {j1 - j0} heights")
        return crop

    def cropped_rows(self, crop, start, stop):
        """Return some rows of a crop, in the unit of the source.

        The rows are `start` to `stop` - 1 of the crop.
        """
        i0, i1, j0, _ = crop
        return np.ascontiguousarray(self.rows(slice(j0 + start, j0 + stop))[:, i0:i1])

    def crop(self, crop):
        """Crop the map in place, as in `read_surface`."""
        i0, i1, j0, j1 = self.check_crop(crop)
        self._array = self.cropped_rows((i0, i1, j0, j1), 0, j1 - j0)

    def settle(self, unit=None, height_unit=None, spacing=None, override=False, options=OPTIONS):
        """Determine units and spacing from the source and arguments.

        If `override` is true, the arguments replace what the source states. `options` are the names of the four
        arguments in messages. Raises InputError if a unit is stated nowhere, if a unit or the spacing is stated twice
        with different values, or if `override` has no effect.
        """
        unit_option, height_option, spacing_option, override_option = options
        where, mend = f"surface file {self.file}", f"if that is wrong, add {override_option}"
        wanted_unit, allowed = height_unit or unit, f"it must be one of {ALLOWED}"
        if override:
            stated = self.unit or self.other_unit
            if not (spacing and self.spacing) and not (wanted_unit and stated):
                raise InputError(
                    f"{override_option}: has no effect: {where} states no unit or spacing that is given otherwise"
                )
            if height_unit:
                self.lateral = self.lateral or self.unit
            if wanted_unit:
                self.unit = self.other_unit = None
            if spacing:
                self.spacing = self.lateral = None
        if self.other_unit:
            raise InputError(
                f"{where}: says {self.other_unit}, which is no length that is known here; if its "
                f"values are heights all the same, state their unit by {unit_option} and {override_option}; {allowed}"
            )
        if not (self.unit or wanted_unit):
            cells = ", nor of its cells of {:g} x {:g}".format(*self.spacing) if self.spacing else ""
            raise InputError(
                f"{unit_option} is missing: {where} does not say the unit of its heights{cells}; {allowed}"
            )
        if self.unit and wanted_unit and wanted_unit != self.unit:
            raise InputError(
                f"{height_option if height_unit else unit_option} {wanted_unit}: {where} says {self.unit}; {mend}"
            )
        self.lateral = self.lateral or self.unit or unit
        self.unit = self.unit or wanted_unit
        if self.spacing and self.lateral is None:
            raise InputError(
                f"{unit_option} is missing: {where} does not say the unit of its x and y, and {height_option} is of z "
                f"alone; {allowed}"
            )
        if spacing is None:
            return
        if self.spacing:
            sides = " x ".join(f"{side:.7g}" for side in turn_spacing(self.spacing, self.orient))
            raise InputError(f"{spacing_option}: {where} says {sides} {self.lateral} itself; {mend}")
        sides = _positive_pair(spacing)
        if sides is None:
            raise InputError(f"{spacing_option} {spacing!r}: must be two positive numbers dx, dy [mm]")
        self.spacing, self.lateral = turn_spacing(sides, self.orient), "mm"

    @property
    def cell(self):
        """Size dx, dy of a cell [mm], or None; valid after `settle`."""
        return self.spacing and tuple(UNITS[self.lateral] * side for side in self.spacing)


def open_heights(path, skip=0, orient=(), channel="", coordinates=False):
    """Return the `HeightMap` of a file or array.

    `skip`, `orient` and `channel` are arguments of `read_surface`. A text that looks like a line scan, or that begins
    with coordinates, is an error. `coordinates` allows both, because a crop may remove coordinates.
    """
    channel = "" if channel is None else str(channel)
    if not isinstance(path, str | os.PathLike):
        if skip or channel:
            option = f"skip {skip}" if skip else f"channel {channel}"
            raise InputError(f"surface {option}: an array has no lines or channels")
        heights = real_numbers("surface", path, "a file name, or an array of real numbers")
        return HeightMap("(array)", heights, orient)
    content = read_array(path, "surface file", skip, channel)
    where, array = f"surface file {path}", content.array
    if content.esri:
        _check_esri(where, array.shape, content.esri["nrows"], content.esri["ncols"])
        orient = orient or ("flip_y",)
    stated = _read_stated(where, content)
    if content.is_text and not stated["spacing"]:
        kind = detect_list(array)
        if kind == POINTS:
            try:
                array, stated["spacing"] = arrange(array)
            except ValueError as error:
                raise InputError(
                    f"{where}: its lines of 3 numbers are no points x, y, z of a grid: {error} "
                    "(a map of 3 columns can be given as .npy)"
                ) from None
        elif not coordinates:
            _check_heights(where, array, kind, orient)
    return HeightMap(str(path), array, orient, **stated)


def _check_esri(where, shape, nrows, ncols):
    """Raise unless the array has the shape that the ESRI header states."""
    try:
        if shape == (float(nrows), float(ncols)):
            return
    except ValueError:
        pass
    raise InputError(
        f"{where}: its head says nrows {nrows}, ncols {ncols}; there are {shape[0]} lines of {shape[1]} numbers; "
        "each line must be a row of the map"
    )


def _read_stated(where, content):
    """Return unit and spacing that a file states, by arguments of `HeightMap`."""

    def length(key):
        if key not in content.attributes:
            return None
        unit = find_unit(content.attributes[key])
        if unit is None:
            raise InputError(f"{where}: {key} {content.attributes[key]!r}; must be one of {ALLOWED}")
        return unit

    stated = {"unit": length("unit"), "spacing": None, "lateral": None, "other_unit": None}
    esri = find_esri_entries(content.comments)
    sides = [esri.get(name, esri.get("cellsize")) for name in ("dx", "dy")]
    spacing = content.attributes.get("spacing", None if sides == [None, None] else tuple(sides))
    if spacing is not None:
        sides = _positive_pair(spacing)
        if sides is None:
            raise InputError(f"{where}: spacing {spacing}: must be two positive numbers dx, dy")
        return stated | {"spacing": sides, "lateral": length("spacing_unit")}
    unit, sides = read_gwyddion_head(content.comments)
    if unit:
        stated["unit"] = find_unit(unit)
        stated["other_unit"] = None if stated["unit"] else unit
    if sides:
        ny, nx = content.array.shape
        stated |= {"spacing": (sides[0] / nx, sides[1] / ny), "lateral": "mm"}
    return stated


def _positive_pair(values):
    try:
        one, other = map(to_float, values)
    except (TypeError, ValueError):
        return None
    return (one, other) if 0 < one < np.inf and 0 < other < np.inf else None


def _check_heights(where, array, kind, orient):
    lines, numbers = array.shape
    ny, nx = lines, numbers
    if orient.count("transpose") % 2:
        ny, nx = nx, ny
    if kind:
        raise InputError(
            f"{where}: {lines} lines of {numbers} numbers are {kind}, not a map; must be heights "
            "in rows and columns, or points x, y, z of a grid; if it is a map all the same, keep it by "
            f"crop=[0,{nx},0,{ny}] (-surface_crop 0,{nx},0,{ny}, app.convert --crop)"
        )
    row, column = (int(_begins_with_coordinates(rows)) for rows in (array, array.T))
    if row or column:
        names = " and ".join(["row"] * row + ["column"] * column)
        heights = np.zeros(array.shape, bool)
        heights[row:, column:] = True
        j, i = np.nonzero(turn(heights, orient))
        crop = f"{i.min()},{i.max() + 1},{j.min()},{j.max() + 1}"
        raise InputError(
            f"{where}: the first {names}: equal steps, as of coordinates, not of heights; leave "
            f"them out in the file or by crop=[{crop}] (-surface_crop {crop}, app.convert --crop), or keep them by "
            f"0,{nx},0,{ny}"
        )


def _begins_with_coordinates(rows):
    """Return whether the first row looks like coordinates.

    Coordinates have equal steps, except in the corner of the table. The next rows, the heights, have varying steps, or
    much smaller or larger steps. Rows without heights do not count.
    """
    fewest = MIN_LABELS if np.isnan(rows[0, 0]) and not np.isnan(rows[1:, 1:]).any() else MIN_COORDINATES
    if rows.shape[1] < fewest:
        return False
    steps = (np.diff(row[1:]) for row in rows)
    first = next(steps)
    steps = [first, *islice((row for row in steps if np.isfinite(row).sum() >= fewest - 2), 2)]
    if len(steps) < 3 or not np.isfinite(first).all():
        return False
    steps = [row[np.isfinite(row)] for row in steps]
    low, high, mean = (np.array([of(row) for row in steps]) for of in (np.min, np.max, np.mean))
    spread, largest = high - low, np.maximum(high, -low)
    if not largest[0] > 0 or spread[0] > MAX_COORDINATE_SPREAD * largest[0]:
        return False
    # A plane has equal steps in the second row, too. Heights that are tapered at the rim have more equal steps there.
    rough = spread[1] >= MIN_HEIGHT_SPREAD * max(largest[1], spread[2]) and spread[1] > 0
    # A row of tilted heights has the slope of the next one, except for roughness or a twist.
    jump, change = np.abs(np.diff(mean))
    steeper = largest[1] > 0 and jump > max(*spread[1:], 10 * change, 0.01 * largest[:2].max())
    clear = spread[0] <= 0.01 * spread[1:].min() and jump >= 0.05 * np.abs(mean[:2]).max()
    return bool(rough or steeper or clear)
