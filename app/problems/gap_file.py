"""An undeformed distance in a file, as a base shape."""

from __future__ import annotations

from app.errors import InputError
from app.problems.array_file import ArrayFile


class GapFile(ArrayFile):
    """Undeformed distance at zero approach [mm] from an `ArrayFile`; NaN: contact impossible.

    Not collective: every rank opens the file for itself, and reads its own rows where the format allows it.
    """

    what, missing = "gap file", "cells where contact is impossible"
    name, sampled = "file", True

    @property
    def notes(self):
        """What the user should look at twice."""
        ny, nx = self.shape
        if nx == 3 and ny > 9:
            return (f"gap file {self.file}: taken for {ny} rows of 3 cells, not for points x, y, z",)
        return ()

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
