"""The primal unknowns on one grid: w and p = B w + mean pressure, beside the `ContactState` that they end in."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np

from app.contact.grid_errors import compute_grid_numbers
from app.contact.state import Displacement, Update
from app.methods.periodic import kernels as loops
from app.methods.periodic import stencil

MAX_RETREAT_FRACTION = 0.75  # of the way to first touch: as far as a predicted retreat is believed
CLOSING_DAMPING = (
    0.9  # damping of the preconditioned residual that is added to w when captured gaps are closed
)


class PrimalState:
    """w = u - approach, the displacement against the other body; e = shape + w is the gap.

    Lengths are counted from the reference of the undeformed distance. Collective.

    Parameters
    ----------
    state : ContactState
        Is put to depth 0. Its contact set and pressure are worked on; u only holds A p after `verify`.
    inverse : InverseOperator
    loading : Loading

    Attributes
    ----------
    w : ndarray, shape (local rows, nx), [mm]
        To be set first of all.
    lags : bool
        The newest w and p are w + `change` and `carried` of the solver, not those here.
    is_nearly : bool
        Part of p has been carried along by levels.
    """

    def __init__(self, state, inverse, loading):
        self.state, self.inverse, self.loading = state, inverse, loading
        state.depth = 0.0
        self.w = np.empty(inverse.local_shape)
        self._captured = np.zeros(inverse.local_shape, bool)
        grid = state.grid
        self.cells = grid.n
        self._has_pressure = self.lags = self.is_nearly = False
        # Prescribed, or the Lagrange multiplier of a prescribed approach.
        self.mean_pressure = float(np.nan_to_num(loading.mean_pressure_on(grid), posinf=0.0))

    # -- what it is -------------------------------------------------------------------------------------

    @property
    def prescribed_depth(self):
        """The depth of a prescribed approach: minus the mean that w has to have; infinite under a load [mm].

        Not collective.
        """
        return self.loading.depth_on(self.state.distance)

    def mean(self, field):
        """Mean of a field over all cells of the patch. Collective."""
        return float(self.state.sum([field.sum()])[0]) / self.cells

    @property
    def depth(self):
        """What the mean of w says that it is now [mm]. Collective."""
        return -self.mean(self.w)

    def largest(self):
        """Largest |w|, by which rounding is measured [mm]. Collective."""
        return -float(min(self.state.minimum([self.w.min(initial=0.0), -self.w.max(initial=0.0)])))

    @property
    def load(self):
        """That of p: B w has none [N]. Not collective."""
        return self.mean_pressure * self.cells * self.state.grid.cell_area

    def reset_for_safeguard(self):
        """Contact everywhere, and some pressure that makes sense, or none. Collective."""
        self.mean_pressure = float(np.nan_to_num(self.mean_pressure, posinf=0.0, neginf=0.0))
        self.state.contact[...] = self.state.admissible
        p = self.state.values
        np.nan_to_num(p, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        highest = p.max(initial=0.0, where=self.state.admissible)
        if self.state.minimum([-highest])[0] == 0:
            p[...] = self.mean_pressure

    def refresh(self, exact=False):
        """p = B w + mean pressure. Collective."""
        p = self.state.values
        (self.inverse.exact_pressure if exact else self.inverse.pressure)(self.w, p)
        p += self.mean_pressure
        self.state.displacement_status = Displacement.STALE
        self.lags = self.is_nearly = False

    def balance_free_cells(self, solver):
        """Under a prescribed approach let the pressure left on the free cells have no mean there. Collective."""
        p = solver.carried if self.lags else self.state.p
        total, cells = self.state.sum(
            [np.sum(p, where=self.inverse.mask, dtype=float), np.count_nonzero(self.inverse.mask)]
        )
        self.add_mean_pressure(-total / max(cells, 1), p if self.lags else None)

    def come_from(self, coarse, transfer):
        """Begin with w and p of the coarser grid, interpolated. Collective."""
        self.mean_pressure = coarse.mean_pressure
        transfer.interpolate_smoothly(coarse.w, self.w)
        transfer.interpolate_smoothly(coarse.state.p, self.state.values)
        self.state.displacement_status = Displacement.STALE
        self._has_pressure = True

    def shift_to_depth(self, depth, predicted):
        """Take w of the grid before to the depth predicted for this one, from that found there [mm]. Not collective.

        A constant has no pressure. Back the bodies go most of the way to first touch at most, where a prediction that
        is too bold would leave nothing of the contact; and cells that touched still do.
        """
        back, state = depth - predicted, self.state
        if back > 0:
            np.less_equal(self.w, state.distance.b, out=state.contact)
            state.contact &= state.admissible
            back = min(back, MAX_RETREAT_FRACTION * max(depth - state.first_touch(), 0.0))
        self.w += back

    def add_mean_pressure(self, missing, carried=None):
        """Under a prescribed approach the mean pressure is an unknown: add to it, p and `carried`. Not collective."""
        self.mean_pressure += missing
        p = self.state.values
        p += missing
        if carried is not None:
            carried += missing

    def restore_mean(self, solver, *changes):
        """Under a prescribed approach let w have its mean, by what the free cells do; add it to changes. Collective."""
        if self.loading.approach_is_known:
            missing = -self.cells * (self.prescribed_depth + self.mean(self.w))
            solver.preconditioner.shift(missing, self.w, *changes)

    # -- steps ------------------------------------------------------------------------------------------

    def start(self, solver):
        """Begin from w: overlaps are closed, the mean of w is as prescribed; and from a p that is good enough to guess.

        Collective. From a coarser grid there is one, to which is added what closing overlaps makes of it near by.
        """
        state, change = self.state, solver.direction
        loops.touch(self.w, state.distance.b, state.admissible, state.contact, change)
        if self.loading.approach_is_known:
            self.w -= self.prescribed_depth + self.mean(self.w)
        if not self._has_pressure:
            return self.refresh()
        rows, room = solver.rows_beside(change), np.empty((3, self.w.shape[1] + 2))
        stencil.add_centre(change, *rows, solver.preconditioner.weights, room, state.values)

    def continue_from(self, solution):
        """Take w, and under a prescribed approach the mean pressure, from a Solution on this grid. Not collective."""
        state = self.state
        np.subtract(solution.displacement, solution.approach - state.distance.reference, out=self.w)
        np.copyto(self.w, state.distance.b, where=solution.contact & state.admissible)
        if self.loading.approach_is_known:
            self.mean_pressure = solution.mean_pressure

    def numbers(self):
        """Numbers of the solution, as w and the mean pressure have them. Collective over the ranks of the state."""
        return compute_grid_numbers(self.state, self.state.comm, self.load, self.depth)

    def guess(self, solver, exact=False):
        """The contact set by projected sweeps with the centre of B: an obstacle problem; w and p follow. Collective.

        `exact`: p by a product in double precision, for changes are added to it from here on.
        """
        state, preconditioner = self.state, solver.preconditioner
        weights, shape = preconditioner.weights, self.w.shape
        force, lowest = solver.scratch.reshape(-1).view(np.float32).reshape(2, *shape)
        loops.guess_sources(state.p, self.w, state.distance.b, state.admissible, weights[0], force, lowest)
        x = solver.direction if solver.direction.dtype == np.float32 else np.empty(shape, np.float32)
        rows = solver.rows_beside
        room = stencil.make_room(solver.guesses, shape[1], np.float32)
        stencil.sweep_projected(force, *rows(force), lowest, *rows(lowest), weights, solver.guesses, x, room)
        loops.take(x, lowest, self.w, state.distance.b, state.contact)
        if not (self.loading.allows_no_contact or state.cells_in_contact()):
            self._touch()
        self._contact_changed(solver)
        self.restore_mean(solver)
        self.refresh(exact)

    def _touch(self):
        """Under a load: the cells with the least gap become the contact set, and touch. Collective."""
        state = self.state
        gap = np.where(state.admissible, self.w - state.distance.b, np.inf)
        least = float(state.minimum([gap.min(initial=np.inf)])[0])
        state.contact[...] = gap <= least
        self.w -= least  # a constant has no pressure

    def exchange(self, solver, slack, least_gap, far, residual):
        """Cells with p < -slack are released, others with e < least_gap captured, as `solver` has p and w.

        Collective. The system must have a solution: under a load something stays in contact, under an approach below
        that of full contact something stays open.

        Returns
        -------
        Update
            With the `residual` given [mm]; `moves` is infinite if one of these cells moves by more than `far` [mm].
        """
        state = self.state
        counts = state.bounds.exchange(
            solver.carried, self.w, solver.change, state.distance.b, state.admissible, state.contact,
            slack, least_gap, solver.preconditioner.weights[0], far, self._captured,
        )  # fmt: skip
        *counts, total, squares = state.sum(counts)
        cells, captured, released = map(int, counts)
        moves = float(np.sqrt(squares))
        approach = state.distance.reference - float(total) / self.cells
        if not (cells or self.loading.allows_no_contact):
            self.restore_contact()
            cells, released, moves = released, 0, 0.0
        elif cells == self.cells and self.prescribed_depth < state.distance.max_depth:
            opened = self._open_least(solver)
            cells, released, moves = cells - opened, released + opened, np.inf
        if captured or released:
            self._contact_changed(solver)
        return Update(cells, captured, released, residual, load=self.load, approach=approach, moves=moves)

    def _open_least(self, solver):
        """Open the cells with the least pressure, which becomes zero; return how many. Collective."""
        least = float(self.state.minimum([solver.carried.min(initial=np.inf)])[0])
        opened = solver.carried <= least
        self.state.contact[opened] = False
        self.add_mean_pressure(-least, solver.carried)
        return int(self.state.sum([np.count_nonzero(opened)])[0])

    def touch_captured(self):
        """The gap of cells just captured becomes zero, and p is to follow. Not collective."""
        np.copyto(self.w, self.state.distance.b, where=self._captured)

    def close_captured_gaps(self, solver):
        """The gap of cells just captured becomes zero, what that leaves to do elsewhere is begun with.

        Collective. w follows the solver, and p follows w: a product.
        """
        state, z = self.state, solver.product
        solver.preconditioner.smooth(solver.carried, z)
        loops.close(self.w, state.distance.b, self._captured, z, -CLOSING_DAMPING, solver.change)
        self.restore_mean(solver, solver.change)
        self.inverse.pressure(solver.change, z)
        p = state.values
        p += z
        state.displacement_status, self.lags = Displacement.STALE, False

    def commit(self, solver):
        """Let w and p be as the solver has carried them along. Not collective."""
        if not self.lags:
            return
        self.w += solver.change
        self.state.values[...] = solver.carried
        self.is_nearly |= solver.doubt > 0
        self.state.displacement_status, self.lags = Displacement.STALE, False

    @contextmanager
    def shown(self, solver):
        """Inside the block p is as the solver has carried it along, for others to look at. Not collective."""
        before = self.state.p.copy()
        self.state.values[...] = solver.carried
        try:
            yield
        finally:
            self.state.values[...] = before

    def restore_contact(self):
        """Let the contact set be as the solver knows it. Not collective."""
        np.logical_not(self.inverse.mask, out=self.state.contact)

    def _contact_changed(self, solver):
        """Make the cells that are not in contact the free ones. Collective."""
        np.logical_not(self.state.contact, out=self.inverse.mask)
        solver.set_contact()
