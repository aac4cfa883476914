"""Step of the approach towards a prescribed load, with plastic cells.

The slope of the load then changes with every cell that becomes plastic, so the step is computed from a model. In the
model each cell has its own compliance A_II, and its pressure stays within the bounds. The change of the load also
displaces the whole contact, like a punch as large as the contact. Let e be the gap and H the hardness. If the cells
approach by t, the load is

    F(t) = dx dy sum(clip(p - (e - t) / A_II, 0, H)),

and the bodies approach by t plus the change of the load over the stiffness of the punch. The equation also holds if all
cells are elastic, and if all cells are plastic.
"""

import numpy as np

_STEP_RTOL = 1e-2  # relative error of the change of the load
_MAX_TRIALS = 60


def step_to_load(state, load, target, stiffness=0.0):
    """Return the change of depth that brings the load to a target [mm].

    Collective. `load` is the present load [N], `target` the prescribed load [N]. On periodic patches `stiffness` is the
    stiffness of elastic contact [N/mm]. In the model of load against depth, the pressure of each cell changes in
    proportion to its overlap, within bounds, without effect on other cells. Return also the model's load at the present
    depth [N].
    """
    grid, distance, compliance = state.grid, state.distance, state.operator.diagonal
    fields = distance.b, state.depth, state.u, state.p
    cells = max(state.elastic_cells(), 1)
    if stiffness:
        compliance = cells * grid.cell_area / stiffness

    def model(t):
        """Return the model's load minus the target, with derivative."""
        total, free = state.sum(state.bounds.local_load(*fields, t, compliance))
        return grid.cell_area * float(total) - target, grid.cell_area * float(free) / compliance

    first, slope = model(0.0)
    allowed = _STEP_RTOL * max(abs(target - load), abs(first))
    t = _zero(model, first, slope, abs(first) * compliance / (cells * grid.cell_area), allowed)
    step = t if state.operator.is_singular else t + (target - load) / punch_stiffness(state)
    return step, target + first


def _zero(function, value, slope, width, allowed):
    """Find an increasing function's zero by Newton's method.

    The iteration starts at 0, and stays in an interval that contains the zero. ``function(t)`` returns value and
    derivative; those at 0 are `value` and `slope`. `width` is the first step where the derivative is 0. A value up to
    `allowed` counts as zero.
    """
    t, low, high, before = 0.0, -np.inf, np.inf, np.inf
    for _ in range(_MAX_TRIALS):
        if abs(value) <= allowed:
            break
        low, high = (t, high) if value < 0 else (low, t)
        following = t - value / slope if slope > 0 else np.nan
        slow, before = abs(value) > 0.5 * before, abs(value)
        if slow or not low < following < high:
            width *= 2
            following = (low + high) / 2 if high - low < np.inf else t - np.copysign(width, value)
        t = following
        value, slope = function(t)
    return t


def punch_stiffness(state):
    """Return the stiffness of a round punch [N/mm]. Collective.

    The area of the punch is the area of the bounding box of contact.
    """
    return state.operator.kernel.punch_stiffness(state.grid.cell_area * state.box_of_contact())
