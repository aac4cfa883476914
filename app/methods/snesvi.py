"""SNESVI, PETSc's solver of variational inequalities: a reference that shares only the product with A.

The options are ``-lcp_type snesvi``, ``-snes_*``, ``-ksp_*`` and ``-pc_*``.
"""

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import clock
from app.base.petsc import calling_petsc, error_message
from app.contact.history import Outcome, make_entry
from app.contact.state import Displacement
from app.contact.updates import Update
from app.multigrid.linear_solver import reason_names
from app.options.solver_options import temporary_options

# PETSc errors without a solution: argument out of range and inconsistent data (line searches), floating point, no
# convergence
FAILURE_CODES = 63, 72, 77, 82, 91
TYPE = "vinewtonrsls"  # the only SNES that handles bounds with matrix products alone


class SnesVI:
    """SNES for variational inequalities on the target grid, by default with CG. Collective."""

    def __init__(self, hierarchy, stop):
        self.operator = hierarchy.target
        self.stop = stop
        self.prefix = hierarchy.prefix
        kind = PETSc.Options(self.prefix).getString("snes_type", TYPE)
        if kind != TYPE:
            raise ValueError(f"-snes_type {kind}: allowed: {TYPE}")
        self.level = len(hierarchy.levels) - 1
        self.mat = self.operator.mat(hierarchy.petsc_comm)
        self.mat.setOptionsPrefix(self.prefix or None)
        self._h, self._template = self.mat.createVecRight(), self.mat.createVecRight()
        self.snes = PETSc.SNES().create(hierarchy.petsc_comm)
        self.snes.setName(self.mat.getName())
        self.snes.setOptionsPrefix(self.prefix or None)
        self.snes.setType(TYPE)
        self.snes.setFunction(self._function, self._template)
        self.snes.setJacobian(lambda snes, x, jacobian, pre: None, self.mat)
        self.snes.setTolerances(max_it=stop.max_it)
        self.snes.setMonitor(lambda snes, iteration, norm: self._record(iteration, norm))
        ksp = self.snes.getKSP()
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=1e-8)
        try:
            # PETSc's default is a pressure of 1e-8 in any unit.
            with temporary_options(self.prefix, {"snes_vi_zero_tolerance": "0"}, {}), calling_petsc():
                self.snes.setFromOptions()
        except BaseException:
            self.destroy()  # PETSc's solver refers to our callbacks, which refer to it
            raise

    def solve(self, state, history, start=None):
        """Solve the contact problem for the approach of `state`.

        The initial pressure is taken from the Solution `start`, if given. Return the Outcome. Raises a PETSc.Error if
        the chosen linear solver needs the entries of the matrix.
        """
        for listener in history.listeners:
            listener.start(state, self.level)
        self.operator.mask[...] = True  # the matrix is A, not C A C
        state.contact = np.zeros(state.u.shape, bool)  # no longer the operator's
        if start is None:
            state.start_from_interpenetration()
        else:
            state.values[...] = start.pressure
            state.project()
        self._state, self._history, self._entry = state, history, None
        self._last_inner, self._last_products, self._started = 0, self.operator.products, clock()
        lower, upper = state.bounds.vecs(state.pressure)
        self._h.setArray(np.where(state.admissible, -(state.distance.b + state.depth), 0.0).reshape(-1))
        acceptable = self.stop.allowed(state)
        try:
            try:
                reason = self._run(state.pressure, lower, upper, 0.1 * acceptable)
            except PETSc.Error as error:
                if error.ierr not in FAILURE_CODES:
                    raise
                reason = f"SNES: gives up: {error_message(error)}"
            norm, overlap = self._residual(state)
            if self._entry:
                self._entry["residual"] = norm / state.h_norm
            self._write_entry()
        finally:
            self._state = self._history = self._entry = None
            for vec in (lower, upper):
                vec.destroy()
        converged = np.hypot(norm, overlap) <= acceptable
        if not converged:
            wrong = "the residual is too large" if norm > overlap else "the bodies penetrate outside contact"
            reason = f"{reason}; {wrong}"
        return Outcome(converged, reason, self.snes.getIterationNumber(), norm / state.h_norm)

    def _function(self, snes, x, f):
        self.mat.mult(x, f)
        f.axpy(1.0, self._h)

    def _run(self, p, lower, upper, allowed):
        """Solve for `p` to a residual norm [mm]; options override the tolerances. Return the reason."""
        options = PETSc.Options(self.prefix)
        tolerances = {"rtol": 0, "atol": allowed, "stol": 0}
        self.snes.setTolerances(
            **{key: value for key, value in tolerances.items() if not options.hasName(f"snes_{key}")}
        )
        self.snes.setVariableBounds(lower, upper)
        try:
            with calling_petsc():
                self.snes.solve(None, p)
        except BaseException:
            self.snes.getKSP().reset()  # it would keep its number of unknowns
            raise
        return f"SNES {TYPE}: {reason_names(PETSc.SNES.ConvergedReason)[self.snes.getConvergedReason()]}"

    def _residual(self, state):
        """Return the norms of gap in contact and overlap outside [mm].

        A product in double precision gives both norms. It also sets the contact set and the displacement of `state`.
        """
        state.project()
        state.contact[...] = state.bounds.between(state.p)
        self.operator.exact_displacement(state.p, state.u)
        state.displacement_status = Displacement.EXACT
        e = state.gap()
        defect, overlap = e[state.contact], state.bounds.overlap(state.p, e)
        return np.sqrt(state.sum([defect @ defect, overlap @ overlap])).tolist()

    def _record(self, iteration, norm):
        """Store the history entry of an iteration; write the previous entry.

        `norm` is PETSc's norm of the residual. The last entry is written at the end of the solve, with the residual of
        (5.1) instead.
        """
        self._write_entry()
        if not iteration:
            return
        state = self._state
        contact, before = state.bounds.between(state.p), state.contact
        counts = [np.count_nonzero(cells) for cells in (contact, contact & ~before, before & ~contact)]
        cells, added, dropped = (int(count) for count in state.sum(counts))
        before[...] = contact
        all_inner = self.snes.getLinearSolveIterations()
        inner, work = all_inner - self._last_inner, float(self.operator.products - self._last_products)
        seconds, update = clock() - self._started, Update(cells, added, dropped, norm)
        self._entry = make_entry(state, self.level, iteration, update, inner, work, seconds)
        self._last_inner, self._last_products = all_inner, self.operator.products

    def _write_entry(self):
        if self._entry:
            self._history.record(self._entry, self._state)
        self._entry = None

    def destroy(self):
        """Free the SNES solver, matrix and vectors."""
        for part in (self.snes, self.mat, self._h, self._template):
            part.destroy()
