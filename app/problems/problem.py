"""What every contact problem offers.

========================  ===========================  ====
paper                     here                         unit
========================  ===========================  ====
h(x, y)                   ``shape - approach``         mm
delta                     ``approach``                 mm
========================  ===========================  ====

`shape` is the undeformed distance at zero approach; NaN where contact is impossible (*inadmissible* cells:
outside a punch, holes in measured data).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from app.base.errors import InputError
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.problems.arrays import check_size, real_numbers


@dataclass(frozen=True)
class Problem:
    """A patch of cells, a material and a shape.

    Subclasses know the geometry. `sampled` says that coarse grids are to average the shape of the target grid instead
    of asking again, as where it is known there only.
    """

    grid: Grid
    material: Material

    name = ""
    sampled = False
    notes = ()  # what a user should look at twice, a line each

    def shape_on(self, grid, rows=slice(None)):
        """Undeformed distance at zero approach in the cell centres of the given rows.

        Not collective.

        Returns
        -------
        ndarray, shape (rows, nx), [mm]
            NaN in inadmissible cells.
        """
        raise NotImplementedError(f"{type(self).__name__}.shape_on")

    def fits(self, other):
        """Whether another problem has the same grid and material. Not collective."""
        return isinstance(other, Problem) and (other.grid, other.material) == (self.grid, self.material)

    @property
    def periodic(self):
        """Symbol of a periodic patch, empty on a free one: the grid's. Not collective."""
        return self.grid.periodic

    @property
    def refinable(self):
        """Whether the shape can be asked for on finer grids than the problem's own. Not collective."""
        return not self.sampled

    def on(self, grid):
        """Return the same problem on another grid of the same patch, if it is `refinable`. Not collective."""
        other = copy(self)
        object.__setattr__(other, "grid", grid)
        return other

    def reference(self, approach):
        """Analytic solution at this approach (see `app.reference`), or None. Not collective."""
        return None

    def describe(self):
        """Data of the problem for the result file: name -> number or text. Not collective."""
        grid = self.grid
        return {
            "problem": self.name,
            **self.material.describe(),
            "periodic": int(bool(grid.periodic)),
            "periodic_symbol": grid.periodic,
        }


def checked_shape(problem, grid, rows):
    """`Problem.shape_on`, as float64 in memory of its own, NaN for masked cells, or why it is no such thing.

    Not collective.

    Raises
    ------
    InputError
    """
    expected = len(range(*rows.indices(grid.ny))), grid.nx
    if not expected[0]:  # nobody need answer for no cells
        return np.empty(expected)
    what = f"problem {problem.name}"
    shape = real_numbers(what, problem.shape_on(grid, rows), "undeformed distances, an array of real numbers")
    if shape.shape != expected:
        raise InputError(
            f"{what}: undeformed distances of shape {shape.shape}; needed: (rows, nx) = {expected}"
        )
    check_size(what, shape, rows.start or 0)
    return np.ascontiguousarray(shape)
