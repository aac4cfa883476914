"""Linear solver that updates the displacement u = A p with p."""

from math import sqrt

from petsc4py import PETSc

from app.contact import loops
from app.contact.state import Displacement
from app.halfspace.operator import apply_logged
from app.methods.free.residual_trend import ResidualTrend
from app.methods.free.tracking_cg import TrackingCG, add
from app.methods.multilevel_operators import multilevel_influence
from app.multigrid.linear_solver import LinearSolver
from app.multigrid.solver_cache import is_large

_event = PETSc.Log.Event("InfluenceByLevels")


class TrackingSolver(LinearSolver):
    """Linear solver whose KSP is TrackingCG. Collective.

    `improve` changes the pressure p. Then the caller updates the displacement u by `release` or `update_displacement`,
    or recomputes u. The parameters are as in `LinearSolver`.

    Attributes
    ----------
    multilevel : bool
        True if changes of u are computed by multilevel products, otherwise by FFT. May be set to False.

    Raises
    ------
    ValueError
        If the options choose a KSP other than TrackingCG.
    """

    def _make(self):
        super()._make()
        context = self.ksp.getPythonContext() if self.ksp.getType() == "python" else None
        if not isinstance(context, TrackingCG):
            self.destroy()
            raise ValueError(
                "-ksp_type: -lcp_type fast needs one that starts from a known displacement: "
                "python with -ksp_python_type app.methods.free.tracking_cg.TrackingCG"
            )
        contrast = self.operator.kernel.contrast(self.operator.grid)
        self.ksp.setTolerances(rtol=self.ksp.getTolerances()[0] / sqrt(contrast))
        self._cg, self._large, self._change_not_in_u = context, is_large(self.operator.grid), False

    def begin(self, multilevel):
        """Choose multilevel or FFT products for the next solve.

        If `multilevel` is true, multilevel products are used on grids that are large enough.
        """
        self.multilevel = multilevel and multilevel_influence(self.operator) is not None
        self._change_not_in_u = False

    def improve(self, state, allowed, norm):
        """Reduce the residual of the contact set's system (2.11) by CG.

        This is step 3 of Sec. 4.1. The residual is the gap h + A p of contact cells. Only p is changed; `release` or
        `update_displacement` then updates u.

        Parameters
        ----------
        state : ContactState
            Its pressure p is changed.
        allowed : float
            Norm of the residual at which CG stops [mm].
        norm : float
            Present norm of the residual [mm].

        Returns
        -------
        iterations : int
        failure : str
            Why CG failed; empty if it did not. See `LinearSolver.solve`.
        residual : float
            Norm of the residual [mm].
        """
        atol = self._atol_for(allowed)
        if atol is not None and norm <= atol:
            return 0, "", norm
        if self._large:
            self.operator.invalidate_exact_product()
        self.ksp.setInitialGuessNonzero(True)
        cg = self._cg
        cg.displacement, cg.shift, cg.first_norm, cg.multiply = (
            state.u,
            state.depth,
            norm,
            self._multiply_in_contact,
        )
        iterations, failure = self._run(state.distance.rhs, state.pressure, allowed)
        cg.displacement, cg.shift = None, 0.0  # not longer than the state
        if iterations:
            self._change_not_in_u, state.displacement_status = True, Displacement.STALE
        return iterations, failure, self._cg.residual

    def _multiply(self, p, u):
        """Compute u = A p, exactly or by a multilevel product."""
        if not self.multilevel:
            return self.operator.displacement(p, u)
        apply_logged(_event, multilevel_influence(self.operator), p, u)
        self.operator.add_springs(p, u)

    _multiply_in_contact = _multiply  # to solve the system; elsewhere u is not needed

    def free_work(self):
        """Free work arrays; afterwards u must be recomputed."""
        self._change_not_in_u = False
        if self._large:
            self._cg.free_work()

    def check_multilevel(self, state, most):
        """Switch to FFT products if multilevel products were inaccurate.

        The products' error was too large if the residual, which was just recomputed by FFT, exceeds `most` [mm].
        """
        if self.multilevel:
            self.multilevel = state.on_contact().residual <= most

    def release(self, state, tension=None, update=True):
        """Release tensile cells from the contact set; update u.

        This is step 4.a of Sec. 4.1. Return a true value if cells were released. `tension` is the result of
        `ContactState.tension`, if known. If `update` is false, u is not updated, because the caller recomputes it.
        """
        change = self._cg.change
        if not self._change_not_in_u:
            change[...] = 0
        released = state.release_tensile(None if tension is None else tension > 0, change)
        self._change_not_in_u = update and (self._change_not_in_u or released > 0)
        self.update_displacement(state)
        return released

    def update_displacement(self, state):
        """Update u by the last change of p, unless already done.

        A times this change is added to u, by a multilevel product or by FFT.
        """
        if self._change_not_in_u:
            self._multiply(self._cg.change, self._cg.product)
            add(state.u, 1.0, self._cg.product)
            self._change_not_in_u, state.displacement_status = False, Displacement.UPDATED

    def predict(self, state, factor):
        """Predict the displacement outside contact once the system is solved [mm].

        The preconditioner's method ``extend`` continues the residual of the last solve past the contact edge. If there
        are plastic cells, the trend of the residual displaces cells far from C, too. The result is the trend plus
        `factor` times the rest of the predicted change of u, in a work array. It is None if `factor` is 0 or the
        preconditioner has no ``extend``.
        """
        pc = self.ksp.getPC()
        extend = getattr(pc.getPythonContext(), "extend", None) if pc.getType() == "python" else None
        if not factor or extend is None:
            return None
        expected, trend = self._cg.product, None
        loops.defect(state.distance.b, state.depth, state.u, state.contact, factor, expected)
        if state.plastic_cells():
            trend = ResidualTrend(expected, state.contact, state.operator.slabs, state.comm)
            trend.add(-1.0, state.contact, expected)
        extend(expected)
        if trend is not None:
            trend.add(1 / factor, state.admissible, expected)
        return expected
