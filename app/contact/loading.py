"""Loadings: the base class, a prescribed approach and a prescribed mean gap.

A loading is a prescribed quantity. The solvers call these methods of a loading:

- `first_solve` solves on the first grid; if an earlier solution is given instead, `resume` chooses the approach;
- `begin` prepares the iteration on a grid;
- `update` moves the approach in each active set iteration, after u = A p and before cells enter C;
- `settle` meets the prescribed number exactly, on the target grid, when the stopping test (5.1) holds;
- `record` stores the depth found on a grid, and `predict` extrapolates it to the next grid.

Ranks that join on the next grid receive `shared_state`. If the iteration fails, `solve_by_search` is called. The
periodic method, whose unknown is the gap, calls `scale_pressure` and `set_depth` instead of `update` and `settle`.

A new loading is a subclass of `Loading`, and a line of `app.contact.loading_input`, which makes it from a number.
"""

from math import ulp

import numpy as np


class Loading:
    """Base class of loadings; methods suit a prescribed approach.

    Attributes
    ----------
    kind : str
        Name of the prescribed number in `LOADINGS`.
    load : float or None
        Prescribed total force [N]; None if another number is prescribed.
    approach_is_known : bool
        True if the loading alone determines the approach on every grid.
    allows_no_contact : bool
        True if bodies that do not touch can be the solution.
    shared_state : any
        Results of coarser grids, for the ranks that join on a finer one.
    """

    kind, load, approach_is_known, allows_no_contact, shared_state = "", None, True, True, None

    def depth_on(self, distance):
        """Return the prescribed depth, given a grid's `distance` [mm]; infinite if unknown."""
        return np.inf

    def mean_pressure_on(self, grid):
        """Return the whole patch's prescribed mean pressure [N/mm2]; infinite if unknown."""
        return np.inf

    def largest_pressure(self, distance, grid, coefficient):
        """Estimate the highest pressure, given the largest influence coefficient [mm3/N]."""
        return max(self.depth_on(distance), 0.0) / coefficient

    def least_displacement(self, operator):
        """Return a cell's displacement by the mean pressure [mm]; 0 if unknown."""
        return 0.0

    def misses_contact(self, distance):
        """Return whether the bodies do not touch, or touch without pressure."""
        return False

    def solved_approach(self, state):
        """Return a solution's approach [mm]; if prescribed, without rounding."""
        return state.approach

    def restore_prescribed(self, measures):
        """Return `measures` without rounding errors in the prescribed number."""
        return measures

    def first_solve(self, state, solve):
        """Solve on the first grid by ``solve(loading)``; return the Outcome. Collective."""
        raise NotImplementedError

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Solve by a root search if the load is prescribed. Collective.

        The function ``solve(loading, stop)`` solves at a prescribed approach and returns the Outcome. `tighter` is a
        factor on the tolerance of these solves. `rtol` is the tolerance of the search, `step` the estimated error of
        the depth of `state` [mm].
        """
        return solve(self, stop)

    def resume(self, state, load):
        """Choose the approach to continue from `state`, with its `load` [N]. Collective."""
        raise NotImplementedError

    def record(self, depth):
        """Record the final depth on a grid, counted from the reference [mm]."""

    def predict(self, depth):
        """Predict the next finer grid's depth from this grid's depth [mm]."""
        return depth

    def begin(self, state):
        """Prepare the iteration on a grid. Collective."""

    def update(self, state):
        """Change the approach, given u = A p; return the change [mm]. Collective."""
        return 0.0

    def meet(self, state):
        """Add the missing load to p, before `settle`. Collective."""

    def settle(self, state, update):
        """Meet the prescribed number exactly; return the `Update`. Collective."""
        return update

    def scale_pressure(self, pressure, total, cell_area):
        """Scale a pressure with the sum `total` to the load; return success."""
        return True

    def set_depth(self, state):
        """Set the depth of a periodic state as this loading demands. Collective."""
        state.depth = self.depth_on(state.distance)


class PrescribedApproach(Loading):
    """Prescribed approach [mm].

    Parameters
    ----------
    approach : float
        Approach delta [mm].
    depth : float, optional
        Approach beyond the reference [mm]. Give it if it is known without the rounding of `approach`.
    """

    kind = "approach"

    def __init__(self, approach, depth=None):
        self.approach, self._depth = float(approach), depth

    def depth_on(self, distance):
        """Return the depth of the prescribed approach; see `Loading.depth_on`."""
        return self.approach - distance.reference if self._depth is None else self._depth

    def misses_contact(self, distance):
        """Return whether the approach is at most first touch; see `Loading.misses_contact`."""
        return self.depth_on(distance) <= distance.touching

    def solved_approach(self, state):
        """Return the prescribed approach; see `Loading.solved_approach`."""
        return self.approach

    def first_solve(self, state, solve):
        """Solve from contact in all cells with h <= 0; see `Loading`."""
        state.depth = self.depth_on(state.distance)
        state.start_from_interpenetration()
        return solve(self)

    def resume(self, state, load):
        """Set the prescribed depth; see `Loading.resume`."""
        state.depth = self.depth_on(state.distance)

    def begin(self, state):
        """Set the prescribed depth on this grid; see `Loading.begin`."""
        # The depth on the coarser grid may differ: at full contact, or under a mean gap.
        state.depth = self.depth_on(state.distance)


class PrescribedMeanGap(PrescribedApproach):
    """Prescribed mean gap: mean undeformed distance minus approach.

    The mean undeformed distance depends on the grid, and so does the approach.

    Parameters
    ----------
    distance : UndeformedDistance
        Undeformed distance on the target grid.
    depth : float
        Depth on the target grid [mm].
    mean_gap : float
        Mean gap as the user gave it [mm]; negative only with a hardness.
    """

    kind = "mean_gap"

    def __init__(self, distance, depth, mean_gap):
        super().__init__(distance.approach_at(depth), depth)
        self._mean, self._mean_gap = distance.statistics.mean, max(mean_gap, 0.0)

    def restore_prescribed(self, measures):
        """Restore the mean gap, at least 0; see `Loading.restore_prescribed`.

        The prescribed number is the mean of the gap e. The mean of max(e, 0) is larger if plastic cells overlap.
        """
        return measures if measures.mean_plastic_depth else measures._replace(mean_gap=self._mean_gap)

    def depth_on(self, distance):
        """Return the depth for the mean gap; see `Loading.depth_on`."""
        return self._depth + (distance.statistics.mean - self._mean)

    def begin(self, state):
        """Set the depth on this grid; see `Loading.begin`."""
        self.set_depth(state)

    def set_depth(self, state):
        """Set the depth, whose rounding error is an error of the mean gap; see `Loading.set_depth`."""
        super().set_depth(state)
        state.neglected_gap = ulp(state.depth)
