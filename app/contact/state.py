"""The contact problem on one grid, (2.8)-(2.10), and the state of its solution: the owner of C, p, u and approach.

========================  ===============================  =====
paper                     here                             unit
========================  ===============================  =====
C                         ``ContactState.contact``         bool
p, u                      ``pressure``, ``u``              N/mm2, mm
delta                     ``approach``, ``depth`` + const  mm
-h, (2.11)                ``b + depth``, see `distance`    mm
e = h + u, (2.3)          ``gap()``, ``u - (b + depth)``   mm
r (defect)                ``h + u`` on C                   mm
========================  ===============================  =====

The steps of Sec. 4.1 that only the state can do are its methods; their order is the iteration's, see `iteration`.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from app.contact import kernels
from app.halfspace.operator import wrap_vec
from app.parallel.reductions import minimum_over, sum_over


class Update(NamedTuple):
    """What an update of the contact set did; the same on all ranks."""

    cells: int  # in the new set
    added: int
    released: int  # and not come straight back
    residual: float  # ||h + u||_2 over the new set [mm]
    h_on_contact: float = float("nan")  # ||h||_2 over the new set [mm]; NaN: nobody knows
    load: float = float("nan")  # of the pressure there is [N]; NaN: nobody knows
    approach: float = float("nan")  # [mm]; NaN: that of the state
    moves: float = float("inf")  # norm of what that displaces, about [mm]; infinite: nobody knows

    @property
    def changed(self):
        """Cells in one of the two sets only."""
        return self.added + self.released

    def after(self, first):
        """Return what `first` and this update did, both since the same `release_tensile`."""
        return self._replace(added=first.added + self.added, released=first.released + self.released)


class Gaps(NamedTuple):
    """The gaps h + u of some cells; the same on all ranks."""

    cells: int
    squares: float  # sum of (h + u)^2 [mm2]
    total: float  # sum of h + u [mm]
    h: float = float("nan")  # ||h||_2 [mm]; NaN: nobody has asked
    load: float = float("nan")  # of all pressure there is [N]; NaN: nobody has asked

    @property
    def residual(self):
        """||h + u||_2 [mm]."""
        return sqrt(self.squares)

    @property
    def rms(self):
        """Of h + u [mm]; 0 without cells."""
        return sqrt(self.squares / max(self.cells, 1))

    @property
    def mean(self):
        """Of h + u [mm]; 0 without cells."""
        return float(self.total / max(self.cells, 1))


_NO_FIELD = np.zeros((0, 0))


class Displacement(IntEnum):
    """What u is."""

    STALE = 0  # not A p
    UPDATED = 1  # A p, except for what single precision and summed changes leave
    EXACT = 2  # A p in double precision


class ContactState:
    """Contact set, pressure, displacement and approach on one grid: C, p, u and e = h + A p of (2.8).

    Collective. `contact` *is* the operator's mask, and is emptied here: all states of an operator have the same C, that
    of the last one. Whoever goes back to an earlier one keeps a copy of its C, and puts it back.

    Parameters
    ----------
    operator : InfluenceOperator
    distance : UndeformedDistance
        On the same cells.
    u : ndarray, shape (local rows, nx), [mm], optional
        Displacement, if there is one already. Taken over.
    displacement_status : Displacement
        What it will be to the pressure that it comes with.

    Attributes
    ----------
    highest, highest_searched : float
        Depths that the state, and a search for a load, never exceed [mm].
    revision : int
        Grows when pressure, displacement or depth change.
    """

    highest = highest_searched = np.inf

    def __init__(self, operator, distance, u=None, displacement_status=Displacement.UPDATED):
        self.operator, self.grid, self.comm = operator, operator.grid, operator.comm
        self.distance, self.bounds, self.admissible = distance, distance.bounds, distance.admissible
        self._p = np.zeros(operator.local_shape)
        self.p = self._p.view()  # the local pressure to read; it stays when the Vec is gone
        self.p.flags.writeable = False
        self.pressure = wrap_vec(self._p, operator)
        self.pressure.setName("pressure")  # in PETSc's views and files
        self.u = np.zeros(operator.local_shape) if u is None else u
        self.revision = 0
        self.displacement_status = Displacement.EXACT if u is None else displacement_status
        self._released = np.zeros(operator.local_shape, bool)
        self.contact = operator.mask  # the very array the operator uses, with what the last state left in it
        self.contact[...] = False

    # -- what it is -------------------------------------------------------------------------------------

    @property
    def displacement_status(self):
        """What u is to p, a `Displacement`; set by whoever changes one of them. Not collective."""
        return self._displacement_status

    @displacement_status.setter
    def displacement_status(self, value):
        self._displacement_status = value
        self.revision += 1

    @property
    def approach(self):
        """delta [mm]. Not collective."""
        return self.distance.approach

    @approach.setter
    def approach(self, value):
        self.depth = value - self.distance.reference

    @property
    def depth(self):
        """The approach beyond the reference [mm]. Not collective."""
        return self.distance.depth

    @depth.setter
    def depth(self, value):
        self.distance.move_to(min(value, self.highest))
        self.revision += 1

    def gap(self):
        """Return e = h + u on all cells, shape (local rows, nx) [mm]. Not collective."""
        return self.u - (self.distance.b + self.distance.depth)

    @property
    def values(self):
        """The local pressure, to be changed. Not collective."""
        self.pressure.stateIncrease()
        return self._p

    @property
    def load(self):
        """Total force F = dx dy sum(p) [N], eq. of equilibrium. Collective."""
        return self.grid.cell_area * float(self.sum([self._p.sum()])[0])

    def sum(self, values):
        """Sum a few numbers over the ranks. Collective."""
        return sum_over(self.comm, values)

    def minimum(self, values):
        """Smallest of each of some numbers over the ranks. Collective."""
        return minimum_over(self.comm, values)

    def first_touch(self):
        """Depth at which the first cells of the undeformed bodies touch [mm]. Collective in a window."""
        if self.distance.touching is not None:
            return self.distance.touching
        return float(self.minimum(-self.distance.b.max(initial=-np.inf, where=self.admissible)))

    def cells_in_contact(self):
        """Number of cells in C. Collective."""
        return int(self.sum([np.count_nonzero(self.contact)])[0])

    def on_contact(self, with_h=False):
        """Return the Gaps on C; `with_h`: and ||h|| there. Collective."""
        b, depth, contact = self.distance.b, self.distance.depth, self.contact
        of_h = kernels.sum_squares(b, -depth, contact) if with_h else np.nan
        squares, total, cells, h = self.sum([*kernels.gap_on(b, depth, self.u, contact, contact), of_h])
        return Gaps(int(cells), squares, total, h=sqrt(h))

    def on_contact_or_overlap(self):
        """Return the Gaps on C and where they are negative, and the load. Collective."""
        sums = kernels.gap_on(self.distance.b, self.distance.depth, self.u, self.contact, self.admissible)
        squares, total, cells, pressure = self.sum([*sums, self._p.sum()])
        return Gaps(int(cells), squares, total, load=self.grid.cell_area * float(pressure))

    # -- Sec. 4.1, step by step -----------------------------------------------------------------------

    def begin(self):
        """Prepare an iteration."""

    def keep_solvable(self):
        """Change C where (2.11) has no solution; nothing to do unless the patch is periodic. Collective."""

    def start_from_interpenetration(self):
        """Sec. 4.1, step 1: C^0 = {h <= 0}, p = 0. Not collective."""
        np.greater_equal(self.distance.b, -self.depth, out=self.contact)
        self.contact &= self.admissible
        self.pressure.set(0)
        self.u[...] = 0
        self.displacement_status = Displacement.EXACT

    def first_contact(self):
        """Without contact: approach until the first cell touches, which becomes C. Collective."""
        if self.cells_in_contact():
            return
        gap = self.gap()
        nearest = float(self.minimum(gap[self.admissible].min(initial=np.inf)))
        np.less_equal(gap, nearest, out=self.contact)
        self.contact &= self.admissible
        self.depth += nearest

    @cached_property
    def right(self):
        """A Vec for right-hand sides. Collective when first asked for."""
        return self.pressure.duplicate()

    @PETSc.Log.EventDecorator("ContactUpdate")
    def defect(self):
        """Sec. 4.1, step 2: (2.11) for the correction of p: the Vec ``right`` = -(h + u) on C. Not collective."""
        with self.right as values:
            out = values.reshape(self.u.shape)
            kernels.defect(self.distance.b, self.distance.depth, self.u, self.contact, 1.0, out)
        return self.right

    def add(self, correction):
        """Sec. 4.1, step 3: p += correction. Not collective."""
        self.pressure.axpy(1.0, correction)
        self.displacement_status = Displacement.STALE

    def project(self):
        """Clip p to its bounds. Not collective."""
        self.bounds.project(self.p, self.admissible, self.values)

    def tension(self):
        """Return the pressure outside its bounds on C, which step 4.a takes away, as a share of the sum. Collective."""
        total, outside = self.sum(self.bounds.tension(self.p, self.contact))
        return outside / total if total > 0 else float("inf") if outside else 0.0

    @PETSc.Log.EventDecorator("ContactUpdate")
    def release_tensile(self, some=None, change=_NO_FIELD):
        """(4.a): cells with p < 0 leave C, p = 0 there, for p >= 0 in (2.9). Return how many, or `some`.

        Collective, unless it is known whether there are some. `change`: a field to which is added what that does to p.
        """
        cells = self.bounds.release(self.values, self.contact, self._released, change)
        cells = int(self.sum([cells])[0]) if some is None else some
        if cells:
            self.displacement_status = Displacement.STALE
        return cells

    def compute_displacement(self, exact=False):
        """u = A p, (2.7); `exact`: in double precision, whatever that of other products. Collective."""
        exact = exact or not self.operator.needs_verification
        compute = self.operator.exact_displacement if exact else self.operator.displacement
        compute(self.p, self.u)
        self.displacement_status = Displacement.EXACT if exact else Displacement.UPDATED

    @PETSc.Log.EventDecorator("ContactUpdate")
    def activate_penetrating(self, expected=None):
        """(4.b): cells with e = h + u <= 0 enter C, those just released too, for e > 0 in (2.10). Collective.

        Parameters
        ----------
        expected : ndarray, shape (local rows, nx), [mm], optional
            How u is expected to change beside C, to be counted in.

        Returns
        -------
        Update
            Since before `release_tensile`.
        """
        fields = self.u, self.p, self.admissible, self.contact, self._released
        expected, room = _NO_FIELD if expected is None else expected, np.empty(self.u.shape[1], bool)
        found = self.bounds.activate(self.distance.b, self.distance.depth, *fields, expected, room)
        cells, added, lost, squares, h, total = self.sum(found)
        load = self.grid.cell_area * float(total)
        return Update(int(cells), int(added), int(lost), sqrt(squares), sqrt(h), load)

    def scale(self, factor):
        """Multiply p and u by a factor. Not collective."""
        self.pressure.scale(factor)
        self.u *= factor
        self.revision += 1

    def set_load(self, load, carried):
        """Give p, which carries some load, another one, both [N]: by a factor; u = A p. Collective."""
        self.scale(load / carried)

    def distribute_load(self, load):
        """Let p have a load [N], evenly over C, and u be A p. Collective."""
        each = load / self.grid.cell_area / max(self.cells_in_contact(), 1)
        self.pressure.setArray(self.contact.reshape(-1) * each)
        self.compute_displacement(exact=True)

    def destroy(self):
        """Free the vectors made here. Collective."""
        self.pressure.destroy()
        if "right" in vars(self):
            self.right.destroy()
