"""What is prescribed: the base of all loadings, and a known approach.

Order of the calls: on the first grid `first_solve`, or `resume` from a solution; on each grid `begin`; in each active
set iteration `update`, between u = A p and (4.b); on the target, when (5.1) holds, `settle`; after a grid `record`, and
before the next one `predict`. Ranks that join receive `shared`. `solve_by_search` serves where this fails. The periodic
method, whose unknown is the gap, calls `scale_pressure` and `set_depth` in place of `update` and `settle`.

A new loading is a subclass of `Loading`, and a line of `app.contact.loading_input`, which makes it of a number.
"""

from __future__ import annotations

import numpy as np


class Loading:
    """What is prescribed; the base of all loadings, and what they do where they do nothing special.

    Attributes
    ----------
    kind : str
        As in `LOADINGS`.
    load : float or None
        Total force, if it is prescribed [N].
    approach_is_known : bool
        Whether the approach follows from the loading alone, on every grid. If not, it is found along the way.
    allows_no_contact : bool
        Whether bodies that do not touch may be the answer.
    shared : any
        What has been found out on coarser grids, for the ranks that join on a finer one.
    """

    kind, load, approach_is_known, allows_no_contact, shared = "", None, True, True, None

    def depth_on(self, distance):
        """Return the approach beyond the reference of an `UndeformedDistance`, if known, or infinity [mm]."""
        return np.inf

    def mean_pressure_on(self, grid):
        """Return the mean pressure over the patch, if it is prescribed, or infinity [N/mm2]."""
        return np.inf

    def largest_pressure(self, distance, grid, coefficient):
        """Return a pressure that none exceeds by much [N/mm2], from an influence coefficient [mm3/N]."""
        return max(self.depth_on(distance), 0.0) / coefficient

    def least_displacement(self, operator):
        """Return the displacement that the prescribed mean pressure causes in a cell, or 0 [mm]."""
        return 0.0

    def misses_contact(self, distance):
        """Return whether no cell can carry pressure."""
        return False

    def solved_approach(self, state):
        """Return the approach of a solution, exactly as prescribed [mm]."""
        return state.approach

    def restore_prescribed(self, measures):
        """Return ContactMeasures with the prescribed number as given, from which they differ by rounding."""
        return measures

    def first_solve(self, state, solve):
        """Solve on the first grid by ``solve(loading)``; return the Outcome. Collective."""
        raise NotImplementedError

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Solve by ``solve(loading, stop)``, a method that converges at any approach; return the Outcome. Collective.

        Parameters
        ----------
        state : ContactState
        solve : callable
        stop : StoppingTest
        tighter : float
            Factor on the tolerance of solves after which the pressure is scaled.
        rtol : float
            Of what is searched for.
        step : float, optional
            How far the depth of `state` may be from the right one [mm].
        """
        return solve(self, stop)

    def resume(self, state, load):
        """Choose the approach to begin with, where `state` is a solution with a load [N]. Collective."""
        raise NotImplementedError

    def record(self, depth):
        """Note the depth that a grid has ended with [mm]."""

    def predict(self, depth):
        """Return the depth to begin with on the next finer grid, after `depth` on this one [mm]."""
        return depth

    def begin(self, state):
        """Prepare the iteration on a grid. Collective."""

    def update(self, state):
        """Move the approach after u = A p; return by how much [mm]. Collective."""
        return 0.0

    def settle(self, state, update):
        """Meet the prescribed value exactly, after `update`; return the Update since then. Collective."""
        return update

    def scale_pressure(self, pressure, total, cell_area):
        """Give a pressure >= 0 of the given sum the prescribed load; return whether that is possible."""
        return True

    def set_depth(self, state):
        """Set the depth of a periodic state whose displacement is A p. Collective."""
        state.depth = self.depth_on(state.distance)


class PrescribedApproach(Loading):
    """The approach is given [mm].

    Parameters
    ----------
    approach : float
        delta [mm].
    depth : float, optional
        The same beyond the reference, if it is known without the rounding of the approach [mm].
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
        """See `Loading.first_solve`: from C = {h <= 0}, step 1."""
        state.depth = self.depth_on(state.distance)
        state.start_from_interpenetration()
        return solve(self)

    def resume(self, state, load):
        """See `Loading.resume`."""
        state.depth = self.depth_on(state.distance)

    def begin(self, state):
        """See `Loading.begin`: the grid before may have had full contact, or no holes."""
        state.depth = self.depth_on(state.distance)


class PrescribedMeanGap(PrescribedApproach):
    """The mean gap is given: the mean undeformed distance, another one on every grid, less the approach.

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
