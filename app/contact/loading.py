"""What is prescribed: the approach, or the load, for which the approach is found along the way.

The load F(delta) = dx dy sum(p) of the solved problem increases with the approach; its slope is S = dx dy sum(q) with
``A q = 1`` on C. On the first grid a bracketing root search meets the load and leaves a secant for the slope. From
there on every active set iteration moves the approach by what the load will lack over the slope, as soon as that is
more than the residual may be to blame for (Newton's method). In the end the load is made exact (`settle`).

Where that does not converge, the root search over solved problems does on any grid: F is monotone.

Order of the calls: on the first grid `first_solve`, or `resume` from a solution; on each grid `begin`; in each active
set iteration `update`, between u = A p and (4.b); on the target, when (5.1) holds, `settle`; after a grid `record`, and
before the next one `predict`. Ranks that join receive `shared`. `solve_by_search` serves where this fails. The periodic
method, whose unknown is the gap, calls `scale_pressure` and `set_depth` in place of `update` and `settle`.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt, ulp
from numbers import Real

import numpy as np

from app.contact.history import Outcome
from app.contact.stopping import ROUNDING_LEAVES
from app.errors import InputError, exactly
from app.options import LARGEST

_TELLING = 3.0  # rms residuals that the approach has to move by for a secant to count
_AT_ONCE = 3.0  # factor by which the slope may change at once
_OVER_LEAST = 3.0  # times the least stiffness there can be is the largest slope that is believed
_NEARLY = 0.9  # of the mean slope, that rounding makes of it where a contact set has not changed
_BLAMED = 0.25  # of the rms residual: by so much the approach that the load asks for may be wrong
LOADINGS = {"approach": "mm", "load": "N", "mean_pressure": "N/mm2", "mean_gap": "mm"}
_FULL_CONTACT_ROUNDING = 1e-12  # of its approach
_FEW = 4  # units in the last place, that numbers as users compute them may be wrong by
_SECANTS = 2  # meet a load as a rule; scipy.optimize, for the rest, takes as long to load as a small solve


class _SearchOver(Exception):
    """The load of a root search is met, or a problem of it is not solved; its outcome says which."""


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

    def found_approach(self, state):
        """Return the approach of a solution, exactly as prescribed [mm]."""
        return state.approach

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

    def found_approach(self, state):
        """See `Loading.found_approach`."""
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
    """

    kind = "mean_gap"

    def __init__(self, distance, depth):
        super().__init__(distance.approach_at(depth), depth)
        self._mean = distance.statistics.mean

    def depth_on(self, distance):
        """See `Loading.depth_on`."""
        return self._depth + (distance.statistics.mean - self._mean)


class PrescribedLoad(Loading):
    """The total force is given.

    Parameters
    ----------
    load : float
        F, positive [N].
    """

    kind, approach_is_known, allows_no_contact = "load", False, False

    def __init__(self, load):
        self.load = float(load)
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
            return outcome._replace(converged=False, reason=ROUNDING_LEAVES)
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
        if abs(lacks) <= _BLAMED * gaps.rms:
            return 0.0
        # Towards full contact the slope grows without bound; before first touch there is no load.
        there, lowest = min(depth + lacks, (depth + state.highest_searched) / 2), state.distance.lowest
        state.depth = there if there >= lowest else (depth + lowest) / 2
        self._before = depth, expected
        return abs(state.depth - depth)

    def _learn_slope(self, state, expected, rms):
        """Take dF/d(depth) from the last move, if that was larger than the residual [mm] can feign. Collective.

        Contact grows with the depth, and with it the slope: it is never less than the mean one since first touch.
        """
        beyond = state.depth - state.distance.lowest
        mean_slope = expected / beyond if beyond > 0 else 0.0
        (before, then), self._before = self._before or (state.depth, 0.0), None
        moved = state.depth - before
        if abs(moved) > _TELLING * rms and (slope := (expected - then) / moved) >= _NEARLY * mean_slope:
            self.slope = min(max(slope, self.slope / _AT_ONCE), _AT_ONCE * self.slope)
        self.slope = max(self.slope, mean_slope)
        if least := least_stiffness(state):
            self.slope = min(max(self.slope, least), _OVER_LEAST * least)

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


def prescribe(grid, distance, **given):
    """Make the loading of a number. Not collective.

    Parameters
    ----------
    grid : Grid
        Target grid.
    distance : UndeformedDistance
        On it.
    **given : float
        Of `LOADINGS` exactly one that is not None: approach or mean gap [mm], load [N], or mean pressure, load over
        area of the patch [N/mm2].

    Raises
    ------
    InputError
        If not exactly one is given, or it is not allowed.
    """
    given = {kind: number for kind, number in given.items() if number is not None}
    if len(given) != 1 or not given.keys() <= LOADINGS.keys():
        *others, last = (f"{kind} [{unit}]" for kind, unit in LOADINGS.items())
        raise InputError(f"exactly one of {', '.join(others)} and {last} is needed")
    [(kind, number)] = given.items()
    value = as_number(kind, number)
    if kind in ("load", "mean_pressure"):
        if value < 0:
            raise InputError(
                f"{kind} {exactly(value)}: the bodies do not stick together; allowed: at least 0 {LOADINGS[kind]}"
            )
        return PrescribedLoad(value if kind == "load" else value * grid.area)
    # On a periodic patch displacements have no mean: mean(gap) = mean(undeformed distance) - approach.
    holes = grid.n - distance.statistics.cells
    mean, reference = distance.statistics.mean, distance.reference
    full = distance.approach_at(mean)
    little = _FULL_CONTACT_ROUNDING * (abs(full) + distance.deviation)
    if kind == "mean_gap":
        _check_mean_gap(value, grid, holes, little)
        # no digits are lost to the reference
        depth = (mean - max(value, 0.0)) + distance.statistics.mean_rest
        depth = _without_rounding(depth, mean, distance.touching, mean)
        return PrescribedMeanGap(distance, depth)
    if not grid.periodic:
        return PrescribedApproach(value)
    if value - full > little and not holes:
        raise InputError(
            f"approach {exactly(value)}: the mean gap of this periodic patch would be negative; "
            f"allowed: at most {full!r} mm, full contact"
        )
    value, mean = (value, np.inf) if holes else (min(value, full), mean)
    size = max(abs(value), abs(reference))
    return PrescribedApproach(value, _without_rounding(value - reference, size, distance.touching, mean))


def _without_rounding(depth, size, touching, full):
    """A depth, or that of first touch or full contact, if it differs by no more than numbers of a size are rounded by.

    A contact, or a gap that is left, of rounding alone has no digits.
    """
    rounding = _FEW * ulp(size)
    if full - depth <= rounding:
        return full
    return touching if 0 < depth - touching <= rounding else depth


def as_number(kind, given):
    """The number of a loading, by Python or numpy, an array without dimensions, too. Not collective.

    Raises
    ------
    InputError
        If it is something else, or too large or small.
    """
    if isinstance(given, np.ndarray) and not given.shape:
        given = given[()]
    if isinstance(given, bool) or not isinstance(given, Real):
        many = hasattr(given, "__len__") and getattr(given, "shape", None) != ()  # () as of what is masked
        if many and not isinstance(given, str | bytes):
            what = f"{kind}: {type(given).__name__} of {len(given)}"
            raise InputError(f"{what}; allowed: a number; many, one after the other: ContactSolver.path")
        raise InputError(f"{kind}: is {type(given).__name__}; needed: a number [{LOADINGS[kind]}]")
    try:
        value = float(given)
    except OverflowError:
        value = np.inf
    if not (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
        raise InputError(
            f"{kind} {exactly(value)}: allowed: a number of size {1 / LARGEST:g} to {LARGEST:g}, or 0"
        )
    return value


def _check_mean_gap(value, grid, holes, little):
    """Refuse a mean gap that no approach is known for, or none has."""
    given, others = f"mean_gap {exactly(value)}", "allowed: approach, load or mean_pressure"
    if not grid.periodic:
        raise InputError(f"{given}: only on a periodic patch does it say what the approach is; {others}")
    if holes:
        raise InputError(
            f"{given}: contact is impossible in {holes} cells (NaN), whose gap nobody knows; {others}"
        )
    if value < -little:
        raise InputError(f"{given}: the bodies do not penetrate each other; allowed: at least 0 mm")
