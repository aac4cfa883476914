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

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from app.contact import kernels
from app.halfspace.reductions import any_nonzero, minimum_over, sum_over
from app.halfspace.window import whole

_EPSILON = np.finfo(float).eps


@dataclass(frozen=True)
class Change:
    """What an update of the contact set did; the same on all ranks."""

    cells: int  # in the new set
    added: int
    dropped: int
    changed: int  # in the new set and not in the old, or the other way round
    residual: float  # ||h + u||_2 over the new set [mm]

    def after(self, first):
        """Return what `first` and this update did, both since the same `drop`."""
        added = first.added + self.added
        return replace(self, added=added, changed=added + self.dropped)


class GapStatistics(NamedTuple):
    """What the norm of h needs to know at any approach."""

    cells: int  # admissible
    mean: float  # of the undeformed distance at zero approach over them [mm]
    deviation: float  # sum of squares of its differences from the mean [mm2]


class InContact(NamedTuple):
    """Of the undeformed distance on C [mm]."""

    norm: float
    rounding: float  # of a norm


def gap_statistics(shape, admissible, comm=None):
    """Statistics of the undeformed distance over the admissible cells. Collective."""
    cells, total = sum_over(comm, [np.count_nonzero(admissible), np.sum(shape, where=admissible)])
    mean = float(total / cells)
    deviation = sum_over(comm, [kernels.norm_on(shape, mean, admissible)])[0]
    return GapStatistics(int(cells), mean, float(deviation))


class ContactGrid:
    """The complementarity problem (2.8)-(2.10) on one grid, and the current state of its solution.

    Parameters
    ----------
    operator : InfluenceOperator
    shape : ndarray, shape (local rows, nx), [mm]
        Undeformed distance at zero approach; NaN in inadmissible cells. Taken over: the NaN become 0 in place.
    window : Window, optional
        Which cells of the level these are; default: all.
    statistics : GapStatistics, optional
        Of the whole level, if these are not all cells.
    u : ndarray, shape (local rows, nx), [mm], optional
        Displacement, if it is known already. Taken over.
    """

    def __init__(self, operator, shape, window=None, statistics=None, u=None):
        self.operator, self.grid, self.comm = operator, operator.grid, operator.comm
        self.admissible = ~np.isnan(shape)
        np.copyto(shape, 0.0, where=~self.admissible)
        self.shape = shape
        size = (shape.size, PETSc.DETERMINE)
        self.pressure = PETSc.Vec().createMPI(size, comm=operator.petsc_comm)
        self.u = np.zeros(shape.shape) if u is None else u
        self._dropped = np.zeros(shape.shape, bool)
        self.current = True  # u is A p, not only near it
        self._exact = False
        self.contact = operator.mask  # the very array the operator uses
        self.approach = 0.0
        self.window = window or whole(operator.grid)
        self.statistics = statistics or gap_statistics(shape, self.admissible, self.comm)

    @cached_property
    def right(self):
        """A Vec for right-hand sides. Collective when first asked for."""
        return self.pressure.duplicate()

    def sum(self, values):
        """Sum a few numbers over the ranks. Collective."""
        return sum_over(self.comm, values)

    def minimum(self, values):
        """Smallest of each of some numbers over the ranks. Collective."""
        return minimum_over(self.comm, values)

    def gap_norm(self):
        """||h||_2 over the admissible cells [mm], eq. (5.1); 1 where it is zero, to be divided by. Not collective."""
        _, mean, deviation = self.statistics
        return float(np.sqrt(deviation + self.admissible_cells * (mean - self.approach) ** 2)) or 1.0

    def gap_in_contact(self):
        """||h||_2 over C, and what rounding of the distances to the approach leaves of it [mm]. Collective."""
        squares = kernels.norm_on(self.shape, self.approach, self.contact)
        squares, cells = self.sum([squares, np.count_nonzero(self.contact)])
        return InContact(float(np.sqrt(squares)), 2 * _EPSILON * abs(self.approach) * float(np.sqrt(cells)))

    def mean_shape(self):
        """Mean undeformed distance at zero approach over the admissible cells [mm]. Not collective."""
        return self.statistics.mean

    @property
    def admissible_cells(self):
        """Number of cells of the level where contact is possible. Not collective."""
        return self.statistics.cells

    def in_contact(self):
        """Whether any cell is in the contact set. Collective."""
        return self.sum([any_nonzero(self.contact)])[0] > 0

    def touch(self):
        """Make sure that there is contact: press until the first cell touches. Collective."""
        if self.in_contact():
            return
        gap = self.shape + self.u
        self.approach = float(self.minimum(gap[self.admissible].min(initial=np.inf)))
        np.less_equal(gap, self.approach, out=self.contact)
        self.contact &= self.admissible

    def start_from_interpenetration(self):
        """Step 1: C = {h <= 0}, p = 0. Not collective."""
        np.less_equal(self.shape, self.approach, out=self.contact)
        self.contact &= self.admissible
        self.pressure.set(0)
        self.u[...] = 0
        self.current = True

    @property
    def p(self):
        """The local pressure as array (rows, nx), to read. Not collective."""
        return self.pressure.getArray(readonly=True).reshape(self.u.shape)

    def defect_to(self, right):
        """Step 2: eq. (2.11) for the correction of the pressure, right = -(h + u) on C. Not collective."""
        with right as values:
            kernels.defect(self.shape, self.u, self.approach, self.contact, values.reshape(self.u.shape))

    def right_hand_side_to(self, right):
        """Step 2: eq. (2.11) itself, right = -h on C. Not collective."""
        with right as values:
            kernels.right_hand_side(self.shape, self.approach, self.contact, values.reshape(self.u.shape))

    def displace(self):
        """Compute u = A p. Collective."""
        self.operator.displacement(self.p, self.u)
        self.current, self._exact = True, not self.operator.provisional

    def displace_exactly(self):
        """Compute u = A p in double precision. Collective."""
        self.operator.exact_displacement(self.p, self.u)
        self.current = self._exact = True

    def displaced_along(self):
        """Take notice of a solver that changed p, and u with it. Not collective."""
        self._exact = False

    @property
    def exact(self):
        """Whether u is A p in double precision. Not collective."""
        return self._exact and self.current

    def drop(self):
        """(4a) Cells that would have to be pulled leave the contact area, and p = 0 there. Collective.

        Returns
        -------
        cells : int
        tension : float
            Sum of the pressures that were set to zero, as a share of those that were not.
        """
        with self.pressure as values:
            p = values.reshape(self.u.shape)
            cells, tension, kept = self.sum(kernels.drop(p, self.contact, self._dropped))
        self.current = self.current and not cells
        return int(cells), tension / kept if kept > 0 else tension

    def admit(self, foresight=0.0, change=None):
        """(4b) Cells that overlap enter the contact area, those that have just left among them. Collective.

        Parameters
        ----------
        foresight : float
        change : ndarray, optional
            How u is expected to change beside the contact area [mm]: `foresight` times this is believed.

        Returns
        -------
        Change
            Since before `drop`.
        """
        counts = self.sum(
            kernels.admit(
                self.shape,
                self.u,
                self.approach,
                self.admissible,
                self.contact,
                self._dropped,
                foresight,
                change,
            )
        )
        cells, added, lost, changed = (int(count) for count in counts[:4])
        return Change(cells, added, lost, changed, residual=float(np.sqrt(counts[4])))

    def fingerprint(self):
        """Return a number that tells contact sets apart. Collective."""
        rank = 0 if self.comm is None else self.comm.rank
        return float(self.sum([kernels.crc(self.contact) * (1 + rank % 97)])[0])

    @property
    def load(self):
        """Total force F = dx dy sum(p) [N], eq. of equilibrium. Collective."""
        return self.grid.cell_area * self.pressure.sum()

    def destroy(self):
        """Free the vectors. Collective."""
        self.pressure.destroy()
        if "right" in vars(self):
            self.right.destroy()
