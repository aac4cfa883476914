"""The linear solver of one contact system: a KSP on the masked operator, set up from the options database.

Whatever PETSc offers for a matrix that can be multiplied can be chosen: ``-ksp_type cg -pc_type none`` (NORM),
``-pc_type jacobi``, ``-pc_type mg`` (see `pcmg`), ``-pc_type python -pc_python_type ...`` (see `circulant`).
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve

from app.multigrid.krylov import TrackingCG
from app.multigrid.pcmg import SMOOTHER_DEFAULTS, Multigrid, options_set, replicated_matrix


def reason_names(reasons):
    """Names of the values of one of PETSc's classes of reasons, by value."""
    return {value: name for name, value in vars(reasons).items() if isinstance(value, int)}


_REASONS = reason_names(PETSc.KSP.ConvergedReason)
_KRYLOV_RESIDUAL_IS_TRUE = (PETSc.KSP.NormType.UNPRECONDITIONED,)


class LinearSolver:
    """Solves C A C p = b for the contact set in the operator's mask.

    Collective over `comm`.

    Parameters
    ----------
    hierarchy : Hierarchy
    level : int
        Number of the grid the system lives on; default the target.
    comm : PETSc communicator, optional
        Default: that of the hierarchy.
    prefix : str
        Of the options.
    operator : InfluenceOperator, optional
        In place of that level's: the same in a window. Not with -pc_type mg.
    """

    def __init__(self, hierarchy, level=-1, comm=None, prefix="", operator=None):
        self.level = range(len(hierarchy.levels))[level]
        operators = hierarchy.levels[: self.level + 1]
        if operator not in (None, operators[-1]):
            operators = [operator]
        self.operator = operators[-1]
        self._weights = [(op, hierarchy.share(op)) for op in operators]
        comm = comm or PETSc.Comm(hierarchy.comm)
        self.mat = self.operator.mat(comm)
        self.ksp = ksp = PETSc.KSP().create(comm)
        ksp.setOptionsPrefix(prefix)
        ksp.setOperators(self.mat)
        options = PETSc.Options(prefix)
        self.multigrid = None
        if options.getString("pc_type", "") == "mg":
            levels, transfers = hierarchy.levels, hierarchy.transfers
            self.multigrid = Multigrid(
                ksp, levels[: self.level + 1], transfers[: self.level + 1], comm, len(levels)
            )
        # The grids of a nested iteration have fewer levels than the target grid may have been given.
        forced = {"pc_mg_levels": str(len(self.multigrid.operators))} if self.multigrid else {}
        with options_set(prefix, SMOOTHER_DEFAULTS if self.multigrid else {}, forced):
            ksp.setFromOptions()
            if self.multigrid:
                self.multigrid.contact_changed()
            if ksp.getNormType() == PETSc.KSP.NormType.NONE:
                ksp.setTolerances(rtol=0, atol=0)  # otherwise PETSc spends a product on a norm nobody reads
            ksp.setUp()
        rtol, atol, _, max_it = ksp.getTolerances()
        for name, value, allowed in (("rtol", rtol, 0), ("atol", atol, 0), ("max_it", max_it, 1)):
            if value < allowed:
                raise ValueError(f"-{prefix}ksp_{name} {value:g}: allowed: from {allowed}")
        self._rtol = rtol
        self._own_atol = options.hasName("ksp_atol")
        context = ksp.getPythonContext() if ksp.getType() == PETSc.KSP.Type.PYTHON else None
        self._tracking = context if isinstance(context, TrackingCG) else None
        self._work = None

    def contact_changed(self):
        """Take over the contact set that is in the operator's mask now. Collective."""
        if self.multigrid:
            self.multigrid.contact_changed()
        else:
            self.operator.mask_changed()

    @property
    def work_units(self):
        """Work so far in the paper's count: products and sweeps by the KSP, one on the target grid being one.

        What the coarsest grid of a multigrid method costs is left out.
        """
        counted = (
            self._weights[-len(self.multigrid.operators) + 1 :] if self.multigrid else self._weights[-1:]
        )
        return float(sum(share * (op.products + op.sweeps) for op, share in counted))

    @property
    def tracks(self):
        """Whether `track` is available: the KSP keeps u = A p up to date."""
        return self._tracking is not None

    @property
    def work(self):
        """A Vec that is free between solves."""
        if self._work is None:
            self._work = self.mat.createVecRight()
        return self._work

    def solve(self, b, x, allowed):
        """Solve C A C x = b from x = 0, as far as the options go.

        Collective.

        Parameters
        ----------
        b, x : Vec
        allowed : float
            Norm of the residual that is small enough [mm]; the absolute tolerance of Krylov methods that
            monitor the true residual, unless -ksp_atol is given.

        Returns
        -------
        iterations : int
        failure : str
            Empty, or why the solver cannot go on. Running out of iterations is no failure: one cycle, or a
            few steps of CG, are what an active set iteration wants.
        """
        self.ksp.setInitialGuessNonzero(False)
        return self._solve(b, x, allowed)

    def track(self, b, x, u, allowed, balance=False, resume=False):
        """Improve x and u = A x towards C A C x = b; `b` holds the residual on exit.

        Collective. For solvers that `tracks`.

        Parameters
        ----------
        b, x : Vec
        u : ndarray, shape (local rows, nx)
        allowed : float
        balance : bool
            Keep the sum of x and shift b instead.
        resume : bool
            Nothing has changed since the last call.

        Returns
        -------
        iterations : int
        failure : str
            As of `solve`.
        residual, shift : float
        """
        tracking = self._tracking
        self.ksp.setInitialGuessNonzero(True)
        tracking.displacement, tracking.balance, tracking.resume = u, balance, resume
        iterations, failure = self._solve(b, x, allowed)
        return iterations, failure, tracking.residual, tracking.shift

    def correct(self, r, x, step):
        """Add a multiple of the preconditioned residual: x += step M r on C. Collective. For solvers that `tracks`."""
        self._tracking.correct(self.ksp, r, x, step)

    def foresee(self, r):
        """Return what reducing the residual r will add to u around C; None if unknown. Collective. If it `tracks`."""
        return self._tracking.foresee(self.ksp, r)

    def tighten(self):
        """Ask for ten times the relative accuracy from now on. Not collective."""
        rtol = self.ksp.getTolerances()[0]
        self.ksp.setTolerances(rtol=max(0.1 * rtol, 1e-12))

    def relax(self):
        """Ask for the relative accuracy of the options again. Not collective."""
        self.ksp.setTolerances(rtol=self._rtol)

    def _solve(self, b, x, allowed):
        if not self._own_atol and self.ksp.getNormType() in _KRYLOV_RESIDUAL_IS_TRUE:
            # A hair below: what passes here must pass the same test on the recomputed residual.
            self.ksp.setTolerances(atol=allowed * (1 - 1e-9))
        self.ksp.solve(b, x)
        reason = self.ksp.getConvergedReason()
        failed = reason < 0 and reason != PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT
        return self.ksp.getIterationNumber(), _REASONS.get(reason, str(reason)) if failed else ""

    def destroy(self):
        """Free the KSP. Collective."""
        self.ksp.destroy()
        if self._work is not None:
            self._work.destroy()
        if self.multigrid:
            self.multigrid.destroy()


class DirectSolver:
    """The same on a small replicated grid, by Cholesky factorisation of A on C. Not collective.

    Parameters
    ----------
    operator : InfluenceOperator
        On a grid of at most `LARGEST_DIRECT` cells.
    level : int
        Its number in the hierarchy.
    """

    tracks = False
    work_units = 0.0

    def __init__(self, operator, level=0):
        self.level, self.operator = level, operator
        self._matrix = replicated_matrix(operator)
        self._factors = None
        self.work = PETSc.Vec().createSeq(operator.grid.n)

    def contact_changed(self):
        """See `LinearSolver.contact_changed`."""
        self._inside = self.operator.mask.reshape(-1).copy()
        self._factors = cho_factor(self._matrix[np.ix_(self._inside, self._inside)], overwrite_a=True)

    def solve(self, b, p, allowed):
        """See `LinearSolver.solve`."""
        right = b.getArray(readonly=True)[self._inside]
        with p as solution:
            solution[...] = 0
            solution[self._inside] = cho_solve(self._factors, right)
        return 1, ""

    def destroy(self):
        """Free the work vector."""
        self.work.destroy()
