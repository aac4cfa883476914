"""PETSc's solvers for bound constraints, TAO and SNESVI.

These solvers are used for comparison, and as references in tests. TAO minimises ``p.Ap / 2 + h.p, p >= 0`` (``-lcp_type
tao -tao_type tron``). SNESVI solves the complementarity problem (``-lcp_type snesvi``). The options of both are
``-tao_*``, ``-snes_*``, ``-ksp_*`` and ``-pc_*``.
"""

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import clock
from app.base.petsc import TAO_REASONS, calling_petsc, error_message
from app.contact.history import Outcome, make_entry
from app.contact.state import Displacement, Update
from app.multigrid.linear_solver import reason_names
from app.options.solver_options import temporary_options

# PETSc errors without a solution: argument out of range and inconsistent data (line searches), floating point, no
# convergence
FAILURE_CODES = 63, 72, 77, 82, 91


class _ReferenceSolver:
    """Base of `Tao` and `SnesVI`, on the target grid. Collective."""

    _name = ""
    types = ()  # PETSc's types that handle bounds with matrix products only; the first is the default

    def __init__(self, hierarchy, stop):
        self.operator = hierarchy.target
        self.stop = stop
        self.prefix = hierarchy.prefix
        kind = PETSc.Options(self.prefix).getString(f"{self._name}_type", self.types[0])
        if kind not in self.types:
            raise ValueError(f"-{self._name}_type {kind}: allowed: {', '.join(self.types)}")
        self.level = len(hierarchy.levels) - 1
        self.comm = hierarchy.petsc_comm
        self.mat = self.operator.mat(self.comm)
        self.mat.setOptionsPrefix(self.prefix or None)
        self._h = self.mat.createVecRight()

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
                reason = f"{self._name.upper()}: gives up: {error_message(error)}"
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
        return Outcome(converged, reason, self.iterations, norm / state.h_norm)

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
        inner, work = self.inner - self._last_inner, float(self.operator.products - self._last_products)
        seconds, update = clock() - self._started, Update(cells, added, dropped, norm)
        self._entry = make_entry(state, self.level, iteration, update, inner, work, seconds)
        self._last_inner, self._last_products = self.inner, self.operator.products

    def _write_entry(self):
        if self._entry:
            self._history.record(self._entry, self._state)
        self._entry = None

    def destroy(self):
        """Free the matrix and vectors."""
        for part in (self.mat, self._h):
            part.destroy()

    def _configure(self, solver):
        """Set PETSc's options on `solver`; free everything if one is invalid."""
        try:
            with calling_petsc():
                solver.setFromOptions()
        except BaseException:
            self.destroy()  # PETSc's solver refers to our callbacks, which refer to it
            raise

    def _default_tolerances(self, **tolerances):
        """Return those `tolerances` that no option sets."""
        options = PETSc.Options(self.prefix)
        return {key: value for key, value in tolerances.items() if not options.hasName(f"{self._name}_{key}")}


class Tao(_ReferenceSolver):
    """TAO solver, by default tron with Jacobi-preconditioned CG. Collective."""

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
        self.tao.setObjectiveGradient(self._objective, None)  # PETSc 3.18 does not free a vector given here
        self.tao.setHessian(lambda tao, x, hessian, pre: None, self.mat)
        self.tao.setMaximumIterations(self.stop.max_it)
        self.tao.setMonitor(self._monitor)
        self._configure(self.tao)
        ksp = self.tao.getKSP()  # some types have none
        if ksp.handle:
            ksp.setMonitor(self._count)
            if not PETSc.Options(self.prefix).hasName("pc_type"):
                ksp.getPC().setType(PETSc.PC.Type.JACOBI)  # the default, ILU, needs an assembled matrix

    @property
    def iterations(self):
        """Number of TAO iterations of the last solve."""
        return self.tao.getIterationNumber()

    def _count(self, ksp, iteration, norm):
        self.inner += iteration > 0

    def _monitor(self, tao):
        iteration, _, norm, *_ = tao.getSolutionStatus()
        self._record(iteration, norm)

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
        self.tao.setTolerances(**self._default_tolerances(gatol=allowed, grtol=0, gttol=0))
        try:
            with calling_petsc():
                self.tao.solve(p)
        except BaseException:
            self._interrupted = True  # vectors stay locked: make another Tao
            raise
        return f"TAO {self.tao.getType()}: {reason_names(TAO_REASONS)[self.tao.getConvergedReason()]}"

    def destroy(self):
        """Free the TAO solver, matrix and vectors."""
        self.tao.destroy()
        super().destroy()


class SnesVI(_ReferenceSolver):
    """SNES for variational inequalities, by default vinewtonrsls with CG. Collective."""

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
        self.snes.setMonitor(lambda snes, iteration, norm: self._record(iteration, norm))
        ksp = self.snes.getKSP()
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=1e-8)
        # PETSc's default is a pressure of 1e-8 in any unit.
        with temporary_options(self.prefix, {"snes_vi_zero_tolerance": "0"}, {}):
            self._configure(self.snes)

    @property
    def iterations(self):
        """Number of SNES iterations of the last solve."""
        return self.snes.getIterationNumber()

    @property
    def inner(self):
        """Number of linear iterations in the present solve."""
        return self.snes.getLinearSolveIterations()

    def _function(self, snes, x, f):
        self.mat.mult(x, f)
        f.axpy(1.0, self._h)

    def _run(self, p, lower, upper, allowed):
        self.snes.setVariableBounds(lower, upper)
        self.snes.setTolerances(**self._default_tolerances(rtol=0, atol=allowed, stol=0))
        try:
            with calling_petsc():
                self.snes.solve(None, p)
        except BaseException:
            self.snes.getKSP().reset()  # it would keep its number of unknowns
            raise
        reason = reason_names(PETSc.SNES.ConvergedReason)[self.snes.getConvergedReason()]
        return f"SNES {self.snes.getType()}: {reason}"

    def destroy(self):
        """Free the SNES solver, matrix and vectors."""
        self.snes.destroy()
        self._template.destroy()
        super().destroy()


REFERENCE_SOLVERS = {"tao": Tao, "snesvi": SnesVI}
