"""State of the periodic method on one grid: displacement and pressure."""

from contextlib import contextmanager

import numpy as np

from app.contact.periodic_state import PeriodicState
from app.contact.state import Displacement, Pressed
from app.contact.updates import Update
from app.methods.periodic import loops, stencil

MAX_RETREAT_FRACTION = 0.75  # largest predicted retreat of the bodies, over the depth beyond first touch
CLOSING_DAMPING = 0.9  # factor on the residual that is added to w when captured gaps are closed


class PrimalState(Pressed):
    """Contact set, displacement w and pressure p of the periodic method.

    Collective. w is u - approach, and p = B w + mean pressure, where B is the inverse of A on fields without mean. The
    gap is e = shape + w. Depths are approaches beyond the reference of the undeformed distance. The field u is storage
    of the solver; `hand_out` returns a state with u.

    Parameters
    ----------
    operator : InfluenceOperator
    distance : UndeformedDistance
        Undeformed distance of the same cells.
    inverse : InverseOperator
        B, with the free cells.
    loading : Loading
        Prescribed load or approach.

    Attributes
    ----------
    w : ndarray, shape (local rows, nx), [mm]
        Displacement minus approach; must be set by the caller first.
    pending : bool
        True if only the solver has the newest w and p, as w + ``solver.change`` and ``solver.carried``. `commit` copies
        them here.
    approximate : bool
        True if p contains the error of multilevel products.
    extrapolates : bool
        True if projected sweeps guess contact sets, and if w is also corrected in the neighbours of captured cells.
        This saves iterations, but with layers the contact sets may repeat in a cycle.
    solution : ContactState or None
        Verified solution, after a solve on the target grid.
    """

    solution = None

    def __init__(self, operator, distance, inverse, loading):
        super().__init__(operator, distance, np.empty(operator.local_shape), Displacement.STALE)
        self.inverse, self.loading = inverse, loading
        self.w = np.empty(inverse.local_shape)
        self._captured = np.zeros(inverse.local_shape, bool)
        self.cells = self.grid.n
        self._has_pressure = self.pending = self.approximate = False
        self.extrapolates = True
        # Prescribed, or the Lagrange multiplier of a prescribed approach
        self.mean_pressure = float(np.nan_to_num(loading.mean_pressure_on(self.grid), posinf=0.0))

    @property
    def prescribed_depth(self):
        """Prescribed depth: minus the mean displacement w [mm].

        The depth is infinite if the load is prescribed.
        """
        return self.loading.depth_on(self.distance)

    @property
    def keeps_mean(self):
        """True if the mean displacement w is prescribed."""
        return self.prescribed_depth < np.inf

    def mean(self, field):
        """Return the mean of a field over the patch."""
        return float(self.sum([field.sum()])[0]) / self.cells

    @property
    def depth(self):
        """Present depth: minus the mean displacement w [mm]."""
        return -self.mean(self.w)

    def largest(self):
        """Return the largest absolute value of displacement w [mm]."""
        return -float(min(self.minimum([self.w.min(initial=0.0), -self.w.max(initial=0.0)])))

    @property
    def load(self):
        """Load of the pressure [N], from its mean."""
        return self.mean_pressure * self.cells * self.grid.cell_area

    def reset_for_safeguard(self):
        """Put all admissible cells into contact, and set a finite pressure."""
        self.mean_pressure = float(np.nan_to_num(self.mean_pressure, posinf=0.0, neginf=0.0))
        self.contact[...] = self.admissible
        p = self.values
        np.nan_to_num(p, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        highest = p.max(initial=0.0, where=self.admissible)
        if self.minimum([-highest])[0] == 0:
            p[...] = self.mean_pressure

    def refresh(self, exact=False):
        """Recompute the pressure p = B w + mean pressure by FFT.

        B is the inverse of A, w the displacement. If `exact` is true, the product is in double precision.
        """
        p = self.values
        compute = self.inverse.exact_pressure if exact else self.inverse.pressure
        compute(self.w, p)
        p += self.mean_pressure
        self.pending = self.approximate = False

    def balance_free_cells(self, solver):
        """Add a constant to p that makes its mean over free cells zero."""
        p = solver.carried if self.pending else self.p
        total, cells = self.sum(
            [np.sum(p, where=self.inverse.mask, dtype=float), np.count_nonzero(self.inverse.mask)]
        )
        self.add_mean_pressure(-total / max(cells, 1), p if self.pending else None)

    def loaded_cells(self):
        """Return the numbers of this rank's contact cells in the grid, and their pressures."""
        return np.flatnonzero(self.contact) + self.operator.slabs.rows.start * self.grid.nx, self.p[
            self.contact
        ]

    def interpolate_from(self, coarse, transfer):
        """Interpolate the coarser grid's displacement w and pressure p."""
        self.mean_pressure = coarse.mean_pressure
        transfer.interpolate_quintic(coarse.w, self.w)
        transfer.interpolate_quintic(coarse.p, self.values)
        self._has_pressure = True

    def shift_to_depth(self, depth, predicted):
        """Shift displacement w uniformly, to the predicted depth [mm].

        `depth` is the depth of the bodies on the coarser grid, `predicted` the depth predicted for this grid. The
        pressure does not change. If the bodies move apart, they stay in contact: the depth beyond first touch is
        reduced by a part only, and cells that touched before the shift are put into contact.
        """
        back = depth - predicted
        if back > 0:
            np.less_equal(self.w, self.distance.b, out=self.contact)
            self.contact &= self._touchable()
            back = min(back, MAX_RETREAT_FRACTION * max(depth - self.first_touch(), 0.0))
        self.w += back

    def add_mean_pressure(self, missing, carried=None):
        """Add a constant to the pressure of all cells.

        The constant `missing` [N/mm2] is added to `mean_pressure`, to p and, if given, to `carried`, the solver's p.
        """
        self.mean_pressure += missing
        p = self.values
        p += missing
        if carried is not None:
            carried += missing

    def restore_mean(self, solver, *changes):
        """Restore the mean displacement if it is prescribed.

        The correction is zero in contact cells, and is also added to each field of `changes`.
        """
        if self.keeps_mean:
            missing = -self.cells * (self.prescribed_depth + self.mean(self.w))
            solver.preconditioner.shift(missing, self.w, *changes)

    def start(self, solver):
        """Close overlaps, set a prescribed mean displacement, and compute the pressure.

        If the pressure was interpolated from the coarser grid, it is not recomputed. The 3 x 3 centre of the inverse of
        A then adds the effect of the closed overlaps.
        """
        change = solver.direction
        loops.touch(self.w, self.distance.b, self._touchable(), self.contact, change)
        if self.keeps_mean:
            self.w -= self.prescribed_depth + self.mean(self.w)
        if not self._has_pressure:
            return self.refresh()
        rows, work = solver.guess_halo(change), np.empty((3, self.w.shape[1] + 2))
        stencil.add_centre(change, *rows, solver.preconditioner.weights, work, self.values)

    def _start_fields(self):
        return self.w, self.values, self.contact

    def copy_start(self):
        """Return a copy of the fields that `restart` restores."""
        return [self.mean_pressure, self._has_pressure, *(field.copy() for field in self._start_fields())]

    def restart(self, start):
        """Restore what `copy_start` saved, and set `extrapolates` to False."""
        self.mean_pressure, self._has_pressure, *copies = start
        for field, copied in zip(self._start_fields(), copies, strict=True):
            field[...] = copied
        self.pending = self.approximate = self.extrapolates = False

    def continue_from(self, solution):
        """Start from a Solution on this grid."""
        np.subtract(solution.displacement, solution.approach - self.distance.reference, out=self.w)
        np.copyto(self.w, self.distance.b, where=solution.contact & self._touchable())
        if self.keeps_mean:
            self.mean_pressure = solution.mean_pressure

    def guess(self, solver, exact=False):
        """Guess the contact set by projected sweeps; update w and p.

        If `exact` is true, p is computed in double precision, because changes are added to it later.
        """
        shape, weights = self.w.shape, solver.preconditioner.weights
        force, lowest = solver.scratch.reshape(-1).view(np.float32).reshape(2, *shape)
        room = self._guess_sources(weights[0], force, lowest)
        x = solver.direction if solver.direction.dtype == np.float32 else np.empty(shape, np.float32)
        rows, work = solver.guess_halo, stencil.make_projected_work(solver.guess_sweeps, shape[1], room)
        sources, bound = (force, *rows(force)), (lowest, *rows(lowest))
        above = (None,) * 3 if room is None else (room, *rows(room))
        if self.extrapolates:
            stencil.sweep_projected(*sources, *bound, *above, weights, solver.guess_sweeps, x, work)
        else:
            x[...] = 0
        self._apply_guess(x, lowest)
        if not (self.loading.allows_no_contact or self.elastic_cells()):
            self._touch()
        self._update_free_cells(solver)
        self.restore_mean(solver)
        self.refresh(exact)

    def _touchable(self):
        """Return a mask of cells that may enter contact."""
        return self.admissible

    def _guess_sources(self, scale, force, lowest):
        """Compute `force` and `lowest` for `guess`; see `loops.guess_sources`.

        Return how far a pressure equal to the hardness displaces a cell [mm], or None without a hardness.
        """
        loops.guess_sources(self.p, self.w, self.distance.b, self.admissible, scale, force, lowest)

    def _apply_guess(self, x, lowest):
        """Add the guess x to w, and set contact; see `loops.apply_guess`."""
        loops.apply_guess(x, lowest, self.w, self.distance.b, self.contact)

    def _touch(self):
        """Shift the displacement so that the cells with the smallest gap touch.

        These cells become the contact set.
        """
        gap = np.where(self.admissible, self.w - self.distance.b, np.inf)
        least = float(self.minimum([gap.min(initial=np.inf)])[0])
        self.contact[...] = gap <= least
        self.w -= least  # a constant has no pressure

    def exchange(self, solver, slack, least_gap, far, residual):
        """Release cells with p < -slack; capture those with e < least_gap.

        These are steps 4.a and 4.b of Sec. 4.1 for the displacement, in one pass. p is the pressure and e the gap. So
        that the next system has a solution, at least one cell stays in contact if the load is prescribed, and at least
        one cell stays open if the approach is below full contact. Return an Update with the given `residual` [mm]. The
        number `moves`, the root of the sum of squared moves, is infinite if a released or captured cell moves by more
        than `far` [mm].
        """
        limits = slack, least_gap, solver.preconditioner.weights[0], far, self._captured
        *counts, total, squares = self.sum(self._exchange_cells(solver, *limits))
        cells, captured, released = map(int, counts)
        moves = float(np.sqrt(squares))
        approach = self.distance.reference - float(total) / self.cells
        if not (cells or self.loading.allows_no_contact):
            cells, captured, released, moves = self._keep_contact(solver, released)
        elif cells == self.cells and self.prescribed_depth < self.distance.max_depth:
            opened = self._open_least(solver)
            cells, released, moves = cells - opened, released + opened, np.inf
        if captured or released:
            self._update_free_cells(solver)
        return Update(cells, captured, released, residual, load=self.load, approach=approach, moves=moves)

    def _exchange_cells(self, solver, *limits):
        """Exchange cells of this rank; see `app.contact.bounds_loops.exchange`."""
        fields = solver.carried, None, self.w, solver.change, self.distance.b, self.contact, None
        return self.bounds.exchange(*fields, *limits)

    def _keep_contact(self, solver, released):
        """Keep some contact if all cells would be released.

        Here no cell is released; a subclass may keep fewer cells. `released` is the number of cells that would be
        released. Return the numbers of contact cells, of captured cells (new in contact) and of released cells, and how
        far these cells move [mm].
        """
        self.restore_contact()
        return released, 0, 0, 0.0

    def _open_least(self, solver):
        """Release the cells with smallest pressure; return their number."""
        least = float(self.minimum([solver.carried.min(initial=np.inf)])[0])
        opened = solver.carried <= least
        self.contact[opened] = False
        self.add_mean_pressure(-least, solver.carried)
        return int(self.sum([np.count_nonzero(opened)])[0])

    def touch_captured(self):
        """Close the gap of cells the last `exchange` captured.

        The caller recomputes p.
        """
        np.copyto(self.w, self.distance.b, where=self._captured)

    def close_captured_gaps(self, solver):
        """Set w so that captured cells have no gap, and update p.

        The change of p is computed by FFT. If `extrapolates`, a preconditioned step corrects w in the other free cells.
        """
        z, damping = solver.product, CLOSING_DAMPING if self.extrapolates else 0.0
        if self.extrapolates:
            solver.preconditioner.smooth(solver.carried, z)
        loops.close(self.w, self.distance.b, self._captured, z, -damping, solver.change)
        self.restore_mean(solver, solver.change)
        self.inverse.pressure(solver.change, z)
        p = self.values
        p += z
        self.pending = False

    def commit(self, solver):
        """Copy the solver's displacement and pressure, unless copied before.

        The displacement is w plus the solver's `change`, the pressure is its `carried`.
        """
        if not self.pending:
            return
        self.w += solver.change
        self.values[...] = solver.carried
        self.approximate |= solver.uncertainty > 0
        self.pending = False

    def finish(self, solver):
        """Finish a coarse grid: copy w and p from the solver."""
        self.commit(solver)

    def project(self, before):
        """Clip p to its bounds, and to 0 outside contact; return its sum.

        `before` receives p as it was.
        """
        before[...] = self.p
        return float(self.sum([self.bounds.project(before, self.contact, self.values)])[0])

    def meet_load(self, total):
        """Scale p to the load, if prescribed; return success.

        `total` is the sum of p before it is scaled.
        """
        return self.loading.scale_pressure(self.values, total, self.grid.cell_area)

    def hand_out(self):
        """Return a `ContactState` with this contact set and pressure.

        The pressure must be valid: without tension, and with the prescribed load. The state has u = A p, by an exact
        product, and the depth that the loading demands. It shares the fields p and u with this object.
        """
        contact = self.contact.copy()
        state = PeriodicState(self.operator, self.distance, self.u, p=self._p)
        state.contact[...] = contact
        state.compute_displacement(exact=True)
        self.loading.set_depth(state)
        return state

    def spread_load(self):
        """Set the same pressure in all contact cells."""
        self.values[...] = self.contact

    def _pressure_of(self, carried):
        """Return the pressure p that callbacks receive from the field `carried`."""
        return carried

    @contextmanager
    def shown(self, solver):
        """Return a context in which p is the solver's pressure.

        Callbacks are called in this context.
        """
        before = self.p.copy()
        self.values[...] = self._pressure_of(solver.carried)
        try:
            yield
        finally:
            self.values[...] = before

    def restore_contact(self):
        """Restore the contact set of the last solve from the free cells."""
        np.logical_not(self.inverse.mask, out=self.contact)

    def _update_free_cells(self, solver):
        """Set the free cells of the operator: all cells without contact."""
        np.logical_not(self.contact, out=self.inverse.mask)
        solver.set_contact()
