"""A prescribed load, and the search for its approach.

The load F(delta) = dx dy sum(p) of the solved problem increases with the approach. Its slope is S = dx dy sum(q) with
``A q = 1`` on C. On the first grid a bracketing root search meets the load and gives a secant slope. After that every
active set iteration moves the approach by the missing load over the slope (Newton's method), as soon as the load error
exceeds what the residual can explain. `settle` makes the load exact. Where that does not converge, a root search over
solved problems does on any grid, because F is monotone.
"""

from itertools import pairwise
from math import isclose, sqrt

import numpy as np

from app.contact.history import Outcome
from app.contact.loading import Loading, PrescribedApproach
from app.contact.stopping import BELOW_ROUNDING

MIN_SECANT_STEP = 3.0  # rms residuals: least step of the approach that gives a secant slope
MAX_SLOPE_RATIO = 3.0  # factor by which the slope may change in one step
MAX_LEAST_STIFFNESS_RATIO = 3.0  # largest slope over the least stiffness there can be
MIN_MEAN_SLOPE_FRACTION = 0.9  # of the mean slope since first touch: least secant slope that is used
LOAD_ROUNDING = 1e-12  # relative difference of a load that has been met
LOAD_RESIDUAL_FRACTION = 0.25  # of the rms residual: error of the approach that the residual explains
_MAX_SECANTS = 2  # before scipy.optimize is imported, which takes as long as a small solve


class _SearchOver(Exception):
    """End of a root search, by success or a failed solve."""


class PrescribedLoad(Loading):
    """Prescribed total force.

    Parameters
    ----------
    load : float
        F, positive [N].
    mean_pressure : float
        The same over the area of the patch, for the results [N/mm2].
    """

    kind, approach_is_known, allows_no_contact = "load", False, False

    def __init__(self, load, mean_pressure=np.nan):
        self.load, self._mean_pressure = float(load), mean_pressure
        self.slope = 0.0  # S [N/mm]
        self._before = None  # depth [mm] and expected load [N] before the last move of the approach
        self._depths = []  # final depths of the grids solved so far [mm]

    def mean_pressure_on(self, grid):
        """See `Loading.mean_pressure_on`."""
        return self.load / (grid.n * grid.cell_area)

    def largest_pressure(self, distance, grid, coefficient):
        """See `Loading.largest_pressure`; that of a single cell with the whole load."""
        return self.load / grid.cell_area

    def least_displacement(self, operator):
        """See `Loading.least_displacement`."""
        return self.mean_pressure_on(operator.grid) * operator.diagonal

    def restore_prescribed(self, measures):
        """See `Loading.restore_prescribed`; a load that was missed stays."""
        if not isclose(measures.load, self.load, rel_tol=LOAD_ROUNDING):
            return measures
        in_contact = self.load / measures.contact_area if measures.contact_area else 0.0
        return measures._replace(
            load=self.load, mean_pressure=self._mean_pressure, mean_contact_pressure=in_contact
        )

    def first_solve(self, state, solve):
        """See `Loading.first_solve`; the approach is found by root search."""
        outcome = self.search(state, solve, rtol=0.02)
        return solve(self).after(outcome) if outcome.converged else outcome

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """See `Loading.solve_by_search`; the load is made exact and (5.1) is tested again."""
        tight = stop.tighter(tighter)  # after scaling, the stopping test must still hold
        outcome = self.search(state, lambda loading: solve(loading, tight), rtol, step)
        state.first_contact()  # a search for a tiny load may end without contact
        residual = self.settle(state, state.activate_penetrating()).residual
        outcome = outcome._replace(residual=residual / state.distance.norm())
        if not outcome.converged:
            return outcome
        if stop.final and residual > stop.allowed(state):
            return outcome._replace(converged=False, reason=BELOW_ROUNDING)
        return outcome

    def search(self, state, solve, rtol, step=None):
        """Search for the approach of the load by bracketing.

        Collective. Solves problems of prescribed approach. Converges for every problem that `solve` can solve, because
        the load is monotone in the approach.

        ``solve(loading)`` solves from the contact set and pressure of `state`. `rtol` is relative to the load, or to
        the depth beyond first touch. `step` is the estimated error of the depth [mm], None if that is arbitrary.
        Returns the Outcome of all solves, converged if all are.
        """
        touching = state.first_touch()
        loads = {touching: 0.0}  # by depth
        outcome = Outcome(True, "")

        def relative_error(depth):
            """Return the error of load^(2/3) at a depth, linear for a sphere."""
            nonlocal outcome
            if depth not in loads:
                state.depth = depth
                outcome = solve(PrescribedApproach(state.approach, state.depth)).after(outcome)
                if not (outcome.converged or outcome.to_rounding):
                    raise _SearchOver
                loads[depth] = state.load
                if abs(loads[depth] - self.load) <= rtol * self.load:
                    raise _SearchOver
            return (max(loads[depth], 0.0) / self.load) ** (2 / 3) - 1

        max_depth = state.distance.max_searched_depth
        try:
            if not step:
                low, high = touching, touching + 1.1 * self._estimate_depth(state, touching)
            else:
                low, high = max(touching, state.depth - step), max(touching, state.depth) + step
            least = 4 * np.spacing(max(abs(low), abs(high)))  # step above rounding
            high = min(max(high, low + least), max_depth)
            while (short := -relative_error(high)) > 0 and high < max_depth:
                # This step is enough if the load is proportional to the depth, or grows faster.
                growth = max(2 * short * (high - touching), least)
                low, high = high, min(high + growth, max_depth)
            while relative_error(low) > 0:
                low, high = max(touching, low - max(2 * (high - low), least)), low
            # A periodic patch may reach full contact before it carries the load; `high` is the end then.
            root = high
            if relative_error(high) >= 0:
                root = _root(relative_error, low, high, rtol * (high - touching))
            if state.depth != root:  # not the depth of the last solve
                loads.pop(root, None)
                relative_error(root)
        except _SearchOver:
            pass
        nearest = sorted(loads.items(), key=lambda point: abs(point[1] - self.load))[:2]
        (d1, f1), (d2, f2) = nearest[0], nearest[-1]  # the same point if the first solve failed
        self.slope = (f2 - f1) / (d2 - d1) if f2 != f1 else stiffness_of_patch(state)
        return outcome

    def _estimate_depth(self, state, touching):
        """Estimate the depth beyond first touch [mm], and start there.

        Collective. The overlap of the undeformed bodies carries the load as a flat punch of its area and mean depth:
        right for flat punches, 4% too little for a sphere.
        """
        stiffness = stiffness_of_patch(state)
        beyond = self.load / stiffness
        state.depth = touching
        state.start_from_interpenetration()
        for _ in range(3):
            state.depth = touching + beyond
            overlap = state.on_contact_or_overlap()
            carried = -overlap.mean * stiffness * sqrt(overlap.cells / state.grid.n)
            if not carried > 0:  # below the rounding of the depth
                break
            beyond *= (self.load / carried) ** (2 / 3)
        state.start_from_interpenetration()
        return beyond

    def resume(self, state, load):
        """See `Loading.resume`; the solution may be of another problem.

        The depth follows from the gap in contact. The load grows like that of a sphere, the 3/2 power of the depth
        beyond first touch; the power is 1 for a punch and 2 for a cone.
        """
        state.depth = touching = state.first_touch()
        beyond = state.on_contact().mean
        if load > 0 and beyond > 0:
            self.slope = 1.5 * load / beyond
            state.depth = touching + beyond * (self.load / load) ** (2 / 3)
        else:
            self.slope = stiffness_of_patch(state)

    def record(self, depth):
        """See `Loading.record`."""
        self._depths.append(depth)

    @property
    def shared_state(self):
        """Slope, and final depths of the grids."""
        return self.slope, self._depths

    @shared_state.setter
    def shared_state(self, shared_state):
        self.slope, self._depths = shared_state

    def predict(self, depth):
        """See `Loading.predict`; extrapolates the depths of the grids as a geometric series."""
        last = [finer - coarser for coarser, finer in pairwise(self._depths[-3:])]
        ratio = last[1] / last[0] if len(last) == 2 and last[0] else 0.0
        return depth + min(max(ratio, 0.0), 0.5) * last[-1] if last else depth

    def begin(self, state):
        """See `Loading.begin`."""
        self._before = None
        state.first_contact()

    def update(self, state):
        """See `Loading.update`; the step is the missing load over the slope.

        The mean gap in contact gives the load expected at this approach once the system is solved.
        """
        gaps = state.on_contact_or_overlap()
        if not gaps.cells:
            state.first_contact()
        depth, expected = state.depth, gaps.load - self.slope * gaps.mean
        self._learn_slope(state, expected, gaps.rms)
        step = (self.load - expected) / self.slope
        if abs(step) <= LOAD_RESIDUAL_FRACTION * gaps.rms:
            return 0.0
        # The slope grows without bound towards full contact. Before first touch there is no load.
        new_depth = min(depth + step, (depth + state.distance.max_searched_depth) / 2)
        least = state.distance.zero_load_depth
        state.depth = new_depth if new_depth >= least else (depth + least) / 2
        self._before = depth, expected
        return abs(state.depth - depth)

    def _learn_slope(self, state, expected, rms):
        """Compute dF/d(depth) from the last move. Collective.

        Moves below `MIN_SECANT_STEP` times the residual `rms` [mm] are not used. The slope grows with the depth, so it
        is at least the mean slope since first touch.
        """
        beyond = state.depth - state.distance.zero_load_depth
        mean_slope = expected / beyond if beyond > 0 else 0.0
        (before, then), self._before = self._before or (state.depth, 0.0), None
        moved = state.depth - before
        if abs(moved) > MIN_SECANT_STEP * rms:
            slope = (expected - then) / moved
            if slope >= MIN_MEAN_SLOPE_FRACTION * mean_slope:
                self.slope = min(max(slope, self.slope / MAX_SLOPE_RATIO), MAX_SLOPE_RATIO * self.slope)
        self.slope = max(self.slope, mean_slope)
        if least := least_stiffness(state):
            self.slope = min(max(self.slope, least), MAX_LEAST_STIFFNESS_RATIO * least)

    def settle(self, state, update):
        """See `Loading.settle`; the gap in contact gives the approach.

        The pressure is changed by a factor, on a periodic patch by a constant on C. Without pressure the load is
        distributed evenly over C.
        """
        load = state.load
        if load > 0:
            state.set_load(self.load, load)
        elif update.cells:  # a load so small that p = 0 counts as solved
            state.distribute_load(self.load)
        else:
            return update._replace(added=1)  # continue: there must be contact
        state.depth += state.on_contact_or_overlap().mean
        return state.activate_penetrating().after(update)

    def scale_pressure(self, pressure, total, cell_area):
        """See `Loading.scale_pressure`."""
        if total > 0:
            pressure *= self.load / (cell_area * total)
        return total > 0

    def set_depth(self, state):
        """See `Loading.set_depth`; the mean gap on C becomes zero."""
        state.depth = 0.0
        state.depth = state.on_contact().mean


def _root(function, low, high, xtol):
    """Return the zero of an increasing function."""
    for _ in range(_MAX_SECANTS):
        a, b = function(low), function(high)
        middle = low - a * (high - low) / (b - a)
        low, high = (low, middle) if function(middle) > 0 else (middle, high)
    from scipy.optimize import brentq

    return brentq(function, low, high, xtol=xtol)


def least_stiffness(state):
    """Return a lower bound of the stiffness of C [N/mm]. Collective.

    It is 0 on a free patch. Near full contact the stiffness grows without bound. With A q = 1 on C, 1.q >= (1.1)^2 /
    (1.A 1), sums over C.
    """
    if not state.grid.periodic:
        return 0.0
    energy, cells = state.operator.energy_of_contact()
    return state.grid.cell_area * cells**2 / energy if energy > 0 else 0.0


def stiffness_of_patch(state):
    """Return the stiffness of a punch as large as the patch [N/mm]."""
    return 2 / (np.pi * state.operator.compliance) * np.sqrt(state.grid.n * state.grid.cell_area / np.pi)
