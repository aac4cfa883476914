"""Heights in a file: their units, the way their rows and columns lie, points x, y, z as a map."""

from __future__ import annotations

import re

import numpy as np

from app.problems.array_file import ArrayFile
from app.problems.points import gridded, looks_like_points
from app.units import UNITS, unit_named

# At the head of Gwyddion's ASCII export: the size of the map, and the unit of its heights.
_SAID = re.compile(r"#\s*(Width|Height|Value units):\s*([\d.,eE+-]*)\s*(\S+)\s*")

TURNS = {
    "transpose": lambda rows: rows.T,
    "flip_x": lambda rows: rows[:, ::-1],
    "flip_y": lambda rows: rows[::-1],
}


def turned(rows, spacing, orient):
    """Rows and columns of an array, and their spacing dx, dy or None, after some `TURNS`. Not collective."""
    for turn in orient:
        rows = TURNS[turn](rows)
    return rows, spacing[::-1] if spacing and orient.count("transpose") % 2 else spacing


class HeightArray:
    """Heights in memory, (ny, nx), as if they were a `HeightFile` that says neither unit nor spacing."""

    file, unit, lateral, spacing = "(array)", None, None, None

    def __init__(self, heights, orient=()):
        self._rows, _ = turned(np.array(heights), None, orient)
        if self._rows.ndim != 2 or not self._rows.size:
            raise ValueError(
                f"surface {self.file}: has shape {self._rows.shape}; needed: (ny, nx), or a file name"
            )
        self.shape = self._rows.shape

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
    """

    what, missing, preferred, marks = "surface file", "missing points", "heights", True
    how_to_skip = (
        "skip the {0} at the head by -surface_skip {1} (app.convert: --skip {1}), or begin them with #"
    )

    def __init__(self, name, skip=0, orient=()):
        super().__init__(name, skip)
        self.unit, self.spacing, self.lateral = self._said("unit"), None, None
        if "spacing" in self.attributes:
            self.lateral = self._said("spacing_unit") or self.unit
            self.spacing = tuple(np.atleast_1d(np.asarray(self.attributes["spacing"], float)))
            if len(self.spacing) != 2 or not (np.isfinite(self.spacing).all() and min(self.spacing) > 0):
                raise ValueError(
                    f"surface file {name}: spacing {self.spacing}: needed: two positive numbers dx, dy"
                )
        elif self._read_head():
            pass
        elif self.is_text and looks_like_points(self._rows.shape):
            try:
                self._rows, self.spacing = gridded(self._rows)
            except ValueError as error:
                raise ValueError(
                    f"surface file {name}: its lines of 3 numbers are no points x, y, z of a grid: {error} "
                    "(a map of 3 columns can be given as .npy)"
                ) from None
        if orient:
            self._rows, self.spacing = turned(self._rows[...], self.spacing, orient)

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

    def _said(self, key):
        """Unit that an attribute names, or None."""
        if key not in self.attributes:
            return None
        unit = unit_named(self.attributes[key])
        if unit is None:
            raise ValueError(
                f"surface file {self.file}: {key} {self.attributes[key]!r}; allowed: {', '.join(UNITS)}"
            )
        return unit
