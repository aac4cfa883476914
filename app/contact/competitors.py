"""PETSc's own solvers for bound constraints on the same operator: TAO and SNESVI, for comparison and as oracles.

``min p.Ap / 2 + h.p, p >= 0`` with TAO (``-lcp_type tao -tao_type tron``), or the complementarity problem itself with
SNESVI (``-lcp_type snesvi``). Their linear solvers are theirs: ``-tao_*``, ``-snes_*``, ``-ksp_*``, ``-pc_*``.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.contact.loop import Outcome
from app.multigrid.linear_solver import reason_names


class _Competitor:
    """What the two have in common: the whole matrix, the bounds, and what counts as solved.

    Parameters
    ----------
    hierarchy : Hierarchy
        Only the target grid is used.
    controls : Controls
    """

    def __init__(self, hierarchy, controls):
        self.operator = hierarchy.target
        self.controls = controls
        self.level = len(hierarchy.levels) - 1
        self.comm = PETSc.Comm(hierarchy.comm)
        self.mat = self.operator.mat(self.comm)

    def solve(self, state, history):
        """Solve the problem in `state`. Collective.

        Returns
        -------
        Outcome
        """
        for listener in history.listeners:
            listener.start(state, self.level)
        self.operator.mask[...] = True  # the matrix is A, not C A C
        state.pressure.set(0)
        gap_norm = state.gap_norm()
        lower, upper = state.pressure.duplicate(), state.pressure.duplicate()
        lower.set(0)
        upper.setArray(np.where(state.admissible, PETSc.INFINITY, 0.0).reshape(-1))
        h = state.pressure.duplicate()
        h.setArray((state.shape - state.approach * state.admissible).reshape(-1))
        iterations, inner, reason = self._run(state.pressure, h, lower, upper, self.controls.rtol * gap_norm)
        with state.pressure as values:
            p = values.reshape(state.u.shape)
            np.maximum(p, 0, out=p)
            np.greater(p, 0, out=state.contact)
            self.operator.displacement(p, state.u)
        e = state.shape - state.approach + state.u
        defect = e[state.contact]
        overlap = e[state.admissible & ~state.contact].clip(max=0)
        cells, square, outside = state.sum([state.contact.sum(), defect @ defect, overlap @ overlap])
        residual = float(np.sqrt(square + outside)) / (gap_norm or 1.0)
        history.add(
            state,
            level=self.level, iteration=iterations, contact_cells=int(cells), added_cells=0, dropped_cells=0,
            changed_cells=0, residual=residual, inner_iterations=inner, work_units=float(self.operator.products),
            load=state.load, approach=state.approach, seconds=0.0,
        )  # fmt: skip
        for vec in (lower, upper, h):
            vec.destroy()
        return Outcome(residual <= self.controls.rtol, reason, iterations, inner, residual)


class Tao(_Competitor):
    """A TAO solver; default tron with Jacobi-preconditioned CG."""

    def __init__(self, hierarchy, controls):
        super().__init__(hierarchy, controls)
        self.tao = PETSc.TAO().create(self.comm)
        self.tao.setType(PETSc.TAO.Type.TRON)
        self._h, self._template = self.mat.createVecRight(), self.mat.createVecRight()
        self.tao.setObjectiveGradient(self._objective, self._template)
        self.tao.setHessian(lambda tao, x, hessian, pre: None, self.mat)
        self.tao.setMaximumIterations(1000)
        self.tao.setFromOptions()
        self._inner = 0
        ksp = self.tao.getKSP()  # of the type that was chosen; some have none
        if ksp.handle:
            ksp.setMonitor(self._count)
            if not PETSc.Options().hasName("pc_type"):
                ksp.getPC().setType(PETSc.PC.Type.JACOBI)  # the default, ILU, needs an assembled matrix

    def _count(self, ksp, iteration, norm):
        self._inner += iteration > 0

    def _objective(self, tao, x, gradient):
        self.mat.mult(x, gradient)
        quadratic = x.dot(gradient)
        gradient.axpy(1.0, self._h)
        return 0.5 * quadratic + x.dot(self._h)

    def _run(self, p, h, lower, upper, allowed):
        h.copy(self._h)
        self.tao.setVariableBounds((lower, upper))
        self.tao.setTolerances(gatol=allowed * 0.1, grtol=0, gttol=0)
        self.tao.solve(p)
        return (
            self.tao.getIterationNumber(),
            self._inner,
            f"TAO {self.tao.getType()}: {reason_names(PETSc.TAO.Reason)[self.tao.getConvergedReason()]}",
        )

    def destroy(self):
        """Free the solver. Collective."""
        self.tao.destroy()


class SnesVI(_Competitor):
    """A SNES for variational inequalities; default vinewtonrsls with Jacobi-preconditioned CG."""

    def __init__(self, hierarchy, controls):
        super().__init__(hierarchy, controls)
        self.snes = PETSc.SNES().create(self.comm)
        self.snes.setType("vinewtonrsls")
        self._h, self._residual = self.mat.createVecRight(), self.mat.createVecRight()
        self.snes.setFunction(self._function, self._residual)
        self.snes.setJacobian(lambda snes, x, jacobian, pre: None, self.mat)
        ksp = self.snes.getKSP()
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=1e-8)
        self.snes.setFromOptions()

    def _function(self, snes, x, f):
        self.mat.mult(x, f)
        f.axpy(1.0, self._h)

    def _run(self, p, h, lower, upper, allowed):
        h.copy(self._h)
        self.snes.setVariableBounds(lower, upper)
        self.snes.setTolerances(rtol=0, atol=allowed * 0.1, stol=0, max_it=200)
        self.snes.solve(None, p)
        reason = reason_names(PETSc.SNES.ConvergedReason)[self.snes.getConvergedReason()]
        return (
            self.snes.getIterationNumber(),
            self.snes.getLinearSolveIterations(),
            f"SNES {self.snes.getType()}: {reason}",
        )

    def destroy(self):
        """Free the solver. Collective."""
        self.snes.destroy()


COMPETITORS = {"tao": Tao, "snesvi": SnesVI}
