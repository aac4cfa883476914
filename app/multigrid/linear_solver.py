"""Linear solver of contact systems (2.11), by PETSc's options.

All of PETSc's solvers that need only products with the matrix and its diagonal can be chosen:
``-ksp_type cg -pc_type none`` (the method NORM of the paper), ``-pc_type jacobi``,
``-pc_type python -pc_python_type ...``. ``-pc_type mg`` is the multigrid method of `pcmg`.
"""

import math

from petsc4py import PETSc

from app.base.errors import format_exact
from app.base.petsc import calling_petsc
from app.options.solver_options import temporary_options


def reason_names(reasons):
    """Return a dict from values to names of `reasons`, such as ``PETSc.KSP.ConvergedReason``."""
    return {value: name for name, value in vars(reasons).items() if isinstance(value, int)}


_REASONS = reason_names(PETSc.KSP.ConvergedReason)
_MULTIGRID = {"pc_type": "python", "pc_python_type": "app.multigrid.ContactMG"}  # replace -pc_type mg
# PCs that need the triangles of a matrix, or parts that cannot be set by options
_NEED_PARTS = ("shell", "composite", "galerkin", "fieldsplit", "ksp", "mat", "eisenstat")


class LinearSolver:
    """KSP for C A C x = b.

    C is the contact set, the mask of the operator. Collective over the ranks of the grid. The options are read from
    PETSc's database when the solver is created.

    Parameters
    ----------
    hierarchy : Hierarchy
    level : int
        Number of the level; by default the target.
    operator : InfluenceOperator, optional
        Operator of a window (part of the grid) of this level; by default the operator of the whole grid.

    Raises
    ------
    ValueError, PETSc.Error
        If an option is invalid or cannot be used.
    """

    _forced = {}  # noqa: RUF012  # options that replace the user's

    def __init__(self, hierarchy, level=-1, operator=None):
        self.level = range(len(hierarchy.levels))[level]
        self.operator = operator or hierarchy.levels[self.level]
        self._work, self._interrupted = None, False
        self.mat = self.operator.mat(self.operator.petsc_comm)
        self._prefix = hierarchy.prefix
        self.mat.setOptionsPrefix(self._prefix or None)
        # PETSc would view the solver of every grid after every solve. We view that of the target once.
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
        forced = {"ksp_view": None} | (_MULTIGRID if pc_type == "mg" else {}) | self._forced
        with temporary_options(self._prefix, {}, forced), calling_petsc():
            ksp.setFromOptions()
            if ksp.getNormType() == PETSc.KSP.NormType.NONE:
                ksp.setTolerances(rtol=0, atol=0)  # else PETSc computes a norm, by a product
            ksp.setUp()
        counted = self.operator, *(self.operator.coarser_levels or ())
        self._counted = [(operator, self._hierarchy.share(operator)) for operator in counted]
        rtol, atol, _, max_it = ksp.getTolerances()
        for name, value, least in (("rtol", rtol, 0), ("atol", atol, 0), ("max_it", max_it, 1)):
            if not (math.isfinite(value) and value >= least):
                raise ValueError(f"-ksp_{name} {format_exact(value)}: must be at least {least}")
        self._own_atol = options.hasName("ksp_atol")
        self._must_converge = ksp.getErrorIfNotConverged()
        ksp.setErrorIfNotConverged(False)  # the outcome has the reason

    def set_contact(self):
        """Use the contact set in the operator's mask from now on. Collective."""
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
        """Work of the KSP, in the paper's work units.

        A unit is a product or sweep on the target grid. All products and sweeps of the KSP count, except those with the
        assembled matrix of the coarsest grid.
        """
        total = 0.0
        for operator, share in self._counted:
            total += share * (operator.products + operator.sweeps)
        return total

    def solve(self, b, allowed):
        """Solve C A C x = b on contact, starting from zero. Collective.

        Parameters
        ----------
        b : Vec
            Right-hand side [mm], zero outside C.
        allowed : float
            Norm of the residual at which the solve may end [mm]. It replaces the absolute tolerance if the Krylov
            method monitors the true residual and the user has not set -ksp_atol. Otherwise it has no effect.

        Returns
        -------
        x : Vec
            Solution, overwritten by the next call.
        iterations : int
        failure : str
            Why the solver failed; empty if it did not. It is no failure if the limit of iterations is reached.
        """
        if self._work is None:
            self._work = self.mat.createVecRight()
        self.ksp.setInitialGuessNonzero(False)
        iterations, failure = self._run(b, self._work, allowed)
        return self._work, iterations, failure

    def _atol_for(self, allowed):
        """Return the KSP's absolute tolerance, or None to leave it unchanged."""
        other_norm = self.ksp.getNormType() != PETSc.KSP.NormType.UNPRECONDITIONED
        if self._own_atol or other_norm or not math.isfinite(allowed):
            return None
        # Slightly less, because the recomputed residual must pass the same test.
        return allowed * (1 - 1e-9)

    def _run(self, b, x, allowed):
        if (atol := self._atol_for(allowed)) is not None:
            self.ksp.setTolerances(atol=atol)
        try:
            with calling_petsc():
                self.ksp.solve(b, x)
                if self._view:
                    self.ksp.viewFromOptions(self._view)
                    self._view = ""
        except BaseException:
            self._interrupted = True  # vectors stay locked: the next set_contact makes a new KSP
            raise
        reason = self.ksp.getConvergedReason()
        failed = reason < 0 and (self._must_converge or reason != PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)
        text = _REASONS.get(reason, str(reason))
        if reason == PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC:
            text += (
                f": -pc_type {self.ksp.getPC().getType()} is not symmetric positive definite, as -ksp_type "
            )
            text += f"{self.ksp.getType()} needs; choose another one, or -ksp_type gmres"
        return self.ksp.getIterationNumber(), text if failed else ""

    def free_work(self):
        """Do nothing; subclasses free large work arrays here."""

    def destroy(self):
        """Free the KSP, matrix and vectors. Collective."""
        self.ksp.destroy()
        self.mat.destroy()
        if self._work is not None:
            self._work.destroy()
