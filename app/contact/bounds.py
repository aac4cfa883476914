"""Bounds of the pressure, and operations on them.

A cell of the contact set C has no gap and a pressure between its bounds (2.1). Any other cell has the pressure of a
bound (2.2): zero where it is open, the hardness H where it is plastic. The `UndeformedDistance` of each grid or window
has `PressureBounds`, which all methods use. Plastic cells need no set of their own, because the pressure of a cell
outside C shows at which bound the cell is.
"""

import numpy as np
from petsc4py import PETSc

from app.contact import bounds_kernels as loops
from app.contact import capped_kernels


class PressureBounds:
    """Bounds p >= 0 on one grid.

    Inadmissible cells, where contact is impossible, have p = 0. The arguments of methods are the pressure and the
    contact set, shape (local rows, nx).

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)
        True in cells that may be in contact.

    Attributes
    ----------
    lower : float
        Lower bound of the pressure in admissible cells [N/mm2].
    upper : float, or ndarray of shape (local rows, nx)
        Upper bound [N/mm2].
    capped : bool
        True if there is an upper bound.
    largest_load : float
        Largest load that the whole grid can carry [N].
    rounding : float
        Largest violation of the bounds that may be rounding, divided by the highest pressure.
    release, activate, exchange, project, tension : callable
        Compiled loops, see `app.contact.bounds_kernels`.
    """

    lower, upper, capped, largest_load, rounding = 0.0, np.inf, False, np.inf, 1e-14

    release = staticmethod(loops.release)
    activate = staticmethod(loops.activate)
    exchange = staticmethod(loops.exchange)
    project = staticmethod(loops.project)
    tension = staticmethod(loops.tension)

    def __init__(self, admissible):
        self.admissible = admissible

    def describe(self):
        """Return the largest load for result files, or an empty dict."""
        return {"largest_load": self.largest_load} if self.largest_load < np.inf else {}

    def part(self, cut):
        """Return these pressure bounds, cut to a window.

        The function ``cut(field)`` restricts a field to the window.
        """
        return type(self)(cut(self.admissible))

    def change(self, p, step):
        """Return `step`, limited so that p + `step` is within bounds [N/mm2]."""
        return np.where(self.admissible, np.maximum(p + step, self.lower) - p, 0.0)

    def to_bound(self, p, contact):
        """Return the change that moves p outside C to its bounds [N/mm2]."""
        return np.where(contact, 0.0, self.lower - p)

    def between(self, p, margin=0.0):
        """Return a mask of cells with p > lower bound + `margin`."""
        return self.admissible & (p > self.lower + margin)

    def contact(self, p, gap, margin=0.0):
        """Return a mask of cells with p > `margin`, or with overlap."""
        return self.between(p, margin) | (self.admissible & (gap <= 0))

    def overlap(self, p, gap):
        """Return min(gap, 0) of the cells without pressure [mm], a 1-D array."""
        return gap[self.admissible & ~self.between(p)].clip(max=0)  # (2.10)

    def mean_pressures(self, waves):
        """Return the least and largest allowed mean pressure [N/mm2].

        The pressure is a mean pressure plus `waves`, a field whose mean is 0. The least mean pressure is the smallest
        one for which no cell of this rank is below the lower bound. The largest is the upper bound.
        """
        return self.lower - waves.min(initial=np.inf), self.upper

    def vecs(self, pressure):
        """Return bounds as Vecs, for TAO and SNESVI. Collective."""
        lower, upper = pressure.duplicate(), pressure.duplicate()
        for vec, bound in ((lower, self.lower), (upper, self.upper)):
            vec.setArray(np.where(self.admissible, np.minimum(bound, PETSc.INFINITY), 0.0).reshape(-1))
        return lower, upper


class CappedBounds(PressureBounds):
    """Bounds of the pressure: 0 and the hardness H.

    Cells with p = H are plastic. Plastic cells may overlap: e <= 0. In inadmissible cells p = 0.

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)
        True in cells that may be in contact.
    upper : ndarray, shape (local rows, nx), [N/mm2]
        Hardness, positive; infinite in cells that are always elastic.
    largest_load : float
        Largest load that the whole grid can carry [N].
    """

    capped = True

    def __init__(self, admissible, upper, largest_load=np.inf):
        super().__init__(admissible)
        self.upper, self.largest_load = upper, largest_load

    def part(self, cut):
        """Return these bounds, cut to a window; see `PressureBounds.part`."""
        return CappedBounds(cut(self.admissible), cut(self.upper), self.largest_load)

    def plastic(self, p):
        """Return a mask of cells with p = H."""
        return self.admissible & (p >= self.upper)

    def plastic_after(self, p, gap, diagonal):
        """Return a mask of cells that a Jacobi step makes plastic.

        The step changes p by minus the gap divided by the `diagonal` entry of A. A cell becomes plastic if then p >= H.
        """
        return self.admissible & (diagonal * (p - self.upper) >= gap)

    def project_sets(self, p, contact, plastic):
        """Clip p in C, and set p to a bound elsewhere.

        `plastic` cells get p = H and leave C; all other cells outside C get p = 0. Return the sum of p.
        """
        contact &= ~plastic
        total = self.project(p, contact | plastic, p)
        np.copyto(p, self.upper, where=plastic)
        return p.sum() if plastic.any() else total

    def count_plastic(self, p, factor=1.0):
        """Count admissible cells with `factor` * p >= H."""
        return capped_kernels.count_plastic(p, self.upper, self.admissible, factor)

    def sum_at_nearest_bound(self, p):
        """Return the sum of pressures after each is moved to its nearest bound [N/mm2]."""
        return capped_kernels.sum_at_nearest_bound(p, self.upper, self.admissible)

    def not_plastic(self, p):
        """Return a mask of the admissible cells with p < H."""
        return self.admissible & (p < self.upper)

    def release(self, p, contact, released, change):
        """Remove cells that violate a bound; see `capped_kernels.release`."""
        return capped_kernels.release(p, self.upper, contact, released, change)

    def activate(self, b, depth, u, p, admissible, contact, released, expected, overlap):
        """Add overlapping open cells, and plastic cells with a gap; see `bounds_kernels.activate`."""
        fields = b, depth, u, p, self.upper, admissible, contact, released, expected
        return capped_kernels.activate(*fields, overlap)

    def exchange(self, p, stored, w, change, b, admissible, contact, plastic, *limits):
        """Exchange cells of C with open and plastic ones; see `capped_kernels.exchange`."""
        fields = p, stored, self.upper, w, change, b, admissible, contact, plastic
        return capped_kernels.exchange(*fields, *limits, np.empty(p.shape[1]))

    def project(self, p, cells, out):
        """Store p clipped to bounds in `cells`; see `bounds_kernels.project`."""
        return capped_kernels.project(p, self.upper, cells, out)

    def tension(self, p, contact):
        """Return the sum of p, and the sum of its violations of the bounds in C."""
        return capped_kernels.violations(p, self.upper, contact)

    def excess(self, p):
        """Return what clipping to bounds subtracts from p [N/mm2]."""
        return p - np.clip(p, self.lower, self.upper)

    def room(self, p, contact, step):
        """Count the cells of C where p has not reached a bound.

        The bound is the upper one if `step` is positive, otherwise the lower one.
        """
        return capped_kernels.room(p, self.upper, contact, step)

    def add_constant(self, p, contact, step):
        """Add the constant `step` to p on C, within the bounds.

        Return the sum of the changes of p.
        """
        return capped_kernels.add_constant(p, self.upper, contact, step)

    def local_load(self, b, depth, u, p, t, compliance):
        """Return the pressures' sum after all cells approach by t; see `capped_kernels`."""
        return capped_kernels.local_load(b, depth, u, p, self.upper, self.admissible, t, compliance)

    def change(self, p, step):
        """Return `step`, limited so that p + `step` is within bounds [N/mm2]."""
        return np.where(self.admissible, np.clip(p + step, self.lower, self.upper) - p, 0.0)

    def to_bound(self, p, contact):
        """Return the change that moves p to the nearest bound [N/mm2].

        In cells of C the change is 0.
        """
        bound = np.where(2 * p > self.upper, self.upper, self.lower)
        return np.where(contact, 0.0, bound - p)

    def between(self, p, margin=0.0):
        """Return a mask of cells with p over `margin` from each bound."""
        return self.admissible & (p > self.lower + margin) & (p < self.upper - margin)

    def contact(self, p, gap, margin=0.0):
        """Return a mask of cells that belong to C; see `PressureBounds.contact`.

        These cells have a pressure between the bounds, or they are open cells that overlap or plastic cells with a gap.
        """
        opens = (p >= self.upper - margin) & (2 * p > self.upper)
        leaves = np.where(opens, gap >= 0, gap <= 0)
        return self.between(p, margin) | (self.admissible & leaves)

    def overlap(self, p, gap):
        """Return overlaps of open cells, gaps of plastic cells [mm], 1-D array."""
        plastic = self.plastic(p)
        opened = self.admissible & ~self.between(p) & ~plastic
        return np.concatenate([gap[opened].clip(max=0), gap[plastic].clip(min=0)])

    def mean_pressures(self, waves):
        """Return the allowed mean pressures; see `PressureBounds.mean_pressures`."""
        least, _ = super().mean_pressures(waves)
        return least, (self.upper - waves).min(initial=np.inf)
