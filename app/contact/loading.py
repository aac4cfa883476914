"""Loadings: the base class, a prescribed approach and a prescribed mean gap.

The solvers call `first_solve` on the first grid, or `resume` from a solution. On each grid they call `begin`; in each
active set iteration `update`, between u = A p and the activation of cells; on the target, when (5.1) holds, `settle`;
after a grid `record`, and before the next one `predict`. Ranks that join receive `shared_state`. `solve_by_search` is
the fallback. The periodic method, whose unknown is the gap, calls `scale_pressure` and `set_depth` in place of `update`
and `settle`.

A new loading is a subclass of `Loading`, and a line of `app.contact.loading_input`, which makes it from a number.
"""

import numpy as np


class Loading:
    """Base of all loadings; its methods are those of a known approach.

    Attributes
    ----------
    kind : str
        As in `LOADINGS`.
    load : float or None
        Total force, if it is prescribed [N].
    approach_is_known : bool
        True if the loading alone determines the approach on every grid.
    allows_no_contact : bool
        True if bodies that do not touch can be the solution.
    shared_state : any
        Results of coarser grids, for the ranks that join on a finer one.
    """

    kind, load, approach_is_known, allows_no_contact, shared_state = "", None, True, True, None

    def depth_on(self, distance):
        """Return the depth for an `UndeformedDistance`, infinite if unknown [mm]."""
        return np.inf

    def mean_pressure_on(self, grid):
        """Return the mean pressure over the patch, infinite if unknown [N/mm2]."""
        return np.inf

    def largest_pressure(self, distance, grid, coefficient):
        """Estimate the highest pressure [N/mm2] from a coefficient [mm3/N]."""
        return max(self.depth_on(distance), 0.0) / coefficient

    def least_displacement(self, operator):
        """Return the displacement by the mean pressure [mm]."""
        return 0.0

    def misses_contact(self, distance):
        """Return whether no cell can carry pressure."""
        return False

    def solved_approach(self, state):
        """Return the approach, exactly as prescribed [mm]."""
        return state.approach

    def restore_prescribed(self, measures):
        """Return ContactMeasures with the prescribed number exactly."""
        return measures

    def first_solve(self, state, solve):
        """Solve on the first grid by ``solve(loading)``; return the Outcome. Collective."""
        raise NotImplementedError

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Solve by a root search if the load is prescribed. Collective.

        ``solve(loading, stop)`` solves at any approach and returns the Outcome. `tighter` is a factor on the tolerance
        of solves after which the pressure is scaled, `rtol` that of the search, and `step` the estimated error of the
        depth of `state` [mm].
        """
        return solve(self, stop)

    def resume(self, state, load):
        """Choose the first approach from a solution with a load [N]. Collective."""
        raise NotImplementedError

    def record(self, depth):
        """Record the final depth on a grid [mm]."""

    def predict(self, depth):
        """Predict the depth on the next finer grid [mm]."""
        return depth

    def begin(self, state):
        """Prepare the iteration on a grid. Collective."""

    def update(self, state):
        """Move the approach, given u = A p; return the step [mm]. Collective."""
        return 0.0

    def settle(self, state, update):
        """Meet the prescribed value exactly; return the new Update. Collective."""
        return update

    def scale_pressure(self, pressure, total, cell_area):
        """Scale a pressure with sum `total` to the load; return success."""
        return True

    def set_depth(self, state):
        """Set the depth of a periodic state. Collective."""
        state.depth = self.depth_on(state.distance)


class PrescribedApproach(Loading):
    """Prescribed approach [mm].

    Parameters
    ----------
    approach : float
        delta [mm].
    depth : float, optional
        The same beyond the reference, if known without the rounding of the approach [mm].
    """

    kind = "approach"

    def __init__(self, approach, depth=None):
        self.approach, self._depth = float(approach), depth

    def depth_on(self, distance):
        """See `Loading.depth_on`."""
        return self.approach - distance.reference if self._depth is None else self._depth

    def misses_contact(self, distance):
        """See `Loading.misses_contact`."""
        return self.depth_on(distance) <= distance.touching

    def solved_approach(self, state):
        """See `Loading.solved_approach`."""
        return self.approach

    def first_solve(self, state, solve):
        """See `Loading.first_solve`."""
        state.depth = self.depth_on(state.distance)
        state.start_from_interpenetration()
        return solve(self)

    def resume(self, state, load):
        """See `Loading.resume`."""
        state.depth = self.depth_on(state.distance)

    def begin(self, state):
        """See `Loading.begin`."""
        # The depth on the coarser grid may differ: at full contact, or under a mean gap.
        state.depth = self.depth_on(state.distance)


class PrescribedMeanGap(PrescribedApproach):
    """Prescribed mean gap: mean undeformed distance minus approach.

    The mean undeformed distance, and so the approach, depends on the grid.

    Parameters
    ----------
    distance : UndeformedDistance
        On the target grid.
    depth : float
        There [mm].
    mean_gap : float
        As given [mm].
    """

    kind = "mean_gap"

    def __init__(self, distance, depth, mean_gap):
        super().__init__(distance.approach_at(depth), depth)
        self._mean, self._mean_gap = distance.statistics.mean, max(mean_gap, 0.0)

    def restore_prescribed(self, measures):
        """See `Loading.restore_prescribed`."""
        return measures._replace(mean_gap=self._mean_gap)

    def depth_on(self, distance):
        """See `Loading.depth_on`."""
        return self._depth + (distance.statistics.mean - self._mean)
