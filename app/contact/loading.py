"""Loadings: the base class, and a prescribed approach.

A loading is a prescribed quantity. `app.contact.loading_input.LOADINGS` has its class, by name; everything that a user
can prescribe is read from there. The solvers call these methods of a loading:

- `first_solve` solves on the first grid, and `next_solve` on the finer ones; if an earlier solution is given instead,
  `resume` chooses the approach;
- `begin` prepares the iteration on a grid;
- `update` moves the approach in each active set iteration, after u = A p and before cells enter C;
- `settle` meets the prescribed number exactly, on the target grid, when the stopping test (5.1) holds;
- `record` stores the depth found on a grid, and `predict` extrapolates it to the next grid.

Ranks that join on the next grid receive `shared_state`. If the iteration fails, `solve_by_search` is called. The
periodic method, whose unknown is the gap, calls `scale_pressure` and `set_depth` instead of `update` and `settle`.
"""

from math import ulp

import numpy as np

from app.base.errors import InputError, format_exact
from app.contact.tilt import NO_TILT

_FULL_CONTACT_ROUNDING = 1e-12  # relative rounding error of the approach of full contact
ROUNDING_ULPS = 4  # rounding error of numbers that users compute, in units in the last place


class Loading:
    """Base class of loadings; methods suit a prescribed approach.

    Attributes
    ----------
    name : str
        Name of the prescribed number in `LOADINGS`, which is the name of a number of solutions, too.
    kind : str
        What solutions report as prescribed.
    unit, meaning : str
        Unit and meaning of the number, for messages and the help.
    exact : tuple of str
        Quantities of `app.base.quantities.ESTIMATED` that the number fixes, so that they have no grid error.
    least : float
        Least number on any patch.
    is_geometric : bool
        True if contact set and gaps determine the number: then background pressure and creep do not change it.
    falls : bool
        True if the number falls when the load grows.
    result_rtol : float
        Relative accuracy with which solutions have the number.
    load : float or None
        Prescribed total force [N]; None if another number is prescribed.
    approach_is_known : bool
        True if the loading alone determines the approach on every grid.
    searches : bool
        True if each grid is solved by a root search for the approach.
    allows_no_contact : bool
        True if bodies that do not touch can be the solution.
    tilt : Tilt
        Prescribed tilt; only its pivot matters if the loading finds the tilt.
    tilts : bool
        True if the loading finds the tilt.
    support : Springs or None
        Springs that carry the missing load, used by the safeguard only.
    shared_state : any
        Results of coarser grids, for the ranks that join on a finer one.
    """

    name = kind = unit = meaning = ""
    exact, least, is_geometric, falls, result_rtol = (), -np.inf, True, False, 1e-9
    load, approach_is_known, allows_no_contact, shared_state = None, True, True, None
    tilt, tilts, searches, support = NO_TILT, False, False, None

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        """Return the loading for a number of at least `least`; see `make_loading`."""
        raise NotImplementedError

    @classmethod
    def check_grid(cls, grid):
        """Raise InputError for a patch on which the number cannot be prescribed."""

    @property
    def is_tilted(self):
        """True if the loading prescribes a tilt, or finds one."""
        return self.tilts or self.tilt != NO_TILT

    @staticmethod
    def part_of_indentation(depth):
        """Return what a permanent indentation of mean `depth` [mm] adds to the number."""
        return 0.0

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

    def next_solve(self, state, solve):
        """Solve from the coarser grid's solution by ``solve(loading)``; return the Outcome. Collective."""
        return solve(self)

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Solve by a root search if the approach is unknown. Collective.

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

    def moment_error(self, state):
        """Return the relative error of prescribed moments. Collective."""
        return 0.0

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

    name = kind = "approach"
    unit, meaning, exact = "mm", "approach of the bodies", ("approach",)

    def __init__(self, approach, depth=None):
        self.approach, self._depth = float(approach), depth

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        """Return the loading; see `Loading.create`.

        If the bodies have a `uniform_compliance`, approaches beyond full contact are allowed.
        """
        if uniform_compliance and distance.bounds.capped:
            what, advice = f"approach {format_exact(value)}", "use load, mean_pressure or mean_gap"
            bodies = "a layer on a rigid base or a compliant surface"
            raise InputError(f"{what}: not with a hardness for {bodies}; {advice}")
        if not distance.is_singular or uniform_compliance:
            return cls(value)
        (cells, mean, *_), reference = distance.statistics, distance.reference
        has_holes, (full, rounding) = cells < grid.n, full_contact(distance)
        size = max(abs(value), abs(reference))
        if distance.max_depth == np.inf and not has_holes and value - full > ROUNDING_ULPS * ulp(size):
            if not distance.depth_rounding(value - reference):
                return cls(value)
            return cls(value, without_rounding(value - reference, size, distance, np.inf))
        if value - full > rounding and not has_holes:
            limit = f"it must be at most {full!r} mm, full contact"
            what = f"approach {format_exact(value)}: the mean gap of this periodic patch would be negative"
            raise InputError(f"{what}; {limit}")
        value, mean = (value, np.inf) if has_holes else (min(value, full), mean)
        return cls(value, without_rounding(value - reference, size, distance, mean))

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


def full_contact(distance):
    """Return the approach of full contact and its rounding error [mm]."""
    full = distance.approach_at(distance.statistics.mean)
    return full, _FULL_CONTACT_ROUNDING * (abs(full) + distance.deviation)


def without_rounding(depth, size, distance, full):
    """Round a depth to first touch, full contact or full plasticity if close.

    `full` is the depth of full contact, infinite if plastic cells may overlap. A depth is close to these depths if it
    differs only by the rounding of numbers as large as `size`, from which it was computed. Then pressures or gaps would
    have no correct digits.
    """
    rounding, touching = ROUNDING_ULPS * ulp(size), distance.touching
    if full - depth <= rounding:
        return full
    if 0 < distance.plastic_depth - depth <= rounding:
        return distance.plastic_depth
    return touching if 0 < depth - touching <= rounding else depth
