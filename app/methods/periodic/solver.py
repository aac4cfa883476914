"""The linear solver of the primal form: CarryingCG on the free cells, that carries p = B w along."""

from __future__ import annotations

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
LONG_WAVE_LEVELS = 2  # grids between one and that of the long waves in its preconditioner


class PrimalSolver(LinearSolver):
    """A `LinearSolver` of O B O whose KSP is CarryingCG with the `TwoGrid` preconditioner.

    Fields are scarce, so who works in turn shares them:

    ===========  ==================================  ===========================================  ==================
    field        in CG                               between contact sets                         verification
    ===========  ==================================  ===========================================  ==================
    `scratch`    z, and `change` in single           `PrimalState.guess`: force, lowest w         p found, then the
                 precision                                                                        certificate's
    `direction`  d                                   `start`: change of w; `guess`: increment    -
    `product`    q = B d                             captured gaps: smoothing, then B change       -
    u of state   `carried`, what p becomes           the same                                     u = A p
    ===========  ==================================  ===========================================  ==================

    Attributes
    ----------
    inverse : InverseOperator
    preconditioner : TwoGrid
    guesses : int
        Sweeps of a guess.
    rows_beside : Halo
        As wide as the sweeps of a guess need.
    change, carried, doubt
        See `CarryingCG`.

    Raises
    ------
    ValueError
        If the KSP or the PC is another one.
    """

    carried, _constrained, _multilevel_share = None, False, 0.0

    def __init__(self, hierarchy, level=-1, operator=None):
        _check_kinds(PETSc.Options(hierarchy.prefix))
        number = range(len(hierarchy.levels))[level]
        self.inverse = InverseOperator(
            operator or hierarchy.levels[number], coarser_operator(hierarchy, number)
        )
        super().__init__(hierarchy, number, self.inverse)
        self.guesses = GUESS_SWEEPS
        self.rows_beside = Halo(self.operator.slabs, self.operator.comm, self.guesses - 1)
        # A right-hand side and a solution that are not touched: they cost no memory. PETSc may ask for the norm of the
        # first, and for that of zero takes the first residual's.
        self._untouched = [wrap_vec(np.zeros(self.operator.local_shape), self.operator) for _ in "bx"]

    def _make(self):
        super()._make()
        self._cg, self.preconditioner = self.ksp.getPythonContext(), self.ksp.getPC().getPythonContext()
        # Two fields in the operator's precision are at rest between solves, and one in double while w and p do not lag:
        # `change` may be in it.
        self.direction, self.product = self._cg.direction, self._cg.product
        self.change, self.scratch = self._cg.change, self._cg.scratch
        self._set()

    def begin(self, state, loading, multilevel_share=0.0):
        """Begin to solve on the grid for a loading: an approach is kept by keeping the mean of w.

        Collective. Until the verification, and `end`, u of the ContactState is the place of `carried`. For
        `multilevel_share` see `CarryingCG`; without levels there are products by FFT.
        """
        if multilevel_share and self.inverse.nearly is None:
            multilevel_share = 0.0
        kind = self.inverse.dtype if multilevel_share else np.dtype(float)
        self.carried = state.u.reshape(-1).view(kind)[: state.u.size].reshape(state.u.shape)
        self._constrained, self._multilevel_share = loading.approach_is_known, multilevel_share
        self._set()

    def _set(self):
        """Tell the parts, which after an interrupted solve are new ones."""
        self.preconditioner.constrained = self._constrained
        self._cg.carried, self._cg.multilevel_share = self.carried, self._multilevel_share

    def end(self):
        """Let go of the place of `carried`, which is the solution's. Not collective."""
        self.carried = self._cg.carried = None

    def improve(self, primal, allowed):
        """Let p vanish on the free cells, a little: find what w and p = B w are to become, `change` and `carried`.

        Collective.

        Parameters
        ----------
        primal : PrimalState
        allowed : float
            Norm of the preconditioned residual that is small enough [mm].

        Returns
        -------
        iterations : int
        failure : str
            As of `LinearSolver.solve`.
        residual : float
            Its norm: about by how much w is wrong [mm].
        """
        if self.preconditioner.constrained:
            primal.balance_free_cells(self)
        self.ksp.setInitialGuessNonzero(True)  # PETSc would touch the solution, to make it zero
        self._cg.goes_on, self._cg.pressure = primal.lags, primal.state.pressure
        iterations, failure = self._run(*self._untouched, allowed)
        self._cg.pressure = None  # not for longer than the state
        primal.lags |= iterations > 0
        if self.preconditioner.constrained and self.preconditioner.multiplier:
            # p + mean pressure = 0 on the free cells, as far as M can tell.
            primal.add_mean_pressure(-self.preconditioner.multiplier, self.carried)
        return iterations, failure, self._cg.residual

    @property
    def doubt(self):
        """By how much the residual of `improve` may be wrong [mm]. Not collective."""
        return self._cg.doubt

    def _enough(self, allowed):
        return None if self._own_atol else allowed

    def destroy(self):
        """See `LinearSolver.destroy`."""
        for vec in self._untouched:
            vec.destroy()
        super().destroy()


def prepare(hierarchy, by_levels):
    """Make the products of all grids, which solvers share, before the first of these. Collective.

    `by_levels`: whether there are to be those, too.
    """
    hierarchy.target.prepare("exact_inverse")
    for number, operator in enumerate(hierarchy.levels):
        coarser = coarser_operator(hierarchy, number)
        if operator.active:
            operator.prepare("inverse")
        if coarser is not None and coarser.active:
            coarser.prepare("screened_product")
        if by_levels and operator.active:
            multilevel_inverse(operator)


def _check_kinds(options):
    """Refuse other solvers before PETSc sets them up on an operator that they do not know. Not collective."""
    for name, kind in (("ksp", CarryingCG), ("pc", TwoGrid)):
        module, _, of_module = options.getString(f"{name}_python_type", "").rpartition(".")
        chosen = options.getString(f"{name}_type", "") == "python" and module
        if not (chosen and issubclass(getattr(import_module(module), of_module), kind)):
            raise ValueError(
                f"-{name}_type: -lcp_type primal needs python with -{name}_python_type "
                f"{kind.__module__}.{kind.__name__}"
            )


def coarser_operator(hierarchy, number):
    """A on the grid of the long waves; None if there is none. Not collective."""
    return hierarchy.levels[max(number - LONG_WAVE_LEVELS, 0)] if number else None
