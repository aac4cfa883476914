"""The linear solver of one contact system (2.11): a KSP on the masked operator, set up from PETSc's options.

Whatever PETSc offers for a matrix that can be multiplied can be chosen: ``-ksp_type cg -pc_type none`` (NORM),
``-pc_type jacobi``, ``-pc_type python -pc_python_type ...``. ``-pc_type mg`` stands for the one of `pcmg`.
"""

from __future__ import annotations

import math

from petsc4py import PETSc

from app.base.errors import format_exact
from app.base.petsc import callback_context
from app.options.solver_options import temporary_options


def reason_names(reasons):
    """Names of the values of one of PETSc's classes of reasons, by value. Not collective."""
    return {value: name for name, value in vars(reasons).items() if isinstance(value, int)}


_REASONS = reason_names(PETSc.KSP.ConvergedReason)
_MULTIGRID = {"pc_type": "python", "pc_python_type": "app.multigrid.ContactMG"}  # in place of -pc_type mg
# PCs that need parts which options alone cannot give, or the triangles of a matrix
_NEED_PARTS = ("shell", "composite", "galerkin", "fieldsplit", "ksp", "mat", "eisenstat")


class LinearSolver:
    """Solves C A C p = b for the contact set in the operator's mask.

    Collective over the ranks of the grid. Options are read from PETSc's database as it is now.

    Parameters
    ----------
    hierarchy : Hierarchy
    level : int
        Number of the grid the system lives on; default the target.
    operator : InfluenceOperator, optional
        In place of that level's: the same in a window.

    Raises
    ------
    ValueError, PETSc.Error
        If the options ask for what cannot be had.
    """

    def __init__(self, hierarchy, level=-1, operator=None):
        self.level = range(len(hierarchy.levels))[level]
        self.operator = operator or hierarchy.levels[self.level]
        self._work, self._interrupted = None, False
        self.mat = self.operator.mat(self.operator.petsc_comm)
        self._prefix = hierarchy.prefix
        self.mat.setOptionsPrefix(self._prefix or None)
        # PETSc would view the solver of every grid after every solve; once, on the target grid, is enough.
        self._view = "-ksp_view" if self.level == len(hierarchy.levels) - 1 else ""
        self._hierarchy = hierarchy
        self._make()

    def _make(self):
        options = PETSc.Options(self._prefix)
        pc_type = options.getString("pc_type", "")
        if pc_type in _NEED_PARTS:
            raise ValueError(f"-pc_type {pc_type}: needs parts that options, or this matrix, cannot give")
        self.ksp = ksp = PETSc.KSP().create(self.operator.petsc_comm)
        ksp.setName(self.mat.getName())
        ksp.setOptionsPrefix(self._prefix or None)
        ksp.setOperators(self.mat)
        forced = {"ksp_view": None} | (_MULTIGRID if pc_type == "mg" else {})
        with temporary_options(self._prefix, {}, forced), callback_context():
            ksp.setFromOptions()
            if ksp.getNormType() == PETSc.KSP.NormType.NONE:
                ksp.setTolerances(rtol=0, atol=0)  # otherwise PETSc spends a product on a norm nobody reads
            ksp.setUp()
        counted = self.operator, *(self.operator.coarser_levels or ())
        self._counted = [(operator, self._hierarchy.share(operator)) for operator in counted]
        rtol, atol, _, max_it = ksp.getTolerances()
        for name, value, allowed in (("rtol", rtol, 0), ("atol", atol, 0), ("max_it", max_it, 1)):
            if not (math.isfinite(value) and value >= allowed):
                raise ValueError(f"-ksp_{name} {format_exact(value)}: allowed: from {allowed}")
        self._own_atol = options.hasName("ksp_atol")
        self._must_converge = ksp.getErrorIfNotConverged()
        ksp.setErrorIfNotConverged(False)  # an unconverged solve has a result, with this as its reason

    def set_contact(self):
        """Take over the contact set that is in the operator's mask now. Collective."""
        if self._interrupted:
            self._interrupted = False
            self.ksp.destroy()
            if self._work is not None:
                self._work.destroy()
                self._work = None
            self._make()
        self.operator.mask_changed()
        self.mat.stateIncrease()

    @property
    def work_units(self):
        """Work so far in the paper's count: products and sweeps by the KSP, one on the target grid being one.

        What the coarsest grid of a multigrid method costs, as an assembled matrix, is left out.
        """
        total = 0.0
        for operator, share in self._counted:
            total += share * (operator.products + operator.sweeps)
        return total

    def solve(self, b, allowed):
        """Solve C A C x = b from x = 0, as far as the options go.

        Collective.

        Parameters
        ----------
        b : Vec
        allowed : float
            Norm of the residual that is small enough [mm]; the absolute tolerance of Krylov methods that
            monitor the true residual, unless -ksp_atol is given.

        Returns
        -------
        x : Vec
            Overwritten by the next call.
        iterations : int
        failure : str
            Empty, or why the solver cannot go on. Running out of iterations is no failure: one cycle, or a
            few steps of CG, are what an active set iteration wants.
        """
        if self._work is None:
            self._work = self.mat.createVecRight()
        self.ksp.setInitialGuessNonzero(False)
        iterations, failure = self._run(b, self._work, allowed)
        return self._work, iterations, failure

    def _enough(self, allowed):
        """Norm of the residual that ends the KSP, by `allowed`; None if it may not be told."""
        its_own = self.ksp.getNormType() != PETSc.KSP.NormType.UNPRECONDITIONED  # not that of the system
        if self._own_atol or its_own or not math.isfinite(allowed):
            return None
        # A hair below: what passes here must pass the same test on the recomputed residual.
        return allowed * (1 - 1e-9)

    def _run(self, b, x, allowed):
        if (enough := self._enough(allowed)) is not None:
            self.ksp.setTolerances(atol=enough)
        try:
            with callback_context():
                self.ksp.solve(b, x)
        except BaseException:
            self._interrupted = True  # vectors stay locked: another KSP is made
            raise
        if self._view:
            self.ksp.viewFromOptions(self._view)
            self._view = ""
        reason = self.ksp.getConvergedReason()
        failed = reason < 0 and (self._must_converge or reason != PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)
        return self.ksp.getIterationNumber(), _REASONS.get(reason, str(reason)) if failed else ""

    def rest(self):
        """Free what only the next contact set needs, if that is much: others need memory now. Not collective."""

    def destroy(self):
        """Free the KSP and what belongs to it. Collective."""
        self.ksp.destroy()
        self.mat.destroy()
        if self._work is not None:
            self._work.destroy()
