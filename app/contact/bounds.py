"""Bounds of the pressure, and operations on them.

A cell of the contact set C has no gap and a pressure between its bounds (2.1). Any other cell has the pressure of
a bound (2.2): zero where it is open. The `UndeformedDistance` of each grid or window has its `PressureBounds`, which
all methods use. To add an upper bound, write a subclass that overrides the methods below. It needs no second
contact set, because the pressure of a cell outside C shows at which bound the cell is.
"""

import numpy as np
from petsc4py import PETSc

from app.contact import bounds_kernels as loops


class PressureBounds:
    """Bounds p >= 0 on one grid.

    Inadmissible cells have p = 0. Methods receive the pressure and the contact set, of shape (local rows, nx).

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)
        True in cells that may be in contact.

    Attributes
    ----------
    lower, upper : float
        Bounds of the pressure in admissible cells [N/mm2].
    largest_load : float
        Largest load that the whole grid can carry [N].
    rounding : float
        Violation that may be rounding, as a share of the highest pressure.
    release, activate, exchange, project, tension : callable
        Compiled loops, see `app.contact.bounds_kernels`.
    """

    lower, upper, largest_load, rounding = 0.0, np.inf, np.inf, 1e-14

    release = staticmethod(loops.release)
    activate = staticmethod(loops.activate)
    exchange = staticmethod(loops.exchange)
    project = staticmethod(loops.project)
    tension = staticmethod(loops.tension)

    def __init__(self, admissible):
        self.admissible = admissible

    def part(self, cut):
        """Return the bounds in a window; ``cut(field)`` restricts a field to it."""
        return type(self)(cut(self.admissible))

    def change(self, p, step):
        """Return the change of p by `step`, clipped to the bounds [N/mm2]."""
        return np.where(self.admissible, np.maximum(p + step, self.lower) - p, 0.0)

    def to_bound(self, p, contact):
        """Return the change that moves p outside C to its bounds [N/mm2]."""
        return np.where(contact, 0.0, self.lower - p)

    def between(self, p, margin=0.0):
        """Return a mask of cells with p > lower bound + margin."""
        return self.admissible & (p > self.lower + margin)

    def contact(self, p, gap, margin=0.0):
        """Return a mask of cells that are `between` bounds or overlap."""
        return self.between(p, margin) | (self.admissible & (gap <= 0))

    def overlap(self, p, gap):
        """Return min(gap, 0) of the cells without pressure, 1D [mm]."""
        return gap[self.admissible & ~self.between(p)].clip(max=0)  # (2.10)

    def mean_pressures(self, waves):
        """Return the least and largest allowed mean pressure [N/mm2].

        The pressure is the mean plus `waves`, a field whose mean is 0. With the least mean or more, no cell of this
        rank is below the lower bound. The mean of a pressure never exceeds the upper bound.
        """
        return self.lower - waves.min(initial=np.inf), self.upper

    def vecs(self, pressure):
        """Return the bounds as Vecs, for TAO and SNESVI. Collective."""
        lower, upper = pressure.duplicate(), pressure.duplicate()
        for vec, bound in ((lower, self.lower), (upper, self.upper)):
            vec.setArray(np.where(self.admissible, np.minimum(bound, PETSc.INFINITY), 0.0).reshape(-1))
        return lower, upper
