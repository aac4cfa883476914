"""Bounds of the pressure, and operations on them.

A cell of the contact set C has no gap and a pressure between its bounds (2.1). Any other cell has the pressure of a
bound (2.2): zero where it is open, the hardness H where it is plastic. The `UndeformedDistance` of each grid or window
has `PressureBounds`, which all methods use. Plastic cells need no set of their own, because the pressure of a cell
outside C shows at which bound the cell is.
"""

import numpy as np
from petsc4py import PETSc

from app.contact import bounds_loops as loops

_PATIENCE_WITH_HARDNESS = 2  # iterations in which the number of changed cells may stagnate


class PressureBounds:
    """Bounds 0 <= p <= H of the pressure on one grid, or p >= 0.

    Cells with p = H are plastic. Plastic cells may overlap: e <= 0. Inadmissible cells, where contact is impossible,
    have p = 0. The arguments of methods are the pressure and the contact set, shape (local rows, nx).

    Parameters
    ----------
    admissible : ndarray of bool, shape (local rows, nx)
        True in cells that may be in contact.
    upper : ndarray, shape (local rows, nx), [N/mm2], optional
        Hardness, positive; infinite in cells that are always elastic.

    Attributes
    ----------
    lower : float
        Lower bound of the pressure in admissible cells [N/mm2].
    upper : ndarray or None
    capped : bool
        True if there is an upper bound.
    largest_load : float
        Largest load that the whole grid can carry [N].
    patience : float
        Iterations in which the number of changed cells may stagnate, see `ContactState.activate_penetrating`.
    rounding : float
        Largest violation of the bounds that may be rounding, divided by the highest pressure.
    """

    lower, largest_load, rounding = 0.0, np.inf, 1e-14

    def __init__(self, admissible, upper=None):
        self.admissible, self.upper, self.capped = admissible, upper, upper is not None
        self.patience = _PATIENCE_WITH_HARDNESS if self.capped else np.inf

    @property
    def carried(self):
        """Sum of the highest pressures of this rank [N/mm2]."""
        return np.sum(self.upper, where=self.admissible) if self.capped else np.inf

    @property
    def limited_cells(self):
        """Number of this rank's cells that can become plastic."""
        return np.count_nonzero(np.isfinite(self.upper) & self.admissible) if self.capped else 0

    def describe(self):
        """Return the largest load for result files, or an empty dict."""
        return {"largest_load": self.largest_load} if self.largest_load < np.inf else {}

    def part(self, cut):
        """Return these pressure bounds, cut to a window.

        The function ``cut(field)`` restricts a field to the window.
        """
        part = PressureBounds(cut(self.admissible), cut(self.upper) if self.capped else None)
        part.largest_load = self.largest_load
        return part

    # -- compiled loops, see `app.contact.bounds_loops` ----------------------------------------------

    def release(self, p, contact, released, change):
        """Remove cells from C that violate a bound."""
        return loops.release(p, self.upper, contact, released, change)

    def activate(self, b, depth, u, p, contact, released, expected, plastic):
        """Add cells to C that would leave their bound; without `plastic` cells, only open ones."""
        upper, leaves = self.upper if plastic else None, np.empty(p.shape[1], bool)
        return loops.activate(b, depth, u, p, upper, self.admissible, contact, released, expected, leaves)

    def exchange(self, p, stored, w, change, b, contact, plastic, *limits):
        """Exchange cells of C with open and plastic ones."""
        fields = p, stored, self.upper, w, change, b, self.admissible, contact, plastic
        return loops.exchange(*fields, *limits, np.empty(p.shape[1]) if self.capped else None)

    def project(self, p, cells, out):
        """Store p clipped to bounds in `cells`, and 0 elsewhere; return the sum."""
        return loops.project(p, self.upper, cells, out)

    def tension(self, p, contact):
        """Return the sum of p, and the sum of its violations of the bounds in C."""
        return loops.tension(p, self.upper, contact)

    def count_plastic(self, p, factor=1.0):
        """Count admissible cells with `factor` * p >= H."""
        return loops.count_plastic(p, self.upper, self.admissible, factor) if self.capped else 0

    def sum_at_nearest_bound(self, p):
        """Return the sum of pressures after each is moved to its nearest bound [N/mm2]."""
        return loops.sum_at_nearest_bound(p, self.upper, self.admissible)

    def room(self, p, contact, step):
        """Count the cells of C where p has not reached a bound.

        The bound is the upper one if `step` is positive, otherwise the lower one.
        """
        return loops.room(p, self.upper, contact, step)

    def add_constant(self, p, contact, step):
        """Add the constant `step` to p on C, within the bounds.

        Return the sum of the changes of p.
        """
        return loops.add_constant(p, self.upper, contact, step)

    def local_load(self, b, depth, u, p, t, compliance):
        """Return the pressures' sum after all cells approach by t."""
        return loops.local_load(b, depth, u, p, self.upper, self.admissible, t, compliance)

    # -- plastic cells ----------------------------------------------------------------------------------

    def plastic(self, p):
        """Return a mask of cells with p = H, or None without a hardness."""
        return self.admissible & (p >= self.upper) if self.capped else None

    def not_plastic(self, p):
        """Return a mask of the admissible cells with p < H."""
        return self.admissible & (p < self.upper) if self.capped else self.admissible

    def plastic_after(self, p, gap, diagonal):
        """Return a mask of cells that a Jacobi step makes plastic, or None without a hardness.

        The step changes p by minus the gap divided by the `diagonal` entry of A. A cell becomes plastic if then p >= H.
        """
        return self.admissible & (diagonal * (p - self.upper) >= gap) if self.capped else None

    def project_sets(self, p, contact, plastic):
        """Clip p in C, and set p to a bound elsewhere.

        `plastic` cells (None: there are none) get p = H and leave C; all other cells outside C get p = 0. Return the
        sum of p.
        """
        if plastic is None or not plastic.any():
            return self.project(p, contact, p)
        contact &= ~plastic
        self.project(p, contact | plastic, p)
        np.copyto(p, self.upper, where=plastic)
        return p.sum()

    # -- any p and gap ----------------------------------------------------------------------------------

    def change(self, p, step):
        """Return `step`, limited so that p + `step` is within bounds [N/mm2]."""
        return np.where(self.admissible, np.clip(p + step, self.lower, self.upper) - p, 0.0)

    def excess(self, p):
        """Return what clipping to bounds subtracts from p [N/mm2]."""
        return p - np.clip(p, self.lower, self.upper)

    def to_bound(self, p, contact):
        """Return the change that moves p outside C to the nearest bound [N/mm2].

        In cells of C the change is 0.
        """
        bound = np.where(2 * p > self.upper, self.upper, self.lower) if self.capped else self.lower
        return np.where(contact, 0.0, bound - p)

    def between(self, p, margin=0.0):
        """Return a mask of cells with p over `margin` from each bound."""
        above = self.admissible & (p > self.lower + margin)
        return above & (p < self.upper - margin) if self.capped else above

    def contact(self, p, gap, margin=0.0):
        """Return a mask of cells that belong to C.

        These cells have a pressure between the bounds, or they are open cells that overlap or plastic cells with a gap.
        """
        leaves = gap <= 0
        if self.capped:
            leaves = np.where((p >= self.upper - margin) & (2 * p > self.upper), gap >= 0, leaves)
        return self.between(p, margin) | (self.admissible & leaves)

    def overlap(self, p, gap):
        """Return overlaps of open cells, gaps of plastic cells [mm], 1-D array."""
        closed = self.admissible & ~self.between(p)
        if not self.capped:
            return gap[closed].clip(max=0)  # (2.10)
        plastic = p >= self.upper
        return np.concatenate([gap[closed & ~plastic].clip(max=0), gap[closed & plastic].clip(min=0)])

    def mean_pressures(self, waves):
        """Return the least and largest allowed mean pressure [N/mm2].

        The pressure is a mean pressure plus `waves`, a field whose mean is 0. The least mean pressure is the smallest
        one for which no cell of this rank is below the lower bound. The largest is the same for the upper bound.
        """
        most = (self.upper - waves).min(initial=np.inf) if self.capped else np.inf
        return self.lower - waves.min(initial=np.inf), most

    def vecs(self, pressure):
        """Return bounds as Vecs, for SNESVI. Collective."""
        lower, upper = pressure.duplicate(), pressure.duplicate()
        most = np.minimum(self.upper, PETSc.INFINITY) if self.capped else PETSc.INFINITY
        for vec, bound in ((lower, self.lower), (upper, most)):
            vec.setArray(np.where(self.admissible, bound, 0.0).reshape(-1))
        return lower, upper
