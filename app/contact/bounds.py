"""Bounds of the pressure, and operations on them.

A cell of the contact set C has no gap and a pressure between its bounds, (2.1). Any other cell has the pressure of a
bound, (2.2): zero where it is open. Each grid, and each window of one, has its `PressureBounds` in its
`UndeformedDistance`; all methods use them. An upper bound is a subclass that overrides the methods below. It needs no
set of its own, because the pressure of a cell outside C is that of its bound.
"""

import numpy as np
from petsc4py import PETSc

from app.contact import bounds_kernels as loops


class PressureBounds:
    """Bounds p >= 0 on one grid.

    Inadmissible cells have p = 0. Pressure and contact set are arguments, of shape (local rows, nx).

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)

    Attributes
    ----------
    lower, upper : float
        In the admissible cells [N/mm2].
    largest_load : float
        Largest load on the whole grid [N].
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
        """Return the bounds in a window; ``cut(field)`` cuts a field."""
        return type(self)(cut(self.admissible))

    def change(self, p, step):
        """Return the projected step from p [N/mm2]."""
        return np.where(self.admissible, np.maximum(p + step, self.lower) - p, 0.0)

    def to_bound(self, p, contact):
        """Return the change that moves p outside C to its bounds [N/mm2]."""
        return np.where(contact, 0.0, self.lower - p)

    def between(self, p, margin=0.0):
        """Return the cells whose pressure is off its bounds by a margin."""
        return self.admissible & (p > self.lower + margin)

    def contact(self, p, gap, margin=0.0):
        """Return the cells between bounds, or overlapping."""
        return self.between(p, margin) | (self.admissible & (gap <= 0))

    def overlap(self, p, gap):
        """Return the negative gaps of cells without pressure, flat [mm]."""
        return gap[self.admissible & ~self.between(p)].clip(max=0)  # (2.10)

    def mean_pressures(self, waves):
        """Return the range of m with m + waves allowed [N/mm2].

        `waves` is a field without mean. The numbers are for the cells of this rank.
        """
        return self.lower - waves.min(initial=np.inf), self.upper

    def vecs(self, pressure):
        """Return the bounds as Vecs, for TAO and SNESVI. Collective."""
        lower, upper = pressure.duplicate(), pressure.duplicate()
        for vec, bound in ((lower, self.lower), (upper, self.upper)):
            vec.setArray(np.where(self.admissible, np.minimum(bound, PETSc.INFINITY), 0.0).reshape(-1))
        return lower, upper
