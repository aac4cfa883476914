"""Root search for the approach at which a solution has a prescribed number.

The number, such as the load or the contact area, must not decrease with the approach. So a bracketing root search of
solutions with prescribed approaches converges for every problem that can be solved.
"""

from itertools import pairwise

import numpy as np

from app.base.errors import InputError
from app.contact.loading import Loading, PrescribedApproach

_MAX_SECANTS = 2  # number of secants before scipy.optimize is imported, which takes as long as a small solve
_RTOL = 1e-6  # tolerance of the search, over the number or the depth beyond first touch
_GRID_STEP = 0.05  # first bracket on a finer grid, over the depth beyond first touch


class _SearchOver(Exception):
    """Raised to end a root search, after success or a failed solve."""


class SearchedLoading(Loading):
    """Base class of loadings whose approach is found by search.

    A subclass defines `measure`. It works on patches that are not periodic in x and y, on each grid by a search that
    begins near the coarser grid's approach.

    Parameters
    ----------
    target : float
        The prescribed number, positive.

    Attributes
    ----------
    exponent : float
        Power of the number that is nearly linear in depth.
    slope : float
        Derivative of the number with respect to the depth, from the last search.
    """

    approach_is_known = allows_no_contact = is_geometric = False
    searches, exponent, result_rtol = True, 1.0, 1e-5

    def __init__(self, target):
        self.target, self.slope = float(target), 0.0
        self._depths = []  # final depths of the grids solved so far [mm]

    @classmethod
    def check_grid(cls, grid):
        """Raise InputError for a patch periodic in x and y, whose method needs an approach or a load."""
        if grid.doubly_periodic:
            raise InputError(f"{cls.name}: not on a patch periodic in x and y; use approach or load")

    def measure(self, state):
        """Return the number of a solved state. Collective."""
        raise NotImplementedError

    def resolution(self, grid):
        """Return the relative accuracy to which a grid can have the number."""
        return 0.0

    def usual_slope(self, state):
        """Return a slope to use if the search found none. Collective."""
        return 0.0

    def estimate_depth(self, state, touching):
        """Set the state's depth and contact set to an estimate. Collective.

        Return this depth beyond first touch, `touching` [mm].
        """
        beyond = state.distance.deviation or state.grid.dx
        state.depth = touching + beyond
        state.start_from_interpenetration()
        return beyond

    def largest_pressure(self, distance, grid, coefficient):
        """Return the pressure that flattens the shape; see `Loading.largest_pressure`."""
        return distance.deviation / coefficient

    def first_solve(self, state, solve):
        """Find the approach on the first grid; see `Loading.first_solve`."""
        return self._checked(state, self.search(state, solve, _RTOL))

    def next_solve(self, state, solve):
        """Find the approach near the present one; see `Loading.next_solve`."""
        step = _GRID_STEP * (state.depth - state.first_touch())
        return self._checked(state, self.search(state, solve, _RTOL, step))

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Find the approach that gives the number; see `Loading.solve_by_search`."""
        return self._checked(state, self.search(state, lambda loading: solve(loading, stop), rtol, step))

    def _checked(self, state, outcome):
        """Return the outcome, not converged if the number jumps over the prescribed one. Collective."""
        if abs(self.measure(state) - self.target) <= self.result_rtol * self.target or not outcome.converged:
            return outcome
        return outcome._replace(converged=False, reason=f"no approach has this {self.name}")

    def search(self, state, solve, rtol, step=None):
        """Find the approach that gives the number, by bracketing.

        Collective. The search solves problems of prescribed approach. It converges for every problem that `solve` can
        solve, because the number is monotone in the approach.

        The function ``solve(loading)`` solves from the contact set and pressure of `state`. `rtol` is relative to the
        number, or to the depth beyond first touch. `step` is the estimated error of the depth of `state` [mm]; if it is
        None, the search estimates a depth first. Return the Outcome of all solves, converged if all are.
        """
        touching, rtol = state.first_touch(), max(rtol, self.resolution(state.grid))
        numbers = {touching: 0.0}  # by depth
        from app.contact.history import Outcome  # here, for a help text without PETSc

        outcome = Outcome(True, "")

        def relative_error(depth):
            """Return the relative error of the number to the power of `exponent`."""
            nonlocal outcome
            if depth not in numbers:
                state.depth = depth
                outcome = solve(PrescribedApproach(state.approach, state.depth)).after(outcome)
                if not (outcome.converged or outcome.to_rounding):
                    raise _SearchOver
                numbers[depth] = self.measure(state)
                if abs(numbers[depth] - self.target) <= rtol * self.target:
                    raise _SearchOver
            return (max(numbers[depth], 0.0) / self.target) ** self.exponent - 1

        max_depth = state.distance.max_searched_depth
        try:
            if not step:
                low, high = touching, touching + 1.1 * self.estimate_depth(state, touching)
            else:
                low, high = max(touching, state.depth - step), max(touching, state.depth) + step
            least = 4 * np.spacing(max(abs(low), abs(high)))  # step above rounding
            high = min(max(high, low + least), max_depth)
            cells = state.distance.statistics.cells
            while (short := -relative_error(high)) > 0 and high < max_depth and state.plastic_cells() < cells:
                # This step is enough if the number is proportional to the depth, or grows faster.
                growth = max((1 if state.plastic_cells() else 2 * short) * (high - touching), least)
                low, high = high, min(high + growth, max_depth)
            while relative_error(low) > 0:
                low, high = max(touching, low - max(2 * (high - low), least)), low
            # Full contact of a periodic patch, or a plastic cell everywhere, may come first; `high` is the end then.
            root = high
            if relative_error(high) >= 0:
                root = _root(relative_error, low, high, rtol * (high - touching))
            if state.depth != root:  # not the depth of the last solve
                numbers.pop(root, None)
                relative_error(root)
        except _SearchOver:
            pass
        points = numbers or {touching: 0.0}  # first touch and full contact may be one
        nearest = sorted(points.items(), key=lambda point: abs(point[1] - self.target))[:2]
        (d1, f1), (d2, f2) = nearest[0], nearest[-1]  # the same point if the first solve failed
        self.slope = (f2 - f1) / (d2 - d1) if f2 != f1 else self.usual_slope(state)
        return outcome

    def resume(self, state, load):
        """Set the depth that closes the mean gap on C, and return it beyond first touch; see `Loading.resume`."""
        state.depth = touching = state.first_touch()
        beyond = state.on_contact().mean
        state.depth = touching + beyond
        return beyond

    def record(self, depth):
        """Store the final depth on a grid, for `predict`; see `Loading.record`."""
        self._depths.append(depth)

    @property
    def shared_state(self):
        """Slope of the number, and final depths of the grids so far."""
        return self.slope, self._depths

    @shared_state.setter
    def shared_state(self, shared_state):
        self.slope, self._depths = shared_state

    def predict(self, depth):
        """Extrapolate the depths as a geometric series; see `Loading.predict`."""
        last = [finer - coarser for coarser, finer in pairwise(self._depths[-3:])]
        ratio = last[1] / last[0] if len(last) == 2 and last[0] else 0.0
        return depth + min(max(ratio, 0.0), 0.5) * last[-1] if last else depth


def _root(function, low, high, xtol):
    """Find the zero of an increasing function between `low` and `high`."""
    for _ in range(_MAX_SECANTS):
        a, b = function(low), function(high)
        middle = low - a * (high - low) / (b - a)
        low, high = (low, middle) if function(middle) > 0 else (middle, high)
    from scipy.optimize import brentq

    return brentq(function, low, high, xtol=xtol)
