"""The linear solver of the default method: a KSP that keeps u = A p while it improves p, and what that allows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.contact import kernels
from app.contact.state import Displacement
from app.fast.tracking_cg import TrackingCG, add
from app.multigrid.linear_solver import LinearSolver

LARGEST_KEPT = 256 * 256  # cells; what larger grids hold is no longer than it is needed


def is_large(grid):
    """Whether the memory of a grid or a window counts for more than what is made for it. Not collective."""
    return grid.n > LARGEST_KEPT


class Tension(NamedTuple):
    """The negative part of the pressure, which step 4.a will take away."""

    share: float  # of the sum of p
    some: bool  # whether there is any


class TrackingSolver(LinearSolver):
    """A `LinearSolver` whose KSP is TrackingCG; see there for the parameters.

    An iteration calls `improve`, perhaps `tension`, `release`, perhaps `predict`. From `tension` to a `release` that is
    given its result neither the pressure nor CG's direction may change. Nobody else is told of C before the next set.

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
                "-ksp_type: -lcp_type fast needs one that keeps the displacement: "
                "python with -ksp_python_type app.fast.tracking_cg.TrackingCG"
            )
        self._cg, self._large = context, is_large(self.operator.grid)

    def improve(self, state, allowed, norm):
        """Step 3, inexactly: p towards (2.11) on C, u = A p along with it.

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
            self.operator.forget_elsewhere()
        self.ksp.setInitialGuessNonzero(True)
        self._cg.displacement, self._cg.first_norm = state.u, norm
        iterations, failure = self._run(state.rhs, state.pressure, allowed)
        self._cg.displacement = None  # not for longer than the state
        if iterations:
            state.u_is = Displacement.CARRIED
        return iterations, failure, self._cg.residual

    def rest(self):
        """Free what only the next contact set needs, if that is much: others need memory now. Not collective."""
        if self._large:
            self._cg.rest()

    def tension(self, state):
        """Return the Tension; what releases it is left in CG's direction, for `release`. Collective."""
        change = self._cg.direction
        kernels.tension(state.p, state.contact, change)
        total, negative = state.sum([state.p.sum(), change.sum(dtype=np.float64)])
        return Tension(negative / total if total > 0 else float(negative), bool(negative))

    def release(self, state, tension=None):
        """Step 4.a, and one product for what it changes in u; return how many cells left C. Collective.

        `tension`: what `tension` has returned, if it was asked for.
        """
        change = self._cg.direction
        if tension is None:
            kernels.tension(state.p, state.contact, change)
        released = state.release_tensile(tension and tension.some)
        if released:
            state.operator.displacement(change, self._cg.product)
            add(state.u, 1.0, self._cg.product)
            state.u_is = Displacement.CARRIED
        return released

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
        expected = self._cg.work
        kernels.defect(state.distance.b, state.u, state.contact, expected)
        extend(expected)
        expected *= factor
        return expected
