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

from app.errors import InputError
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.options import LARGEST


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


def real_numbers(what, values, needed="an array of real numbers, or a function of x and y"):
    """Array of float64 in memory of its own; masked entries become NaN. Not collective.

    Raises
    ------
    InputError
        Of texts, complex numbers and None, too, which numpy would turn into real ones.
    """
    try:
        found = np.asanyarray(values)
        if found.dtype.kind in "biufO" and values is not None:
            return np.asarray(np.ma.filled(found.astype(float), np.nan))
    except (TypeError, ValueError):
        pass
    raise InputError(f"{what}: needed: {needed}") from None


def lattice(x, y, origin):
    """Columns x and rows y of a lattice, from an origin, shapes (nx,) and (ny,) [mm]. Not collective.

    Raises
    ------
    InputError
        If they are none, such as those of every point.
    """
    x, y = real_numbers("x", x, "columns of a lattice"), real_numbers("y", y, "rows of a lattice")
    if (x.ndim, y.ndim) != (1, 1):
        shapes = f"shapes {x.shape} and {y.shape}"
        raise InputError(f"x, y: have {shapes}; needed: (nx,) and (ny,), columns and rows of a lattice")
    return x - origin[0], y - origin[1]


def refuse_large(what, values, first_row=0):
    """Refuse numbers that cannot be squared, infinite ones too. Not collective.

    Parameters
    ----------
    what : str
        Of which they are, for the message.
    values : ndarray, shape (rows, nx)
        NaN is allowed.
    first_row : int
        Number of the first one.

    Raises
    ------
    InputError
    """
    large = np.abs(values) > LARGEST
    if large.any():
        j, i = np.argwhere(large)[0]
        raise InputError(
            f"{what}: {values[j, i]:g} in row {j + first_row}, column {i}; allowed: numbers up to {LARGEST:g}, and NaN "
            "where contact is impossible"
        )


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
    refuse_large(what, shape, rows.start or 0)
    return np.ascontiguousarray(shape)
