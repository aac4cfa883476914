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

from dataclasses import dataclass

from app.halfspace.grid import Grid
from app.halfspace.influence import Material


@dataclass(frozen=True)
class Problem:
    """A patch of cells, a material and a shape.

    Subclasses know the geometry. `sampled` says that the shape is known on the target grid only, so that
    coarse grids have to average it instead of asking again.
    """

    grid: Grid
    material: Material

    name = ""
    sampled = False

    def shape_on(self, grid, rows=slice(None)):
        """Undeformed distance at zero approach in the cell centres of the given rows.

        Not collective.

        Returns
        -------
        ndarray, shape (rows, nx), [mm]
            NaN in inadmissible cells.
        """
        raise NotImplementedError(f"{type(self).__name__}.shape_on")

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
