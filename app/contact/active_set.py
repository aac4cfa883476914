"""The contact problem on one grid, and the update of its contact set (Sec. 4.1, steps 1, 4a, 4b).

========================  ===========================  =====
paper                     here                         unit
========================  ===========================  =====
C                         ``ContactGrid.contact``      bool
p, u                      ``pressure``, ``u``          N/mm2, mm
h                         ``shape - approach``         mm
r (defect on C)           ``h + u`` on C               mm
========================  ===========================  =====
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc


@dataclass(frozen=True)
class Change:
    """What an update of the contact set did; the same on all ranks."""

    cells: int  # in the new set
    added: int
    dropped: int
    changed: int  # in the new set and not in the old, or the other way round
    residual: float  # ||h + u||_2 over the new set [mm]
    smallest_pressure: float  # before negative pressures were set to zero


class ContactGrid:
    """The complementarity problem (2.8)-(2.10) on one grid, and the current state of its solution.

    Parameters
    ----------
    operator : InfluenceOperator
    shape : ndarray, shape (local rows, nx), [mm]
        Undeformed distance at zero approach; NaN in inadmissible cells.
    comm : mpi4py communicator or None
        The ranks that share the rows; None if this rank has them all.
    """

    def __init__(self, operator, shape, comm=None):
        self.operator, self.grid, self.comm = operator, operator.grid, comm
        self.admissible = ~np.isnan(shape)
        self.shape = np.where(self.admissible, shape, 0.0)
        petsc_comm = PETSc.COMM_SELF if comm is None else PETSc.Comm(comm)
        size = (shape.size, PETSc.DETERMINE)
        self.pressure = PETSc.Vec().createMPI(size, comm=petsc_comm)
        self.right = self.pressure.duplicate()
        self.correction = self.pressure.duplicate()
        self.u = np.zeros(shape.shape)
        self.current = True  # u is A p, not only near it
        self.contact = operator.mask  # the very array the operator uses
        self.approach = 0.0
        self.unit = None  # q with A q = 1 on C, if the load is prescribed: see `loading`
        cells, total = self.sum([np.count_nonzero(self.admissible), self.shape.sum()])
        self.admissible_cells = int(cells)
        self._mean_shape = float(total / cells)
        deviation = self.shape[self.admissible] - self._mean_shape
        self._deviation = float(self.sum([deviation @ deviation])[0])

    def sum(self, values):
        """Sum a few numbers over the ranks. Collective."""
        values = np.asarray(values, dtype=float)
        if self.comm is not None:
            self.comm.Allreduce(values.copy(), values)
        return values

    def minimum(self, values):
        """Smallest of each of some numbers over the ranks. Collective."""
        values = np.asarray(values, dtype=float)
        if self.comm is not None:
            self.comm.Allreduce(values.copy(), values, MPI.MIN)
        return values

    def gap_norm(self):
        """||h||_2 over the admissible cells [mm], eq. (5.1). Not collective."""
        return float(
            np.sqrt(self._deviation + self.admissible_cells * (self._mean_shape - self.approach) ** 2)
        )

    def mean_shape(self):
        """Mean undeformed distance at zero approach over the admissible cells [mm]. Not collective."""
        return self._mean_shape

    def make_unit(self):
        """Make the vector q. Collective."""
        self.unit = self.pressure.duplicate()

    def touch(self):
        """Make sure that there is contact: press until the first cell touches. Collective; returns if it had to."""
        if self.sum([self.contact.sum()])[0] > 0:
            return False
        gap = self.shape + self.u
        self.approach = float(self.minimum(gap[self.admissible].min(initial=np.inf)))
        np.less_equal(gap, self.approach, out=self.contact)
        self.contact &= self.admissible
        return True

    def start_from_interpenetration(self):
        """Step 1: C = {h <= 0}, p = 0. Not collective."""
        np.less_equal(self.shape, self.approach, out=self.contact)
        self.contact &= self.admissible
        self.pressure.set(0)
        self.u[...] = 0

    def set_right_hand_side(self):
        """Step 2: eq. (2.11) for the correction of the pressure, right = -(h + A p) on C. Collective."""
        if not self.current:
            self.displace()
        with self.right as right:
            r = right.reshape(self.u.shape)
            np.subtract(self.approach, self.shape, out=r)
            r -= self.u
            r *= self.contact

    def displace(self):
        """Compute u = A p. Collective."""
        self.operator.displacement(self.pressure.getArray(readonly=True).reshape(self.u.shape), self.u)
        self.current = True

    def update(self):
        """Step 4 in the one order that converges: zero first, then u = A p, then look for new contact.

        Collective.

        Returns
        -------
        Change
        """
        contact = self.contact
        with self.pressure as values:
            p = values.reshape(self.u.shape)
            smallest = float(p.min(initial=0.0))
            # (4a) cells that would have to be pulled leave the contact area
            tensile = p < 0
            tensile &= contact
            p[tensile] = 0
        self.displace()
        # (4b) cells that overlap enter it, those that have just left among them
        overlap = self.shape - self.approach
        overlap += self.u
        entering = overlap <= 0
        entering &= self.admissible
        entering &= ~contact | tensile
        kept = contact & ~tensile
        changed = np.count_nonzero(entering ^ tensile)
        added = np.count_nonzero(entering & ~tensile)
        np.logical_or(kept, entering, out=contact)
        defect = overlap[contact]
        counts = self.sum([np.count_nonzero(contact), added, changed - added, changed, defect @ defect])
        return Change(
            cells=int(counts[0]),
            added=int(counts[1]),
            dropped=int(counts[2]),
            changed=int(counts[3]),
            residual=float(np.sqrt(counts[4])),
            smallest_pressure=float(self.minimum(smallest)),
        )

    @property
    def load(self):
        """Total force F = dx dy sum(p) [N], eq. of equilibrium. Collective."""
        return self.grid.cell_area * self.pressure.sum()

    def destroy(self):
        """Free the vectors. Collective."""
        for vec in (self.pressure, self.right, self.correction, self.unit):
            if vec is not None:
                vec.destroy()
