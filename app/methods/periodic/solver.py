"""The periodic method's linear solver for displacement and pressure."""

from importlib import import_module

import numpy as np
from petsc4py import PETSc

from app.halfspace.operator import wrap_vec
from app.methods.multilevel_operators import multilevel_inverse
from app.methods.periodic.cg import CarryingCG
from app.methods.periodic.operator import InverseOperator
from app.methods.periodic.two_grid import TwoGrid
from app.multigrid.linear_solver import LinearSolver
from app.parallel.halo import Halo

GUESS_SWEEPS = 8  # projected sweeps that guess the first contact set of a grid
LONG_WAVE_LEVELS = 2  # levels down to the grid of the long waves in the preconditioner


class PrimalSolver(LinearSolver):
    """Linear solver for the displacement of free cells. Collective.

    The matrix is O B O, where O restricts to the free cells and B is the inverse of A. The KSP is CarryingCG, the PC is
    TwoGrid. The parameters are as in `LinearSolver`. Parts that never work at the same time share fields:

    ===========  ==================================  ===========================================  ==================
    field        in CG                               between contact sets                         verification
    ===========  ==================================  ===========================================  ==================
    `scratch`    z, and `change` in single           `PrimalState.guess`: force, lowest w         p before, then
                 precision                                                                        the certificate
    `direction`  d                                   `start`: change of w; `guess`: increment    -
    `product`    q = B d                             captured gaps: smoothing, then B change       -
    u of primal  `carried`, the updated p            the same                                     u = A p
    ===========  ==================================  ===========================================  ==================

    Attributes
    ----------
    inverse : InverseOperator
        B, with the free cells.
    preconditioner : TwoGrid
    guess_sweeps : int
        Number of sweeps in `PrimalState.guess`.
    guess_halo : Halo
        Halo for these sweeps.
    change, carried, uncertainty
        Change of w, updated p, and bound of the residual's error, see `CarryingCG`.

    Raises
    ------
    ValueError
        If the options choose another KSP or PC.
    """

    carried, _constrained, _multilevel_share = None, False, 0.0

    def __init__(self, hierarchy, level=-1, operator=None):
        _check_kinds(PETSc.Options(hierarchy.prefix))
        number = range(len(hierarchy.levels))[level]
        self.inverse = InverseOperator(
            operator or hierarchy.levels[number], coarser_operator(hierarchy, number)
        )
        super().__init__(hierarchy, number, self.inverse)
        self.guess_sweeps = GUESS_SWEEPS
        self.guess_halo = Halo(self.operator.slabs, self.operator.comm, self.guess_sweeps - 1)
        # Right-hand side and solution are not used, so their pages are never allocated. For the norm of a zero
        # right-hand side PETSc takes that of the first residual.
        self._untouched = [wrap_vec(np.zeros(self.operator.local_shape), self.operator) for _ in "bx"]

    def _make(self):
        super()._make()
        self._cg, self.preconditioner = self.ksp.getPythonContext(), self.ksp.getPC().getPythonContext()
        self.direction, self.product = self._cg.direction, self._cg.product
        self.change, self.scratch = self._cg.change, self._cg.scratch
        self._set()

    def begin(self, primal, multilevel_share=0.0):
        """Prepare this solver for a solve from the fields of `primal`.

        If the approach is prescribed, the solver does not change the mean of w = u - approach. Until the verification,
        or `end`, the array u of `primal` stores the updated pressure. Products are multilevel until the residual has
        fallen to the fraction `multilevel_share`; if it is 0, all are by FFT.
        """
        if multilevel_share and self.inverse.multilevel is None:
            multilevel_share = 0.0
        kind = self.inverse.dtype if multilevel_share else np.dtype(float)
        self.carried = primal.u.reshape(-1).view(kind)[: primal.u.size].reshape(primal.u.shape)
        self._constrained, self._multilevel_share = primal.keeps_mean, multilevel_share
        self._set()

    def _set(self):
        """Give KSP and PC their attributes, also after an interrupt has cleared them."""
        self.preconditioner.constrained = self._constrained
        self._cg.carried, self._cg.multilevel_share = self.carried, self._multilevel_share

    def end(self):
        """Return the updated pressure's storage to the state."""
        self.carried = self._cg.carried = None

    def improve(self, primal, allowed):
        """Reduce the pressure on the free cells by CG.

        The pressure must vanish on free cells. The results are `change`, the change of the displacement w, and
        `carried`, the updated p. CG stops when the norm of the preconditioned residual, which is about the error of w,
        is at most `allowed` [mm]. Return the number of iterations, a text why CG failed (empty if it did not), and this
        norm.
        """
        if self.preconditioner.constrained:
            primal.balance_free_cells(self)
        self.ksp.setInitialGuessNonzero(True)  # else PETSc sets the solution to zero
        self._cg.resumes, self._cg.pressure = primal.pending, primal.pressure
        iterations, failure = self._run(*self._untouched, allowed)
        self._cg.pressure = None  # not longer than the state
        primal.pending |= iterations > 0
        if self.preconditioner.constrained and self.preconditioner.multiplier:
            # p + mean pressure = 0 on the free cells, by the preconditioner
            primal.add_mean_pressure(-self.preconditioner.multiplier, self.carried)
        return iterations, failure, self._cg.residual

    @property
    def uncertainty(self):
        """Bound on the error of the norm that `improve` returns, due to inexact products [mm]."""
        return self._cg.uncertainty

    def _atol_for(self, allowed):
        return None if self._own_atol else allowed

    def destroy(self):
        """Free the KSP, matrix and vectors. Collective."""
        for vec in self._untouched:
            vec.destroy()
        super().destroy()


def prepare(hierarchy, multilevel, numbers=None):
    """Create the products with A and its inverse on the grids of given `numbers`, by default on all. Collective.

    If `multilevel` is true, also create the multilevel products.
    """
    if numbers is None:
        numbers = range(len(hierarchy.levels))
        hierarchy.target.prepare("exact_inverse")
    for number in numbers:
        operator, coarser = hierarchy.levels[number], coarser_operator(hierarchy, number)
        if operator.active:
            operator.prepare("inverse")
        if coarser is not None and coarser.active:
            coarser.prepare("screened_product")
        if multilevel and operator.active:
            multilevel_inverse(operator)


def _check_kinds(options):
    """Raise ValueError unless the options choose CarryingCG and TwoGrid."""
    for name, kind in (("ksp", CarryingCG), ("pc", TwoGrid)):
        module, _, cls = options.getString(f"{name}_python_type", "").rpartition(".")
        is_python = options.getString(f"{name}_type", "") == "python" and module
        if not (is_python and issubclass(getattr(import_module(module), cls), kind)):
            raise ValueError(
                f"-{name}_type: -lcp_type primal needs python with -{name}_python_type "
                f"{kind.__module__}.{kind.__name__}"
            )


def coarser_operator(hierarchy, number):
    """Return A on the coarser grid of a level's preconditioner.

    The result is None for the coarsest level.
    """
    return hierarchy.levels[max(number - LONG_WAVE_LEVELS, 0)] if number else None
