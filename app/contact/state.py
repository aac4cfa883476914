"""Contact state on one grid, with the steps of Sec. 4.1.

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

`active_set` calls the steps, in the order of the paper.
"""

from enum import IntEnum
from functools import cached_property
from math import sqrt

import numpy as np
from petsc4py import PETSc

from app.contact import loops
from app.contact.updates import Gaps, Update
from app.halfspace.operator import wrap_vec
from app.halfspace.window import bounding_boxes
from app.parallel.reductions import minimum_over, sum_over

_NO_FIELD = np.zeros((0, 0))
_MAX_LOAD_STEPS = 60  # steps of `ContactState.reach_sum`, each of which brings a cell to a bound or ends
_LOAD_ROUNDING = 1e-15  # relative rounding error of a sum of pressures


class Displacement(IntEnum):
    """Accuracy of the displacement u = A p."""

    STALE = 0  # u is not A p
    UPDATED = 1  # u is A p up to single precision and the errors of summed changes
    EXACT = 2  # u is A p in double precision


class Pressed:
    """Contact set C, pressure p, displacement u and depth on one grid.

    Certificate, measures, history and grid errors need no more. Collective. The array `contact` *is* the mask of the
    operator, and a new object empties it. All states of an operator share this mask. So to return to an earlier state,
    store a copy of its contact set, and restore it.

    Parameters
    ----------
    operator : InfluenceOperator
    distance : UndeformedDistance
        Undeformed distance of the same cells.
    u : ndarray, shape (local rows, nx), [mm], optional
        Initial displacement; the array is not copied.
    displacement_status : Displacement
        Accuracy of this `u`.
    p : ndarray, shape (local rows, nx), [N/mm2], optional
        Initial pressure; the array is not copied.

    Attributes
    ----------
    p : ndarray, shape (local rows, nx), [N/mm2]
        Local pressure, read-only; still valid after `destroy`. To change it, write to `values`.
    displacement_status : Displacement
        Accuracy of `u`. Set it when you change `p` or `u`.
    h_norm : float
        ||h||_2 over the admissible cells, for (5.1) [mm]; 1 if zero.
    neglected_gap : float
        Mean gap that is treated as full contact, or an error of the prescribed mean gap, because of rounding [mm].
    iterations_before : int
        Number of iterations of earlier solves on this grid, from which the history counts on.
    """

    _counted_at, _plastic_cells = None, 0  # plastic cells: state of `pressure` when counted, and their number
    iterations_before = 0

    def __init__(self, operator, distance, u=None, displacement_status=Displacement.UPDATED, p=None):
        self.operator, self.grid, self.comm = operator, operator.grid, operator.comm
        self.distance, self.bounds, self.admissible = distance, distance.bounds, distance.admissible
        self._p = np.zeros(operator.local_shape) if p is None else p
        self.p = self._p.view()
        self.p.flags.writeable = False
        self.pressure = wrap_vec(self._p, operator)
        self.pressure.setName("pressure")  # in PETSc's views and files
        self.u = np.zeros(operator.local_shape) if u is None else u
        self.displacement_status = Displacement.EXACT if u is None else displacement_status
        self.move_to(0.0)
        self.contact = operator.mask
        self.contact[...] = False

    @property
    def approach(self):
        """The approach delta [mm]."""
        return self.distance.approach_at(self.depth)

    @approach.setter
    def approach(self, value):
        self.depth = value - self.distance.reference

    @property
    def depth(self):
        """The approach beyond the reference [mm]; at most ``distance.max_depth``."""
        return self._depth

    @depth.setter
    def depth(self, value):
        self.move_to(min(value, self.distance.max_depth))

    def move_to(self, depth, neglected_gap=0.0):
        """Set a depth, also of full contact, and the `neglected_gap` [mm]."""
        self._depth, self.neglected_gap = float(depth), neglected_gap
        self.h_norm = self.distance.norm(self._depth)

    def gap(self):
        """Return e = h + A p, shape (local rows, nx) [mm]."""
        return self.u - (self.distance.b + self._depth)  # (2.8)

    def fields(self):
        """Return the object with the fields of all cells that listeners get: this one."""
        return self

    def deformation(self):
        """Return a function that returns the displacement u [mm]."""
        u = self.u
        return lambda: u

    def total_gap(self):
        """Return the sum of e over this rank's admissible cells [mm]."""
        b, admissible = self.distance.b, self.admissible
        return loops.sum_gaps(b, self._depth, self.u, admissible, admissible)[1]

    def total_overlap(self, cells):
        """Return the sum of max(-e, 0) over some of this rank's cells [mm]; `cells` is a mask."""
        return float(np.maximum(-self.gap(), 0.0).sum(where=cells))

    @property
    def values(self):
        """Local pressure as a writable array; each access marks p as changed."""
        self.pressure.stateIncrease()
        return self._p

    @property
    def load(self):
        """Total force F = dx dy sum(p) [N]. Collective."""
        return self.grid.cell_area * float(self.sum([self._p.sum()])[0])

    def sum(self, values):
        """Return the sums of a few numbers over the ranks. Collective."""
        return sum_over(self.comm, values)

    def minimum(self, values):
        """Return the minima of a few numbers over the ranks. Collective."""
        return minimum_over(self.comm, values)

    def first_touch(self):
        """Return the depth of first touch of these cells [mm]. Collective."""
        if self.distance.touching is None:
            return float(self.minimum(-self.distance.b.max(initial=-np.inf, where=self.admissible)))
        return self.distance.touching

    def in_contact(self):
        """Return a mask of cells in contact: C and plastic cells."""
        if not self._local_plastic_cells():
            return self.contact
        return self.contact | self.bounds.plastic(self.p)

    def not_plastic(self):
        """Return a mask of the admissible cells with p < H."""
        return self.bounds.not_plastic(self.p)

    def _local_plastic_cells(self):
        """Count this rank's plastic cells, again only if p has changed; 0 without a hardness."""
        if not self.bounds.capped:
            return 0
        if self._counted_at != (key := self.pressure.stateGet()):
            self._counted_at, self._plastic_cells = key, None
            self._local_plastic = self.bounds.count_plastic(self.p)
        return self._local_plastic

    def plastic_cells(self, factor=1.0):
        """Return the number of cells with factor * p >= H, by default of plastic cells. Collective."""
        if factor != 1 and self.bounds.capped:
            return int(self.sum([self.bounds.count_plastic(self.p, factor)])[0])
        local = self._local_plastic_cells()
        if self._plastic_cells is None:
            self._plastic_cells = int(self.sum([local])[0])
        return self._plastic_cells

    def elastic_cells(self):
        """Count the cells of C. Collective."""
        return int(self.sum([np.count_nonzero(self.contact)])[0])

    def cells_in_contact(self):
        """Return the number of cells in contact: of C, and plastic. Collective."""
        return int(self.sum([np.count_nonzero(self.in_contact())])[0])

    def box_of_contact(self):
        """Return the number of cells in the bounding box of contact, at least 1. Collective."""
        [box] = bounding_boxes([self.in_contact()], self.operator.slabs, self.comm)
        return box.n if box else 1

    def on_contact(self, with_h=False):
        """Return the `Gaps` of C, with the norm of h if `with_h`. Collective."""
        b, depth, contact = self.distance.b, self._depth, self.contact
        h_squares = loops.sum_squares(b, -depth, contact) if with_h else np.nan
        squares, total, cells, h = self.sum([*loops.sum_gaps(b, depth, self.u, contact, contact), h_squares])
        return Gaps(int(cells), squares, total, h=sqrt(h))

    def on_contact_or_overlap(self):
        """Return the sums of gaps over C and over overlapping elastic cells, with the load. Collective."""
        overlapping = self.not_plastic()
        sums = loops.sum_gaps(self.distance.b, self._depth, self.u, self.contact, overlapping)
        squares, total, cells, pressure = self.sum([*sums, self._p.sum()])
        return Gaps(int(cells), squares, total, load=self.grid.cell_area * float(pressure))

    def compute_displacement(self, exact=False):
        """Compute u = A p, if `exact` in double precision. Collective."""
        exact = exact or not self.operator.needs_verification
        compute = self.operator.exact_displacement if exact else self.operator.displacement
        compute(self._p, self.u)  # (2.7)
        self.displacement_status = Displacement.EXACT if exact else Displacement.UPDATED

    def reach_sum(self, total):
        """Add a constant to p on C, to reach a sum.

        Collective. p stays within its bounds. Return `total` minus the sum that is reached [N/mm2].
        """
        p, least = self.values, _LOAD_ROUNDING * total
        for _ in range(2):  # a change of large pressures leaves a rounding error
            missing = total - self.sum([p.sum()])[0]
            for _ in range(_MAX_LOAD_STEPS):
                free = self.sum([self.bounds.room(p, self.contact, missing)])[0]
                if not free or abs(missing) <= least:
                    break
                missing -= self.sum([self.bounds.add_constant(p, self.contact, missing / free)])[0]
        return missing

    def destroy(self):
        """Free the Vec of the pressure. Collective."""
        self.pressure.destroy()


class ContactState(Pressed):
    """A `Pressed` with the steps of Sec. 4.1. Collective.

    Attributes
    ----------
    patience : float
        Number of iterations in which the number of changed cells may stagnate, see `activate_penetrating`.
    """

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self._released = np.zeros(self.u.shape, bool)
        self.patience = self.bounds.patience
        self.forget_exchanges()

    @property
    def may_cycle(self):
        """True if contact sets may cycle: on periodic patches, and with a hardness."""
        return self.patience < np.inf

    def forget_exchanges(self):
        """Reset the numbers of changed cells, before another iteration."""
        self._fewest_changed, self._stagnating, self._has_released = np.inf, 0, False

    def leave_full_contact(self):
        """Remove a cell from C of a periodic patch if C has all cells. Collective."""

    def start_from_interpenetration(self):
        """Start from contact where h <= 0, without pressure (step 1)."""
        np.greater_equal(self.distance.b, -self.depth, out=self.contact)
        self.contact &= self.admissible
        self.pressure.set(0)
        self.u[...] = 0
        self.displacement_status = Displacement.EXACT

    def first_contact(self):
        """If C is empty, approach until the first cell touches. Collective."""
        if not self.cells_in_contact():
            self.approach_next_cell()

    def approach_next_cell(self):
        """Approach until the nearest open cell touches, and add it. Collective."""
        gap, candidates = self.gap(), self.not_plastic()
        nearest = float(self.minimum(gap[candidates].min(initial=np.inf)))
        np.less_equal(gap, nearest, out=self.contact)
        self.contact &= candidates
        self.depth += nearest

    def retreat_to_cell(self):
        """Retreat until the plastic cell with the least overlap just touches. Collective.

        C receives this cell.
        """
        gap, plastic = self.gap(), self.bounds.plastic(self.p)
        nearest = -float(self.minimum(-gap[plastic].max(initial=-np.inf)))
        np.greater_equal(gap, nearest, out=self.contact)
        self.contact &= plastic
        self.depth += nearest

    @cached_property
    def right(self):
        """Work Vec for right-hand sides. Collective when first used."""
        return self.pressure.duplicate()

    @PETSc.Log.EventDecorator("ContactUpdate")
    def defect(self):
        """Return -(h + u) on C, else 0 [mm], the right-hand side of (2.11)."""
        with self.right as values:
            out = values.reshape(self.u.shape)
            loops.defect(self.distance.b, self._depth, self.u, self.contact, 1.0, out)  # (2.11)
        return self.right

    def add(self, correction):
        """Add a correction (a Vec) to the pressure p."""
        self.pressure.axpy(1.0, correction)
        self.displacement_status = Displacement.STALE

    def project(self):
        """Clip p to its bounds."""
        self.bounds.project(self.values, self.admissible, self.values)

    def tension(self):
        """Return the total tension on C divided by the total pressure. Collective.

        Pressure above the hardness counts like tension. The result is infinite if there is tension without pressure.
        """
        total, outside = self.sum(self.bounds.tension(self.p, self.contact))
        return outside / total if total > 0 else float("inf") if outside else 0.0

    @PETSc.Log.EventDecorator("ContactUpdate")
    def release_tensile(self, some=None, change=_NO_FIELD):
        """Remove tensile cells, which violate p >= 0 (2.9), and cells above the hardness from C, step 4.a.

        If `some` is None, the call is collective, and returns the number of these cells. Otherwise `some` says whether
        any rank has some, and is returned. The change of p is added to `change`, shape (local rows, nx) [N/mm2].
        """
        released = self.bounds.release(self.values, self.contact, self._released, change)
        released = int(self.sum([released])[0]) if some is None else some
        if released:
            self.displacement_status = Displacement.STALE
        self._has_released = released > 0
        return released

    @PETSc.Log.EventDecorator("ContactUpdate")
    def activate_penetrating(self, expected=None):
        """Add the overlapping cells to C (4.b), for (2.10).

        Collective. Cells just released may enter again. Return the `Update`, which counts the cells that this step adds
        and those that the last `release_tensile` removed.

        `expected`, shape (local rows, nx) [mm], is a predicted change of u. The test for overlap adds it to u.

        Contact sets may cycle near full contact, or with a hardness. So if the number of changed cells stagnates, cells
        enter C only in iterations in which none leave C, as in Kalker's NORM.
        """
        if self._has_released and self._stagnating >= self.patience:
            expected = np.full(self.u.shape, np.inf)
        expected = _NO_FIELD if expected is None else expected
        fields = self.distance.b, self._depth, self.u, self._p, self.contact, self._released
        sums = self.bounds.activate(*fields, expected, self._local_plastic_cells() > 0)
        cells, added, released, squares, h, total = self.sum(sums)
        load = self.grid.cell_area * float(total)
        update = Update(int(cells), int(added), int(released), sqrt(squares), sqrt(h), load)
        if self.may_cycle:
            stagnates = update.changed >= self._fewest_changed
            self._stagnating, self._has_released = self._stagnating + 1 if stagnates else 0, False
            self._fewest_changed = min(self._fewest_changed, update.changed)
        return update

    def scale(self, factor):
        """Multiply p and u by a factor."""
        self.pressure.scale(factor)
        self.u *= factor

    def set_load(self, load, present_load):
        """Scale p and u to another load [N]. Collective.

        If a cell reached the hardness, a constant is added to p on C instead, and u is computed.
        """
        factor = load / present_load
        if not self.plastic_cells(max(factor, 1.0)):
            return self.scale(factor)
        self.reach_load(load)
        return self.compute_displacement(exact=True)

    def reach_load(self, load):
        """Reach a load [N] by a constant added to p on C. Collective.

        p stays within its bounds, and u is not updated. If all cells of C reach a bound, the load is not reached.
        """
        self.reach_sum(load / self.grid.cell_area)
        self.displacement_status = Displacement.STALE

    def distribute_load(self, load):
        """Distribute a load [N] evenly over C, within bounds; compute u. Collective."""
        each = load / self.grid.cell_area / max(self.cells_in_contact(), 1)
        self.pressure.setArray(self.contact.reshape(-1) * each)
        self.project()
        self.compute_displacement(exact=True)

    def destroy(self):
        """Free the vectors of this state. Collective."""
        super().destroy()
        if "right" in vars(self):
            self.right.destroy()
