"""Solutions with all cells at a bound: open, or at the hardness.

Under the largest load all cells are at the hardness, and the solution costs one product. So it does at the approaches
that are known to have this load, see `UndeformedDistance.plastic_depth`. Under a smaller load all cells may be at a
bound, too. The load is then the same at all approaches of an interval, and the result has the lower end.
"""

import math

import numpy as np

from app.contact.history import Outcome
from app.contact.state import Displacement
from app.contact.updates import Update

ALL_PLASTIC = "all cells plastic"
CONTACT_PLASTIC = "all contact plastic"
LOAD_ROUNDING = 1e-13  # relative rounding error of the load of cells at the hardness
_GAP_ULPS = 4  # rounding error of a gap, in units in the last place of depth or displacement


class FullPlasticity:
    """Solver for the case that all cells are at the hardness.

    Parameters
    ----------
    level : int
        Number of the target level.
    """

    work_units = 0.0

    def __init__(self, level):
        self.level = level

    def solve(self, state, loading, history):
        """Solve if the load is the largest possible. Collective.

        Many approaches are possible under the largest load. If the load is prescribed, the smallest of these approaches
        is chosen. Return the Outcome, or None if the load is smaller, or not known.
        """
        bounds, load, depth = state.bounds, loading.load, loading.depth_on(state.distance)
        if load is None:
            is_largest = state.distance.plastic_depth <= depth < np.inf
        else:
            is_largest = load >= (1 - LOAD_ROUNDING) * bounds.largest_load
        if not is_largest:
            return None
        history.start(state, self)
        state.contact[...] = False
        np.copyto(state.values, bounds.upper, where=state.admissible)
        state.compute_displacement(exact=True)
        if load is None:
            state.depth = depth
        else:
            state.depth = 0.0
            gap = state.gap()
            state.depth = -float(state.minimum(-gap[state.admissible].max(initial=-np.inf)))
        cells = state.distance.statistics.cells
        history.add(state, self, Update(cells, cells, 0, 0.0), 0)
        return Outcome(True, ALL_PLASTIC, 1, 0.0, to_rounding=True)


def move_to_lower_end(state, load):
    """Move to the least approach with a load, if all cells are at a bound. Collective.

    Let all cells with p > H / 2 be plastic, and all others open. If these pressures carry the load, and no plastic cell
    has a larger ``shape + u`` than an open one, they are the solution. The least approach is the largest ``shape + u``
    of the plastic cells. `load` is the prescribed load, or None [N]. Return whether `state` has this solution. If not,
    `state` is unchanged.
    """
    bounds, area = state.bounds, state.grid.cell_area
    if load is None or not state.plastic_cells():
        return False
    total = area * state.sum([bounds.sum_at_nearest_bound(state.p)])[0]
    if not math.isclose(total, load, rel_tol=LOAD_ROUNDING):
        return False
    plastic = state.admissible & (2 * state.p > bounds.upper)
    p, u = np.where(plastic, bounds.upper, 0.0), np.empty(state.u.shape)
    state.operator.exact_displacement(p, u)
    gap, opened = u - (state.distance.b + state.depth), state.admissible & ~plastic
    highest = gap.max(initial=-np.inf, where=plastic), np.abs(u).max(initial=0.0)
    least, *highest = state.minimum([gap.min(initial=np.inf, where=opened), *np.negative(highest)])
    step, largest_u = np.negative(highest).tolist()
    if step > least + _GAP_ULPS * math.ulp(max(largest_u, abs(state.depth))):
        return False
    state.values[...], state.u[...], state.contact[...] = p, u, False
    state.displacement_status = Displacement.EXACT
    state.depth += step
    return True
