"""The total force is prescribed, for which the approach is found along the way.

The load F(delta) = dx dy sum(p) of the solved problem increases with the approach. Its slope is S = dx dy sum(q) with
``A q = 1`` on C. On the first grid a bracketing root search meets the load and leaves a secant for the slope. From
there on every active set iteration moves the approach by what the load will lack over the slope, as soon as the load
error exceeds what the residual can explain (Newton's method). In the end the load is made exact (`settle`). Where that
does not converge, the root search over solved problems does on any grid, since F is monotone.
"""

from __future__ import annotations

from itertools import pairwise
from math import isclose, sqrt

import numpy as np

from app.contact.history import Outcome
from app.contact.loading import Loading, PrescribedApproach
from app.contact.stopping import BELOW_ROUNDING

MIN_SECANT_STEP = 3.0  # rms residuals by which the approach must have moved for a secant to count
MAX_SLOPE_RATIO = 3.0  # factor by which the slope may change in one step
MAX_LEAST_STIFFNESS_RATIO = 3.0  # largest slope over the least stiffness there can be
MIN_MEAN_SLOPE_FRACTION = 0.9  # of the mean slope since first touch: least slope of a secant that counts
LOAD_ROUNDING = 1e-12  # of the sum of the pressure, relative, where the load has been met
LOAD_RESIDUAL_FRACTION = 0.25  # of the rms residual: error of the approach that the residual explains
_SECANTS = 2  # that usually meet a load; loading scipy.optimize, for the rest, takes as long as a small solve


class _SearchOver(Exception):
    """The load of a root search is met, or a problem of it is not solved; its outcome says which."""


class PrescribedLoad(Loading):
    """The total force is given.

    Parameters
    ----------
    load : float
        F, positive [N].
    mean_pressure : float
        The same over the area of the patch, as results have it [N/mm2].
    """

    kind, approach_is_known, allows_no_contact = "load", False, False

    def __init__(self, load, mean_pressure=np.nan):
        self.load, self._mean_pressure = float(load), mean_pressure
        self.slope = 0.0  # S [N/mm]
        self._before = None  # depth [mm] and load to be expected there [N], where the approach was moved last
        self._found = []  # depths of the grids solved so far [mm]

    def mean_pressure_on(self, grid):
        """See `Loading.mean_pressure_on`."""
        return self.load / (grid.n * grid.cell_area)

    def largest_pressure(self, distance, grid, coefficient):
        """See `Loading.largest_pressure`: of a single cell that bears all of the load."""
        return self.load / grid.cell_area

    def least_displacement(self, operator):
        """See `Loading.least_displacement`."""
        return self.mean_pressure_on(operator.grid) * operator.diagonal

    def restore_prescribed(self, measures):
        """See `Loading.restore_prescribed`; not if the load was missed."""
        if not isclose(measures.load, self.load, rel_tol=LOAD_ROUNDING):
            return measures
        in_contact = self.load / measures.contact_area if measures.contact_area else 0.0
        return measures._replace(
            load=self.load, mean_pressure=self._mean_pressure, mean_contact_pressure=in_contact
        )

    def first_solve(self, state, solve):
        """See `Loading.first_solve`: by root search."""
        outcome = self.search(state, solve, rtol=0.02)
        return solve(self).after(outcome) if outcome.converged else outcome

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """See `Loading.solve_by_search`: by root search, then exactly; (5.1) is tested once more."""
        tight = stop.tighter(tighter)  # after scaling, (5.1) must still hold
        outcome = self.search(state, lambda loading: solve(loading, tight), rtol, step)
        state.first_contact()  # under next to no load the search may end without
        residual = self.settle(state, state.activate_penetrating()).residual
        outcome = outcome._replace(residual=residual / state.distance.norm())
        if not outcome.converged:
            return outcome  # the load is right, if nothing else is
        if stop.final and residual > stop.allowed(state):
            return outcome._replace(converged=False, reason=BELOW_ROUNDING)
        return outcome

    def search(self, state, solve, rtol, step=None):
        """Bracketing root search: problems of prescribed approach are solved until the load is met.

        Converges for every problem that `solve` can solve, because the load is monotone in the approach. Collective.

        Parameters
        ----------
        state : ContactState
        solve : callable
            ``solve(loading)`` solves from the present contact set and pressure, and returns the Outcome.
        rtol : float
            Of the load, or of the depth beyond first touch.
        step : float, optional
            How far the depth of `state` may be from the right one [mm]; without it nothing is known.

        Returns
        -------
        Outcome
            Of all solves; not converged if one is not.
        """
        touching = state.first_touch()
        loads = {touching: 0.0}  # by depth
        outcome = Outcome(True, "")  # of all solves

        def lacks(depth):
            """What the load lacks, in the power that makes a sphere's linear in the depth."""
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

        try:
            if not step:
                low, high = touching, touching + 1.1 * self._guess(state, touching)
            else:
                low, high = max(touching, state.depth - step), max(touching, state.depth) + step
            least = 4 * np.spacing(max(abs(low), abs(high)))  # what can be told apart
            high = min(max(high, low + least), state.highest_searched)
            while (short := -lacks(high)) > 0 and high < state.highest_searched:
                # enough if the load is proportional to the depth, or grows faster
                low, high = (
                    high,
                    min(high + max(2 * short * (high - touching), least), state.highest_searched),
                )
            while lacks(low) > 0:
                low, high = max(touching, low - max(2 * (high - low), least)), low
            # A periodic patch may be in contact everywhere before it carries the load: nothing is beyond that.
            root = _root(lacks, low, high, rtol * (high - touching)) if lacks(high) >= 0 else high
            if state.depth != root:  # the last one solved
                loads.pop(root, None)
                lacks(root)
        except _SearchOver:
            pass
        nearest = sorted(loads.items(), key=lambda point: abs(point[1] - self.load))[:2]
        (d1, f1), (d2, f2) = nearest[0], nearest[-1]  # the same one if the first solve has failed
        self.slope = (f2 - f1) / (d2 - d1) if f2 != f1 else stiffness_of_patch(state)
        return outcome

    def _guess(self, state, touching):
        """Depth beyond first touch at which the overlap of undeformed bodies bears the load [mm]; C = {h <= 0} there.

        Collective. As flat punches of its area and mean depth would: right for those, 4% too little for a sphere.
        """
        stiffness = stiffness_of_patch(state)
        beyond = self.load / stiffness
        state.depth = touching
        state.start_from_interpenetration()
        for _ in range(3):
            state.depth = touching + beyond
            overlap = state.on_contact_or_overlap()
            borne = -overlap.mean * stiffness * sqrt(overlap.cells / state.grid.n)
            if not borne > 0:  # too little for the digits of the depth
                break
            beyond *= (self.load / borne) ** (2 / 3)
        state.start_from_interpenetration()
        return beyond

    def resume(self, state, load):
        """See `Loading.resume`; the solution may be of another gap.

        The gap in contact tells the depth. The load grows with a power of that beyond first touch, from 1
        for a punch to 2 for a cone: as of a sphere.
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
        self._found.append(depth)

    @property
    def shared(self):
        """Slope and depths that other ranks take over. Not collective."""
        return self.slope, self._found

    @shared.setter
    def shared(self, shared):
        self.slope, self._found = shared

    def predict(self, depth):
        """See `Loading.predict`: by extrapolation.

        The depths of a load on finer and finer grids converge like a geometric series.
        """
        last = [finer - coarser for coarser, finer in pairwise(self._found[-3:])]
        ratio = last[1] / last[0] if len(last) == 2 and last[0] else 0.0
        return depth + min(max(ratio, 0.0), 0.5) * last[-1] if last else depth

    def begin(self, state):
        """See `Loading.begin`."""
        self._before = None
        state.first_contact()

    def update(self, state):
        """Move the approach by what the load lacks over the slope; return how far [mm]. Collective; u is A p.

        The mean gap left in contact tells what the load will be at this approach when the system is solved.
        """
        gaps = state.on_contact_or_overlap()
        if not gaps.cells:
            state.first_contact()
        depth, expected = state.depth, gaps.load - self.slope * gaps.mean
        self._learn_slope(state, expected, gaps.rms)
        lacks = (self.load - expected) / self.slope
        if abs(lacks) <= LOAD_RESIDUAL_FRACTION * gaps.rms:
            return 0.0
        # Towards full contact the slope grows without bound; before first touch there is no load.
        there, lowest = min(depth + lacks, (depth + state.highest_searched) / 2), state.distance.lowest
        state.depth = there if there >= lowest else (depth + lowest) / 2
        self._before = depth, expected
        return abs(state.depth - depth)

    def _learn_slope(self, state, expected, rms):
        """Take dF/d(depth) from the last move, if the step was larger than the residual noise [mm]. Collective.

        Contact grows with the depth, and with it the slope: it is never less than the mean one since first touch.
        """
        beyond = state.depth - state.distance.lowest
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
        """Make the load exact, and the approach what the gap in contact then says. Collective; u is A p.

        By a factor; on a periodic patch by a constant on C; where there is no pressure, evenly over C.

        Returns
        -------
        Update
            Of the contact set after that.
        """
        load = state.load
        if load > 0:
            state.set_load(self.load, load)
        elif update.cells:  # so little that no pressure at all passes for solved
            state.distribute_load(self.load)
        else:
            return update._replace(added=1)  # there must be contact: go on
        state.depth += state.on_contact_or_overlap().mean
        return state.activate_penetrating().after(update)

    def scale_pressure(self, pressure, total, cell_area):
        """See `Loading.scale_pressure`."""
        if total > 0:
            pressure *= self.load / (cell_area * total)
        return total > 0

    def set_depth(self, state):
        """See `Loading.set_depth`: the gaps on C have no mean."""
        state.depth = 0.0
        state.depth = state.on_contact().mean


def _root(function, low, high, xtol):
    """Where a growing function is zero, between two points of which it is below and above. As collective as it is."""
    for _ in range(_SECANTS):
        a, b = function(low), function(high)
        middle = low - a * (high - low) / (b - a)
        low, high = (low, middle) if function(middle) > 0 else (middle, high)
    from scipy.optimize import brentq

    return brentq(function, low, high, xtol=xtol)


def least_stiffness(state):
    """Load per approach that a contact set on a periodic patch has at least [N/mm]; 0 on a free one. Collective.

    Near full contact the slope is anything up to infinite. With A q = 1 on C, 1.q >= (1.1)^2 / (1.A 1), sums over C.
    """
    if not state.grid.periodic:
        return 0.0
    energy, cells = state.operator.energy_of_contact()
    return state.grid.cell_area * cells**2 / energy if energy > 0 else 0.0


def stiffness_of_patch(state):
    """Load per approach of about a flat punch as large as the patch [N/mm], the most there can be. Not collective."""
    return 2 / (np.pi * state.operator.compliance) * np.sqrt(state.grid.n * state.grid.cell_area / np.pi)
