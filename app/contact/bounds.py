"""What the pressure may be in each cell of a grid, and all that follows from it.

A cell of the contact set C has a pressure between its bounds and no gap. Every other cell has the pressure of a bound:
zero where it is open. Each grid, and each window of one, has its `PressureBounds` in its `UndeformedDistance`, and all
methods ask them. An upper bound is a subclass that overrides the methods below. It needs no set of its own, because
the pressure says which bound a cell outside C is at.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.contact import bounds_kernels as loops


class PressureBounds:
    """Bounds of the pressure on one grid: at least 0, and 0 in inadmissible cells.

    Pressure and contact set are arguments, of shape (local rows, nx). Not collective.

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)

    Attributes
    ----------
    lower, upper : float
        In the admissible cells [N/mm2].
    largest_load : float
        That they allow on all of the grid [N].
    rounding : float
        Violation that may be rounding, as a share of the highest pressure. The certificate is of such pressures.
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
        """Return the bounds in a window; ``cut(field)`` is the part of a field there. As collective as `cut`."""
        return type(self)(cut(self.admissible))

    def change(self, p, step):
        """Return by how much the projection of p + step differs from p, an allowed pressure [N/mm2]."""
        return np.where(self.admissible, np.maximum(p + step, self.lower) - p, 0.0)

    def to_bound(self, p, contact):
        """Return the change of p that takes cells outside C to their bounds [N/mm2]."""
        return np.where(contact, 0.0, self.lower - p)

    def between(self, p, margin=0.0):
        """Return the cells whose pressure is farther than a margin from its bounds."""
        return self.admissible & (p > self.lower + margin)

    def contact(self, p, gap, margin=0.0):
        """Return the cells that belong to C: those `between`, and those which their gap takes off their bounds."""
        return self.between(p, margin) | (self.admissible & (gap <= 0))

    def overlap(self, p, gap):
        """Return the negative gaps of cells without pressure, which (2.10) forbids, or 0, as a flat array [mm]."""
        return gap[self.admissible & ~self.between(p)].clip(max=0)

    def mean_pressures(self, waves):
        """Return the least and the largest mean pressure which makes p of `waves`, a field without mean, allowed.

        They are those of the cells of this rank [N/mm2].
        """
        return self.lower - waves.min(initial=np.inf), self.upper

    def vecs(self, pressure):
        """Return the bounds as two Vecs like a pressure, for TAO and SNESVI. Collective."""
        lower, upper = pressure.duplicate(), pressure.duplicate()
        for vec, bound in ((lower, self.lower), (upper, self.upper)):
            vec.setArray(np.where(self.admissible, np.minimum(bound, PETSc.INFINITY), 0.0).reshape(-1))
        return lower, upper
