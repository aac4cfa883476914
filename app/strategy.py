"""Which iteration solves: the paper's, the default methods', or PETSc's, from the start there is."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.contact import certificate, extent, kernels, measures
from app.contact.full_contact import FullContact
from app.contact.full_multigrid import full_multigrid
from app.contact.iteration import active_set_or_search
from app.contact.reference_solvers import REFERENCE_SOLVERS
from app.contact.state import ContactState, Displacement
from app.contact.stopping import StoppingTest
from app.errors import InputError
from app.fast import circulant, lift, tracking_cg
from app.fast.iteration import InexactStop
from app.fast.kept import Kept
from app.fast.nested import nested_iteration, solve_on
from app.halfspace import product
from app.multigrid import direct, transfer
from app.multigrid.hierarchy import Hierarchy
from app.petsc import error_message
from app.solution import Solution

# PETSc's errors that say that types do not go together: unsupported, wrong argument or state, method missing, unknown
# type, no factorisation
_WRONG_CHOICES = (56, 60, 62, 73, 75, 83, 86, 92)


class Strategy:
    """Solves on the grids of a hierarchy by the strategy of the settings.

    Collective.

    Parameters
    ----------
    settings : app.method.Settings
    hierarchy : Hierarchy
    solver : LinearSolver, a reference solver, or None
        Of the target grid.
    """

    def __init__(self, settings, hierarchy: Hierarchy, solver):
        self._settings, self._hierarchy, self._solver = settings, hierarchy, solver
        self._kept = Kept(hierarchy, solver) if settings.strategy == "fast" else None

    def measured(self, distances, coarse_minimum):
        """Solve for these undeformed distances from now on. Not collective.

        Parameters
        ----------
        distances : list of UndeformedDistance
            On every level.
        coarse_minimum : ndarray or None
            See `Hierarchy.coarse_minimum`.
        """
        self._distances, self._coarse_minimum = distances, coarse_minimum

    def run(self, loading, history, start=None):
        """Solve for a loading, from a Solution if one is given.

        Returns
        -------
        ContactState, Outcome
            On the target grid.

        Raises
        ------
        InputError
            If `start` does not fit, or PETSc finds that the chosen solvers do not go together.
        """
        chosen, hierarchy = self._settings, self._hierarchy
        if start is not None:
            self.check(start)
        for level in hierarchy.levels:
            level.begin()
        stop = StoppingTest(chosen.rtol, chosen.max_it)
        full = None
        if hierarchy.target.grid.periodic:
            full = FullContact(hierarchy, self._distances)
            state = ContactState(hierarchy.target, self._distances[-1])
            if outcome := full.solve(state, loading, stop, history):
                return state, outcome
            state.destroy()
            del state
        state, outcome = self._solve(loading, stop, history, start)
        if full and full.put_off and not (outcome.converged and state.some_are_free()):
            return self._in_full_contact(full, loading, stop, history, state, outcome)
        return state, outcome

    def _in_full_contact(self, full, loading, stop, history, state, outcome):
        """The answer with all cells in contact, if that is one, in place of what was found. Collective."""
        contact, other = state.contact.copy(), ContactState(self._hierarchy.target, self._distances[-1])
        if better := full.solve(other, loading, stop, history):
            state.destroy()
            return other, better.after(outcome)
        other.destroy()
        state.contact[...] = contact
        return state, outcome

    def _solve(self, loading, stop, history, start):
        chosen, hierarchy = self._settings, self._hierarchy
        if chosen.strategy in REFERENCE_SOLVERS:
            return self._by_petsc(loading, history)
        if chosen.strategy == "active_set":
            return self._by_active_set(loading, stop, history, start)
        stop = InexactStop(
            chosen.rtol,
            chosen.max_it,
            coarse_rtol=chosen.coarse_rtol,
            predictor=chosen.predictor,
            error_bound=chosen.error_bound,
            defect_correction=chosen.defect_correction,
        )
        if chosen.strategy == "fast":
            return self._fast(loading, stop, history, start)
        from app.primal.nested import primal_iteration

        return primal_iteration(
            hierarchy, self._distances, loading, stop, history, chosen.nested, self._solver, start=start
        )

    def _by_active_set(self, loading, stop, history, start):
        if start is not None:
            state = self._started_from(start, loading)
            return state, active_set_or_search(state, self._solver, loading, stop, history)
        chosen = self._settings
        prolong = lift.lift if chosen.lifted else None
        return full_multigrid(
            self._hierarchy, self._distances, loading, stop, history, chosen.nested, chosen.beta, prolong, self._solver
        )  # fmt: skip

    def _fast(self, loading, stop, history, start):
        chosen, hierarchy, kept = self._settings, self._hierarchy, self._kept
        if start is not None:
            state, last = self._started_from(start, loading), len(hierarchy.levels) - 1
            return state, solve_on(hierarchy, last, state, loading, stop, history, first=False, kept=kept)
        try:
            return nested_iteration(
                hierarchy, self._distances, loading, stop, history, chosen.nested, chosen.beta, chosen.lifted,
                self._coarse_minimum, kept,
            )  # fmt: skip
        except BaseException:
            kept.abandon()
            raise

    def _by_petsc(self, loading, history):
        state = ContactState(self._hierarchy.target, self._distances[-1])
        state.approach = loading.approach
        try:
            return state, self._solver.solve(state, history)
        except PETSc.Error as error:
            state.destroy()
            if error.ierr not in _WRONG_CHOICES:
                raise
            raise InputError(f"-lcp_type {self._settings.strategy}: {error_message(error)}") from None

    def destroy(self):
        """Free what is kept between solves. Collective."""
        if self._kept is not None:
            self._kept.destroy()

    def check(self, start, name="start"):
        """Refuse what is no Solution on the same grid and ranks."""
        slabs = self._hierarchy.slabs
        alike = (
            isinstance(start, Solution)
            and start.grid == self._hierarchy.target.grid
            and start.slabs.rows == slabs.rows
        )
        if not self._hierarchy.comm.allreduce(alike, MPI.LAND):
            raise InputError(f"{name}: needed: a Solution on the same grid and as many ranks")

    def _started_from(self, start, loading):
        """State of the target grid as a solution left it, at the approach of the loading."""
        state = ContactState(self._hierarchy.target, self._distances[-1], u=start.displacement.copy())
        holes = ~state.admissible & (start.pressure != 0)  # of a problem with others
        with state.pressure as p:
            p[...] = np.where(holes, 0.0, start.pressure).reshape(-1)
        if state.sum([np.count_nonzero(holes)])[0]:
            state.u_is = Displacement.STALE
        state.contact[...] = start.contact & state.admissible
        loading.resume(state, start.load)
        return state


def warm_up(settings, hierarchy):
    """Load the compiled loops of a strategy now, not in the first iteration. Not collective.

    A rank that is needed on fine grids only has time for that now; later the others would wait for it.
    """
    grid, dtype = hierarchy.target.grid, np.dtype(hierarchy.dtype)
    for module in (kernels, extent, measures, transfer, direct):
        module.warm_up()
    certificate.warm_up(bool(grid.periodic))
    if settings.lifted:
        lift.warm_up()
    if settings.strategy == "fast":
        for kind in {np.dtype(np.float64), dtype}:
            product.warm_up(grid, kind)
            tracking_cg.warm_up(kind)
        circulant.warm_up(grid, dtype)
    if settings.strategy == "primal":
        from app.primal import solver as primal_solver

        for kind in {np.dtype(np.float64), dtype}:
            primal_solver.warm_up(kind)
    kind = settings.texts.get("pc_type", "")
    if kind == "sor" or (kind == "mg" and settings.texts.get("mg_levels_pc_type", "") in ("", "sor")):
        from app.halfspace.sweeps import gauss_seidel

        gauss_seidel.warm_up()


def check_single(what, value, unit):
    """Refuse what single precision has no numbers for. Not collective."""
    if value and not 1e-25 < value < 1e25:
        raise InputError(
            f"-lcp_precision single: {what} of {value:.0e} {unit} are beyond it; choose -lcp_precision double, "
            "or units nearer to the bodies'"
        )
