"""A prescribed load or mean pressure.

The load F(delta) = dx dy sum(p) of the solved problem increases with the approach delta. The slope of the load is S =
dx dy sum(q), where q is the pressure on C with ``A q = 1`` there. On the first grid a bracketing root search meets the
load and gives a secant slope. On all other grids, every active set iteration changes the approach by the missing load
divided by the slope (Newton's method), if the load error exceeds what the residual can explain. `settle` makes the load
exact. If this iteration does not converge, the root search is used.
"""

from math import isclose, sqrt

import numpy as np

from app.base.errors import InputError, format_exact
from app.contact.approach_search import SearchedLoading
from app.contact.loading import PrescribedApproach
from app.contact.stopping import BELOW_ROUNDING

MIN_SECANT_STEP = 3.0  # least step of the approach that gives a secant slope, over the rms residual
MAX_SLOPE_RATIO = 3.0  # factor by which the slope may change in one step
PLASTIC_STIFFNESS_RATIO = 1.4  # stiffness of elastic contact between plastic cells over its lower bound
MAX_LEAST_STIFFNESS_RATIO = 3.0  # largest slope over the lower bound of the stiffness
MIN_MEAN_SLOPE_FRACTION = 0.9  # least secant slope that is used, over the mean slope since first touch
MAX_PLASTIC_FRACTION = 0.05  # on free patches, plastic over elastic cells up to which the slope is learned
MIN_MODEL_STEP = 10.0  # least step that corrects the model of plastic contact, over the rms residual
MISSING_LOAD_RATIOS = -1.0, 0.3  # range of the missing load over that before the last step
MODEL_FACTORS = 0.4, 1.5  # range of the factor on steps of the model
LOAD_ROUNDING = 1e-12  # relative difference of a load that has been met
LOAD_RESIDUAL_FRACTION = 0.25  # error of the approach that the residual explains, over the rms residual
_MAX_PLATEAUS = 100  # number of plateaus of the load that are left after a search, each by one product


class PrescribedLoad(SearchedLoading):
    """Prescribed total force.

    Parameters
    ----------
    load : float
        The load F, positive [N].
    mean_pressure : float
        Load divided by the area of the patch, as results report it [N/mm2].
    """

    name = kind = "load"
    unit, meaning, exact = "N", "total normal force", ("load",)
    searches = False  # the iteration changes the approach
    exponent = 2 / 3  # load^(2/3) is nearly linear in depth
    result_rtol, least = 1e-9, 0.0  # the bodies do not stick together

    def __init__(self, load, mean_pressure=np.nan):
        super().__init__(load)
        self.load, self._mean_pressure = self.target, mean_pressure
        self._missing, self._model_factor = None, 1.0  # missing load [N] and depth [mm] before the last step
        self._before = None  # depth [mm] and expected load [N] before the last move of the approach

    @classmethod
    def check_grid(cls, grid):
        """Allow all patches."""

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        """Return the loading; see `Loading.create`. Without load it is the approach of first touch."""
        if not value:  # the approach is not unique
            return PrescribedApproach(distance.approach_at(distance.touching), distance.touching)
        to_load, largest = cls.load_per_number(grid), distance.bounds.largest_load
        from app.contact import full_plasticity  # here, for a help text without PETSc

        if value * to_load > (1 + full_plasticity.LOAD_ROUNDING) * largest:
            limit = f"{format_exact(largest / to_load)} {cls.unit}, which all cells carry at their hardness"
            raise InputError(f"{cls.name} {format_exact(value)}: must be at most {limit}")
        mean_pressure = value / grid.area if cls is PrescribedLoad else value
        return PrescribedLoad(value * to_load, mean_pressure)

    @staticmethod
    def load_per_number(grid):
        """Return the load [N] for the prescribed number 1."""
        return 1.0

    def measure(self, state):
        """Return the load of a solved state [N]; see `SearchedLoading.measure`."""
        return state.load

    def mean_pressure_on(self, grid):
        """Return the load divided by patch area; see `Loading`."""
        return self.load / (grid.n * grid.cell_area)

    def largest_pressure(self, distance, grid, coefficient):
        """Return the pressure if one cell carried the whole load; see `Loading`."""
        return self.load / grid.cell_area

    def least_displacement(self, operator):
        """Multiply the mean pressure by the diagonal of A; see `Loading.least_displacement`."""
        return self.mean_pressure_on(operator.grid) * operator.diagonal

    def restore_prescribed(self, measures):
        """Restore a load met up to rounding; see `Loading.restore_prescribed`."""
        if not isclose(measures.load, self.load, rel_tol=LOAD_ROUNDING):
            return measures
        load, mean = self.load, self._mean_pressure
        in_contact = load / measures.contact_area if measures.contact_area else 0.0
        return measures._replace(load=load, mean_pressure=mean, mean_contact_pressure=in_contact)

    def first_solve(self, state, solve):
        """Find the approach by root search; see `Loading.first_solve`."""
        outcome = self.search(state, solve, rtol=0.02)
        return solve(self).after(outcome) if outcome.converged else outcome

    def next_solve(self, state, solve):
        """Solve from the coarser grid's approach, which `update` changes; see `Loading.next_solve`."""
        return solve(self)

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Find the approach that gives the load; see `Loading.solve_by_search`.

        After the search the load is made exact, and the stopping test (5.1) is repeated.
        """
        tight = stop.tighter(tighter)  # after scaling, the stopping test must still hold
        outcome = self.search(state, lambda loading: solve(loading, tight), rtol, step)
        state.first_contact()  # a search for a tiny load may end without contact
        if state.plastic_cells():
            self._fill_plateaus(state)
        residual = self.settle(state, state.activate_penetrating()).residual
        outcome = outcome._replace(residual=residual / state.h_norm)
        if not outcome.converged:
            return outcome
        if stop.final and residual > stop.allowed(state):
            return outcome._replace(converged=False, reason=BELOW_ROUNDING)
        return outcome

    def _fill_plateaus(self, state):
        """Bring p to the load; if impossible, change the approach first. Collective."""
        for _ in range(_MAX_PLATEAUS):
            state.set_load(self.load, load := state.load)
            if isclose(state.load, self.load, rel_tol=LOAD_ROUNDING):
                break
            state.approach_next_cell() if load < self.load else state.retreat_to_cell()

    def usual_slope(self, state):
        """Return the stiffness of a punch; see `SearchedLoading.usual_slope`."""
        return stiffness_of_patch(state)

    def estimate_depth(self, state, touching):
        """Estimate the depth for the load; see `SearchedLoading.estimate_depth`.

        The estimate treats the overlap of the undeformed bodies as a flat punch with the same area and mean depth. The
        estimate is right for flat punches, and 4% too small for a sphere.
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
        """Estimate depth and slope from a solution; see `Loading.resume`.

        The solution may belong to another problem. The depth follows from the mean gap on C. For the slope, the load is
        assumed to grow with the power 3/2 of the depth beyond first touch, as for a sphere (a punch has the power 1, a
        cone 2).
        """
        beyond, touching = super().resume(state, load), state.first_touch()
        state.depth = touching
        if load > 0 and beyond > 0:
            self.slope = 1.5 * load / beyond
            state.depth = touching + beyond * (self.load / load) ** (2 / 3)
        else:
            self.slope = stiffness_of_patch(state)

    def begin(self, state):
        """Forget the last step, and ensure contact; see `Loading.begin`."""
        self._before, self._missing, self._model_factor = None, None, 1.0
        state.first_contact()
        if state.distance.is_singular and not self.slope:  # the periodic method does not use it
            beyond = state.depth - state.distance.zero_load_depth
            self.slope = 1.5 * self.load / beyond if beyond > 0 else stiffness_of_patch(state)

    def update(self, state):
        """Change the approach by the missing load divided by the slope.

        The load at this approach is estimated from the mean gap in contact. See `Loading.update`.
        """
        gaps = state.on_contact_or_overlap()
        if not gaps.cells and not state.plastic_cells():
            state.first_contact()
        depth = state.depth
        least_plastic = 0 if state.operator.is_singular else MAX_PLASTIC_FRACTION * gaps.cells
        if state.plastic_cells() > least_plastic:
            stiffness = PLASTIC_STIFFNESS_RATIO * least_stiffness(state)
            expected, step = np.nan, self._plastic_step(state, gaps, stiffness)
        else:
            expected = gaps.load - self.slope * gaps.mean
            self._learn_slope(state, expected, gaps.rms)
            step = (self.load - expected) / self.slope
        if abs(step) <= LOAD_RESIDUAL_FRACTION * gaps.rms:
            return 0.0
        # The slope grows without bound towards full contact. Before first touch there is no load.
        new_depth = min(depth + step, (depth + state.distance.max_searched_depth) / 2)
        least = state.distance.zero_load_depth
        state.depth = new_depth if new_depth >= least else (depth + least) / 2
        self._before = None if expected != expected else (depth, expected)
        return abs(state.depth - depth)

    def _plastic_step(self, state, gaps, stiffness):
        """Return the step of `step_to_load`, corrected [mm]. Collective.

        The step is multiplied by a factor that follows from the last errors of the model of load against depth. This is
        faster if the model is always wrong by the same factor.
        """
        from app.contact.plastic_load import step_to_load

        step, expected = step_to_load(state, gaps.load, self.load, stiffness)
        missing, (before, depth) = self.load - expected, self._missing or (0.0, state.depth)
        if before and abs(state.depth - depth) > MIN_MODEL_STEP * gaps.rms:
            ratio = np.clip(missing / before, *MISSING_LOAD_RATIOS)
            self._model_factor = float(np.clip(self._model_factor / (1 - ratio), *MODEL_FACTORS))
        self._missing = missing, state.depth
        return self._model_factor * step

    def _learn_slope(self, state, expected, rms):
        """Update the slope dF/d(depth) from the last change of the depth. Collective.

        Changes below `MIN_SECANT_STEP` times the residual `rms` [mm] are not used. `expected` is the load at this depth
        [N]. The slope grows with the depth, so it is at least the mean slope since first touch.
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
        """Scale p to the prescribed load, then make the mean gap on contact zero; see `Loading.settle`.

        How p is scaled on periodic patches, and with a hardness, says the state's `set_load`. If p = 0, the load is
        distributed evenly over C.
        """
        load = state.load
        if load > 0:
            if not (state.plastic_cells() and isclose(load, self.load, rel_tol=LOAD_ROUNDING)):
                state.set_load(self.load, load)
        elif update.cells:  # a load so small that p = 0 counts as solved
            state.distribute_load(self.load)
        else:
            return update._replace(added=1)  # continue: there must be contact
        if state.plastic_cells() and not isclose(state.load, self.load, rel_tol=LOAD_ROUNDING):
            self.update(state)  # C is empty, or all its cells are at a bound
            return update._replace(added=1)
        state.depth += state.on_contact_or_overlap().mean
        return state.activate_penetrating().after(update)

    def meet(self, state):
        """Add missing load if cells are plastic; see `Loading.meet`."""
        if state.plastic_cells():
            state.reach_load(self.load)

    def scale_pressure(self, pressure, total, cell_area):
        """Scale a pressure to the prescribed load; see `Loading.scale_pressure`."""
        if total > 0:
            pressure *= self.load / (cell_area * total)
        return total > 0

    def set_depth(self, state):
        """Make the mean gap on the contact set zero; see `Loading.set_depth`."""
        state.depth = 0.0
        state.depth = state.on_contact().mean


class PrescribedMeanPressure(PrescribedLoad):
    """Prescribed load over the area of the patch; `create` returns a `PrescribedLoad`."""

    name, unit, meaning = "mean_pressure", "N/mm2", "load over the area of the patch, holes and all"

    @staticmethod
    def load_per_number(grid):
        """Return the load [N] for the mean pressure 1: the area of the patch."""
        return grid.area


def least_stiffness(state):
    """Return a lower bound of the stiffness of C [N/mm]. Collective.

    The bound is 0 unless A is singular. Let q be the pressure on C with A q = 1 there. The stiffness is the cell area
    times 1.q, and 1.q >= (1.1)^2 / (1.A 1), with sums over C. Near full contact this bound grows to infinity.
    """
    if not state.operator.is_singular:
        return 0.0
    energy, cells = state.operator.energy_of_contact()
    return state.grid.cell_area * cells**2 / energy if energy > 0 else 0.0


def stiffness_of_patch(state):
    """Return the stiffness of a round punch with the patch's area [N/mm]."""
    return state.operator.kernel.punch_stiffness(state.grid.n * state.grid.cell_area)
