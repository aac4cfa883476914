"""Permanent indentation of a solution, as a surface."""

import numpy as np

from app.base.types import Floats
from app.halfspace.grid import Grid
from app.problems.arrays import check_shape


class ResidualSurface:
    """Permanent indentation, as a surface of `ContactProblem`.

    The heights are negative, because heights are subtracted from the gap, and the indentation enlarges the gap. The
    indentation is what is left after unloading. On the indented bodies, loads below the solution's load are elastic. If
    the problem has a hardness, the plastic depth of its solutions includes this indentation.

    Parameters
    ----------
    depth : ndarray, shape (ny, nx), [mm]
        Plastic depth in all cells, the same array on every rank.
    """

    sampled = by_rows = True

    def __init__(self, depth: Floats) -> None:
        self.depth = depth

    def __repr__(self):
        ny, nx = self.depth.shape
        return f"<ResidualSurface: {nx} x {ny} cells, depth up to {self.depth.max():.4g} mm>"

    def check_grid(self, grid: Grid) -> None:
        """Raise if a grid's shape is not the indentation's."""
        check_shape("residual surface", self.depth.shape, grid)

    def heights_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return heights of the cells in `rows` of a grid [mm].

        The grid must be the solution's grid.
        """
        if grid.shape != self.depth.shape:
            raise ValueError("a residual surface is known on its own grid only")
        return np.negative(self.depth[rows])

    def describe(self) -> dict[str, float]:
        """Return the largest depth, for the result file [mm]."""
        return {"residual_depth": float(self.depth.max())}
