"""A problem given by a program: the undeformed distance as an array or a function."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.errors import InputError
from app.halfspace.grid import symbol_name
from app.options import LARGEST
from app.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class ContactProblem(Problem):
    """Two bodies on a patch of cells: grid, material, undeformed distance.

    Parameters
    ----------
    grid : Grid
    material : Material
    gap : array_like, shape (ny, nx), or callable, [mm]
        Undeformed distance at zero approach in the cell centres; NaN where contact is impossible. An array is all of it
        on every rank, first row at the smallest y. A function ``gap(x, y)`` is called with arrays that broadcast to the
        cells wanted; it is asked again on every coarser grid, where an array is averaged.
    periodic : bool or str
        Whether the patch repeats for ever in x and y; True is "spectral", see `app.halfspace.periodic`.

    Raises
    ------
    InputError
        If the array has another shape, no cell where contact is possible, or is not made of numbers.

    Examples
    --------
    >>> from app import ContactProblem, Grid, Material
    >>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
    >>> sphere.shape_on(grid).shape
    (64, 64)
    """

    gap: object = None
    periodic: bool | str = False

    name = "given"

    def __post_init__(self):
        if self.periodic:
            object.__setattr__(self, "grid", replace(self.grid, periodic=symbol_name(self.periodic)))
        if callable(self.gap):
            return
        try:
            gap = np.asarray(self.gap, dtype=float)
        except (TypeError, ValueError):
            raise InputError("gap: needed: an array of numbers, or a function of x and y") from None
        if gap.shape != self.grid.shape:
            raise InputError(f"gap: has shape {gap.shape}; the grid needs (ny, nx) = {self.grid.shape}")
        if (np.abs(gap) > LARGEST).any():
            raise InputError(f"gap: allowed: numbers up to {LARGEST:g}, and NaN where contact is impossible")
        object.__setattr__(self, "gap", gap)

    @property
    def sampled(self):
        """Whether the gap is known in the cells of the grid only."""
        return not callable(self.gap)

    def shape_on(self, grid, rows=slice(None)):
        """See `Problem.shape_on`."""
        if self.sampled:
            return np.array(self.gap[rows], order="C")
        x, y = grid.x()[None, :], grid.y(rows)[:, None]
        shape = (y.shape[0], grid.nx)
        values = np.array(np.broadcast_to(np.asarray(self.gap(x, y), dtype=float), shape), order="C")
        if (np.abs(values) > LARGEST).any():
            raise InputError(f"gap: allowed: numbers up to {LARGEST:g}, and NaN where contact is impossible")
        return values
