"""An undeformed distance in a file, as a base shape."""

from __future__ import annotations

from app.base.errors import InputError
from app.problems.surfaces.array_file import ArrayFile
from app.problems.surfaces.points import listed, looks_like_points
from app.problems.surfaces.text_heads import gwyddion_head


class GapFile(ArrayFile):
    """Undeformed distance at zero approach [mm] from an `ArrayFile`; NaN: contact impossible.

    Not collective: every rank opens the file for itself, and reads its own rows where the format allows it.
    """

    what, missing = "gap file", "cells where contact is impossible"
    name, sampled = "file", True

    def __init__(self, name):
        super().__init__(name)
        unit, _ = gwyddion_head(self.comments)
        if unit not in (None, "mm"):
            raise InputError(f"gap file {name}: says {unit}; needed: mm")
        if not self.is_text:
            return
        if what := "points x, y, z" * looks_like_points(self._rows) or listed(self._rows):
            raise InputError(
                f"gap file {name}: {self.shape[0]} lines of {self.shape[1]} numbers are {what}, not a map; needed: the "
                "gap of all cells in rows and columns, without x and y; such narrow ones as .npy"
            )

    def check_grid(self, grid):
        """Refuse a grid of another shape."""
        if self.shape != grid.shape:
            raise InputError(
                f"gap file {self.file}: has shape {self.shape}; -grid {grid.nx},{grid.ny} "
                f"needs (ny, nx) = {grid.shape}"
            )

    def shape_on(self, grid, rows=slice(None)):
        """See `Problem.shape_on`; only on the grid of the file."""
        if grid.shape != self.shape:
            raise ValueError("a sampled gap is known on its own grid only")
        return self.rows(rows)

    def describe(self):
        """See `Problem.describe`."""
        return {"gap_file": self.file}
