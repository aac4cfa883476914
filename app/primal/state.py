"""The primal unknowns on one grid: w and p = B w + mean pressure, beside the `ContactState` that they end in."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.contact.grid_errors import numbers_on
from app.contact.state import Displacement, Update
from app.primal import kernels as loops
from app.primal import stencil

_GUESSES = 8  # projected sweeps that guess the first contact set of a grid
_SHARE = 0.7  # of the preconditioned residual is taken along when captured cells are closed


class PrimalState:
    """w = u - approach, the displacement against the other body; e = shape + w is the gap.

    Lengths are counted from the reference of the undeformed distance. Collective.

    Parameters
    ----------
    state : ContactState
        At depth 0. Its contact set and pressure are worked on; u only holds A p after `verify`.
    inverse : InverseOperator
    loading : PrescribedApproach or PrescribedLoad

    Attributes
    ----------
    w : ndarray, shape (local rows, nx), [mm]
    displacements : Vec
        The same.
    """

    def __init__(self, state, inverse, loading):
        self.state, self.inverse, self.loading = state, inverse, loading
        state.depth = 0.0
        self.w = np.zeros(inverse.local_shape)
        self.displacements = PETSc.Vec().createWithArray(self.w.reshape(-1), comm=inverse.petsc_comm)
        self.zero = self.displacements.duplicate()
        self._captured = np.zeros(inverse.local_shape, bool)
        grid = state.grid
        self.cells = grid.n
        self.mean_pressure = 0.0  # the Lagrange multiplier of a prescribed approach; known under a load
        if loading.prescribes_load:
            self.mean_pressure = loading.load / (grid.n * grid.cell_area)

    # -- what it is -------------------------------------------------------------------------------------

    @property
    def mean_displacement(self):
        """What the mean of w has to be under a prescribed approach: minus the depth [mm]. Not collective."""
        return -(self.loading.approach - self.state.distance.reference)

    def mean(self, field):
        """Mean of a field over all cells of the patch. Collective."""
        return float(self.state.sum([field.sum()])[0]) / self.cells

    @property
    def full(self):
        """Whether all cells are in contact. Collective."""
        return not self.state.sum([np.count_nonzero(self.inverse.mask)])[0]

    def contact_changed(self):
        """Take over another contact set: the free cells are the others. Not collective."""
        np.logical_not(self.state.contact, out=self.inverse.mask)

    def begin_again(self):
        """Contact everywhere, p = 0 where it makes no sense any more. Collective."""
        with self.state.pressure as p:
            np.nan_to_num(p, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        self.state.contact[...] = self.state.admissible

    def refresh(self, exact=False):
        """p = B w + mean pressure. Collective."""
        with self.state.pressure as values:
            p = values.reshape(self.w.shape)
            (self.inverse.exact_pressure if exact else self.inverse.displacement)(self.w, p)
            p += self.mean_pressure
        self.state.u_is = Displacement.STALE

    def balance(self):
        """Under a prescribed approach let the pressure left on the free cells have no mean there. Collective."""
        total, cells = self.state.sum(
            [np.sum(self.state.p, where=self.inverse.mask), np.count_nonzero(self.inverse.mask)]
        )
        self.add_mean_pressure(-total / max(cells, 1))

    def add_mean_pressure(self, missing):
        """Under a prescribed approach the mean pressure is an unknown. Not collective."""
        self.mean_pressure += missing
        with self.state.pressure as values:
            values += missing

    def restore_mean(self, solver):
        """Under a prescribed approach let w have its mean, by what the free cells do. Collective."""
        if not self.loading.prescribes_load:
            solver.set_contact()
            solver.preconditioner.shift(self.w, self.cells * (self.mean_displacement - self.mean(self.w)))

    # -- steps ------------------------------------------------------------------------------------------

    def start(self, exact):
        """Begin from w: overlaps are closed, p follows; the mean of w is as prescribed. Collective."""
        state, b = self.state, self.state.distance.b
        np.maximum(self.w, b, out=self.w, where=state.admissible)
        np.less_equal(self.w, b, out=state.contact)
        state.contact &= state.admissible
        if not self.loading.prescribes_load:
            self.w += self.mean_displacement - self.mean(self.w)
        self.refresh(exact)

    def continue_from(self, solution):
        """Take w, and under a prescribed approach the mean pressure, from a Solution on this grid. Not collective."""
        state = self.state
        np.subtract(solution.displacement, solution.approach - state.distance.reference, out=self.w)
        np.copyto(self.w, state.distance.b, where=solution.contact & state.admissible)
        if not self.loading.prescribes_load:
            self.mean_pressure = solution.mean_pressure

    def numbers(self):
        """Numbers of the solution, as w and the mean pressure have them. Collective over the ranks of the state."""
        load = self.mean_pressure * self.cells * self.state.grid.cell_area
        return numbers_on(self.state, load, -self.mean(self.w))

    def guess(self, solver):
        """The contact set of the obstacle problem in small, by projected sweeps with the centre of B; w and p follow.

        Collective.
        """
        state, preconditioner = self.state, solver.preconditioner
        weights, shape = preconditioner.weights, self.w.shape
        force, lowest = np.empty(shape, np.float32), np.empty(shape, np.float32)
        loops.guess_sources(state.p, self.w, state.distance.b, state.admissible, weights[0], force, lowest)
        x = solver.direction if solver.direction.dtype == np.float32 else np.empty(shape, np.float32)
        rows = solver.rows_for_guess(_GUESSES - 1)
        stencil.sweep_projected(force, *rows(force), lowest, *rows(lowest), weights, _GUESSES, x)
        before, old = self.w.copy(), state.contact.copy()
        cells, changed = state.sum(loops.take(x, lowest, self.w, state.distance.b, state.contact))
        self.contact_changed()
        self.restore_mean(solver)
        np.subtract(self.w, before, out=before)
        self._add_pressure_of(before, solver)
        return Update(int(cells), *self._counts(old), residual=float("nan"))

    def exchange(self, tension, overlap):
        """Cells with p < tension are released, others with e < overlap captured; return the Update. Collective."""
        state = self.state
        counts = loops.exchange(
            state.p, self.w, state.distance.b, state.admissible, state.contact, tension, overlap, self._captured
        )  # fmt: skip
        cells, captured, released = (int(count) for count in state.sum(counts))
        self.contact_changed()
        return Update(cells, captured, released, residual=float("nan"))

    def close(self, solver):
        """The gap of captured cells becomes zero; what that leaves to do elsewhere is begun with. Collective."""
        state = self.state
        residual, z = solver.scratch
        loops.free_residual(state.p, state.contact, 0.0, residual)
        solver.set_contact()
        solver.preconditioner.smooth(residual, z)
        change = solver.direction
        loops.close(self.w, state.distance.b, self._captured, z, _SHARE, change)
        if not self.loading.prescribes_load:
            before = self.w.copy()
            self.restore_mean(solver)
            change += self.w - before
        self._add_pressure_of(change, solver)

    def _add_pressure_of(self, change, solver):
        self.inverse.displacement(change, solver.product)
        with self.state.pressure as values:
            values += solver.product.reshape(-1)
        self.state.u_is = Displacement.STALE

    def _counts(self, old):
        new = self.state.contact
        return (int(n) for n in self.state.sum([np.count_nonzero(new & ~old), np.count_nonzero(old & ~new)]))

    def destroy(self):
        """Free the vectors. Collective."""
        self.displacements.destroy()
        self.zero.destroy()
