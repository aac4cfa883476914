"""The linear solver of the default method: a KSP that starts from a known u = A p, and u carried along with p."""

from __future__ import annotations

from petsc4py import PETSc

from app.contact import kernels
from app.contact.state import Displacement
from app.halfspace.operator import apply_logged
from app.methods.free.tracking_cg import TrackingCG, add
from app.methods.multilevel_operators import multilevel_influence
from app.multigrid.linear_solver import LinearSolver
from app.multigrid.solver_cache import is_large

_event = PETSc.Log.Event("InfluenceByLevels")


class TrackingSolver(LinearSolver):
    """A `LinearSolver` whose KSP is TrackingCG; see there for the parameters.

    An iteration calls `improve`; then `release`, or `carry`, or it computes u anew. After a
    `release` it may `predict`. Nobody else is told of C before the next set.

    Attributes
    ----------
    by_levels : bool
        Changes of u are computed by levels (`app.methods.multilevel_operators`). May be set to False.

    Raises
    ------
    ValueError
        If the KSP is another one.
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
        self._cg, self._large, self._change_not_in_u = context, is_large(self.operator.grid), False

    def begin(self, by_levels):
        """Begin to solve on the grid, with changes of u by levels if it has such. Collective."""
        self.by_levels, self._change_not_in_u = (
            by_levels and multilevel_influence(self.operator) is not None,
            False,
        )

    def improve(self, state, allowed, norm):
        """Step 3, inexactly: p towards (2.11) on C. What that does to u is left to `release` or `carry`.

        Collective.

        Parameters
        ----------
        state : ContactState
        allowed : float
            Norm of the residual that is small enough [mm].
        norm : float
            That of the residual now [mm].

        Returns
        -------
        iterations : int
        failure : str
            As of `LinearSolver.solve`.
        residual : float
            Its norm [mm].
        """
        enough = self._enough(allowed)
        if enough is not None and norm <= enough:
            return 0, "", norm
        if self._large:
            self.operator.forget_exact_support()
        self.ksp.setInitialGuessNonzero(True)
        cg = self._cg
        cg.displacement, cg.shift, cg.first_norm, cg.multiply = state.u, state.depth, norm, self._multiply
        iterations, failure = self._run(state.distance.rhs, state.pressure, allowed)
        cg.displacement, cg.shift = None, 0.0  # not for longer than the state
        if iterations:
            self._change_not_in_u, state.displacement_status = True, Displacement.STALE
        return iterations, failure, self._cg.residual

    def _multiply(self, p, u):
        """Compute u = A p, by levels if that will do."""
        if not self.by_levels:
            return self.operator.displacement(p, u)
        apply_logged(_event, multilevel_influence(self.operator), p, u)

    def rest(self):
        """See `LinearSolver.rest`. Who calls it computes u anew."""
        self._change_not_in_u = False
        if self._large:
            self._cg.rest()

    def check_levels(self, state, most):
        """Multiply by FFT from here on if levels have left more than `most` on C [mm], as u, computed anew, tells.

        Collective.
        """
        if self.by_levels:
            self.by_levels = state.on_contact().residual <= most

    def release(self, state, tension=None, carry=True):
        """Step 4.a, and u along with it; return whether cells left C. Collective.

        `tension`: that of the state, if it is known. `carry`: unless u is to be computed anew.
        """
        change = self._cg.change
        if not self._change_not_in_u:
            change[...] = 0
        released = state.release_tensile(None if tension is None else tension > 0, change)
        self._change_not_in_u = carry and (self._change_not_in_u or released > 0)
        self.carry(state)
        return released

    def carry(self, state):
        """Add to u what the last `improve` has changed in it, unless that is done. Collective."""
        if self._change_not_in_u:
            self._multiply(self._cg.change, self._cg.product)
            add(state.u, 1.0, self._cg.product)
            self._change_not_in_u, state.displacement_status = False, Displacement.UPDATED

    def predict(self, state, factor):
        """Predict what the reduction of the residual will add to u beside C.

        Collective. The preconditioner knows, if it has a method ``extend(r)`` that continues a residual over the rim:
        that of the set just solved for, so that cells which it has released are not expected back.

        Parameters
        ----------
        factor : float
            Factor on it.

        Returns
        -------
        ndarray, shape (local rows, nx), [mm], or None
            In the solver's work array.
        """
        if not factor:
            return None
        pc = self.ksp.getPC()
        extend = getattr(pc.getPythonContext(), "extend", None) if pc.getType() == "python" else None
        if extend is None:
            return None
        expected = self._cg.product
        kernels.defect(state.distance.b, state.depth, state.u, state.contact, factor, expected)
        extend(expected)
        return expected
