"""PETSc's own solvers for bound constraints on the same operator: TAO and SNESVI, for comparison and as oracles.

``min p.Ap / 2 + h.p, p >= 0`` with TAO (``-lcp_type tao -tao_type tron``), or the complementarity problem itself with
SNESVI (``-lcp_type snesvi``). Their linear solvers are theirs: ``-tao_*``, ``-snes_*``, ``-ksp_*``, ``-pc_*``.
"""

from __future__ import annotations

import time

import numpy as np
from petsc4py import PETSc

from app.base.petsc import TAO_REASONS, callback_context, error_message
from app.contact.history import Outcome, make_entry
from app.contact.state import Displacement, Update
from app.multigrid.linear_solver import reason_names
from app.options.solver_options import temporary_options

# Codes of PETSc errors: argument out of range and inconsistent data (line searches), floating point, no convergence
FAILURE_CODES = 63, 72, 77, 82, 91


class _ReferenceSolver:
    """What the two have in common: the whole matrix, the bounds, and what counts as solved.

    Parameters
    ----------
    hierarchy : Hierarchy
        Only the target grid is used.
    stop : StoppingTest
    """

    _name = ""
    types = ()  # the default, and others that know bounds and need no more of the matrix than products

    def __init__(self, hierarchy, stop):
        self.operator = hierarchy.target
        self.stop = stop
        self.prefix = hierarchy.prefix
        wanted = PETSc.Options(self.prefix).getString(f"{self._name}_type", self.types[0])
        if wanted not in self.types:
            raise ValueError(f"-{self._name}_type {wanted}: allowed: {', '.join(self.types)}")
        self.level = len(hierarchy.levels) - 1
        self.comm = hierarchy.petsc_comm
        self.mat = self.operator.mat(self.comm)
        self.mat.setOptionsPrefix(self.prefix or None)
        self._h = self.mat.createVecRight()

    def solve(self, state, history, start=None):
        """Solve the problem in `state`, from the pressure of a Solution `start`, if there is one. Collective.

        Returns
        -------
        Outcome

        Raises
        ------
        PETSc.Error
            If the chosen linear solver cannot do with what this matrix offers.
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
        self._record = _Record(state, history, self)
        lower, upper = state.bounds.vecs(state.pressure)
        self._h.setArray(np.where(state.admissible, -(state.distance.b + state.depth), 0.0).reshape(-1))
        acceptable = self.stop.allowed(state)
        try:
            reason = self._attempt(state.pressure, lower, upper, 0.1 * acceptable)
            norm, overlap = self._residual(state)
            self._record.end(norm)
        finally:
            self._record = None  # refers to this: a circle would keep all arrays until garbage is collected
            for vec in (lower, upper):
                vec.destroy()
        converged = np.hypot(norm, overlap) <= acceptable
        if not converged:
            wrong = "the residual is too large" if norm > overlap else "the bodies penetrate outside contact"
            reason = f"{reason}; {wrong}"
        return Outcome(converged, reason, self.iterations, norm / state.distance.norm())

    def _attempt(self, *arguments):
        """Call `_run`; return its reason, or that of PETSc for giving up. Collective."""
        try:
            return self._run(*arguments)
        except PETSc.Error as error:
            if error.ierr not in FAILURE_CODES:
                raise
            return f"{self._name.upper()}: gives up: {error_message(error)}"

    def _residual(self, state):
        """Norms of the residual (5.1) and of the penetration outside contact [mm], by a double precision product.

        Collective. Sets contact and displacement.
        """
        state.project()
        state.contact[...] = state.bounds.between(state.p)
        self.operator.exact_displacement(state.p, state.u)
        state.displacement_status = Displacement.EXACT
        e = state.gap()
        defect, overlap = e[state.contact], state.bounds.overlap(state.p, e)
        return np.sqrt(state.sum([defect @ defect, overlap @ overlap])).tolist()

    def destroy(self):
        """Free what both have. Collective."""
        for part in (self.mat, self._h):
            part.destroy()

    def _configure(self, solver):
        """Have PETSc's solver read the options. Collective."""
        try:
            solver.setFromOptions()
        except BaseException:
            self.destroy()  # which PETSc's calls back, a circle that nobody would open
            raise

    def _unless_given(self, **tolerances):
        """Those tolerances that the user has not given."""
        options = PETSc.Options(self.prefix)
        return {
            name: value for name, value in tolerances.items() if not options.hasName(f"{self._name}_{name}")
        }


class _Record:
    """Makes an entry in the history for every iteration; one waits, until it is known whether it was the last."""

    def __init__(self, state, history, solver):
        self._state, self._history, self._solver = state, history, solver
        self._waiting = None
        self._inner, self._products = 0, solver.operator.products  # of former solves
        self._started = time.perf_counter()

    def iteration(self, iteration, norm):
        """Hear of an iteration that left a residual of this norm [mm]. Collective."""
        self._write()
        if not iteration:
            return
        state, solver = self._state, self._solver
        now, before = state.bounds.between(state.p), state.contact
        counts = [np.count_nonzero(cells) for cells in (now, now & ~before, before & ~now)]
        cells, added, dropped = (int(count) for count in state.sum(counts))
        before[...] = now
        inner, work = solver.inner - self._inner, float(solver.operator.products - self._products)
        seconds = time.perf_counter() - self._started
        update = Update(cells, added, dropped, norm)
        self._waiting = make_entry(state, solver.level, iteration, update, inner, work, seconds)
        self._inner, self._products = solver.inner, solver.operator.products

    def end(self, norm):
        """Hear what the residual of the answer is, by our own measure [mm]. Not collective."""
        if self._waiting:
            self._waiting["residual"] = norm / self._state.distance.norm()
        self._write()

    def _write(self):
        if self._waiting:
            self._history.record(self._waiting, self._state)
        self._waiting = None


class Tao(_ReferenceSolver):
    """A TAO solver; default tron with Jacobi-preconditioned CG."""

    _name = "tao"
    types = "tron gpcg blmvm bncg bnls bntr bntl bqnls bqnkls bqnktr bqnktl".split()

    def __init__(self, hierarchy, stop):
        super().__init__(hierarchy, stop)
        self._make()

    def _make(self):
        self._interrupted = False
        self.tao = PETSc.TAO().create(self.comm)
        self.tao.setName(self.mat.getName())
        self.tao.setOptionsPrefix(self.prefix or None)
        self.tao.setType(self.types[0])
        self.tao.setObjectiveGradient(self._objective, None)  # PETSc 3.18 never frees a vector given here
        self.tao.setHessian(lambda tao, x, hessian, pre: None, self.mat)
        self.tao.setMaximumIterations(self.stop.max_it)
        self.tao.setMonitor(self._monitor)
        self._configure(self.tao)
        ksp = self.tao.getKSP()  # of the type that was chosen; some have none
        if ksp.handle:
            ksp.setMonitor(self._count)
            if not PETSc.Options(self.prefix).hasName("pc_type"):
                ksp.getPC().setType(PETSc.PC.Type.JACOBI)  # the default, ILU, needs an assembled matrix

    @property
    def iterations(self):
        """Iterations of the last solve."""
        return self.tao.getIterationNumber()

    def _count(self, ksp, iteration, norm):
        self.inner += iteration > 0

    def _monitor(self, tao):
        iteration, _, norm, *_ = tao.getSolutionStatus()
        self._record.iteration(iteration, norm)

    def _objective(self, tao, x, gradient):
        self.mat.mult(x, gradient)
        quadratic = x.dot(gradient)
        gradient.axpy(1.0, self._h)
        return 0.5 * quadratic + x.dot(self._h)

    def _run(self, p, lower, upper, allowed):
        if self._interrupted:
            self.tao.destroy()
            self._make()
        self.inner = 0
        self.tao.setVariableBounds((lower, upper))
        self.tao.setTolerances(**self._unless_given(gatol=allowed, grtol=0, gttol=0))
        try:
            with callback_context():
                self.tao.solve(p)
        except BaseException:
            self._interrupted = True  # vectors stay locked: another Tao is made
            raise
        return f"TAO {self.tao.getType()}: {reason_names(TAO_REASONS)[self.tao.getConvergedReason()]}"

    def destroy(self):
        """Free the solver. Collective."""
        self.tao.destroy()
        super().destroy()


class SnesVI(_ReferenceSolver):
    """A SNES for variational inequalities; default vinewtonrsls with CG."""

    _name = "snes"
    types = ("vinewtonrsls",)

    def __init__(self, hierarchy, stop):
        super().__init__(hierarchy, stop)
        self.snes = PETSc.SNES().create(self.comm)
        self.snes.setName(self.mat.getName())
        self.snes.setOptionsPrefix(self.prefix or None)
        self.snes.setType(self.types[0])
        self._template = self.mat.createVecRight()
        self.snes.setFunction(self._function, self._template)
        self.snes.setJacobian(lambda snes, x, jacobian, pre: None, self.mat)
        self.snes.setTolerances(max_it=stop.max_it)
        self.snes.setMonitor(lambda snes, iteration, norm: self._record.iteration(iteration, norm))
        ksp = self.snes.getKSP()
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=1e-8)
        # PETSc's own default is a pressure of 1e-8, whatever the units.
        with temporary_options(self.prefix, {"snes_vi_zero_tolerance": "0"}, {}):
            self._configure(self.snes)

    @property
    def iterations(self):
        """Iterations of the last solve."""
        return self.snes.getIterationNumber()

    @property
    def inner(self):
        """Iterations of the linear solver in the last solve, so far."""
        return self.snes.getLinearSolveIterations()

    def _function(self, snes, x, f):
        self.mat.mult(x, f)
        f.axpy(1.0, self._h)

    def _run(self, p, lower, upper, allowed):
        self.snes.setVariableBounds(lower, upper)
        self.snes.setTolerances(**self._unless_given(rtol=0, atol=allowed, stol=0))
        try:
            with callback_context():
                self.snes.solve(None, p)
        except BaseException:
            self.snes.getKSP().reset()  # it would keep the number of unknowns it has been left with
            raise
        reason = reason_names(PETSc.SNES.ConvergedReason)[self.snes.getConvergedReason()]
        return f"SNES {self.snes.getType()}: {reason}"

    def destroy(self):
        """Free the solver. Collective."""
        self.snes.destroy()
        self._template.destroy()
        super().destroy()


REFERENCE_SOLVERS = {"tao": Tao, "snesvi": SnesVI}
