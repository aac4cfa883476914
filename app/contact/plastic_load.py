"""Step of the approach to a prescribed load if cells are plastic.

The slope of the load then changes with every cell that becomes plastic, so the step is computed from a model. In the
model each cell has its own compliance A_II, and its pressure stays within the bounds. The change of the load also
displaces the whole contact, like a punch as large as the contact. If the cells approach by t, the load is

    F(t) = dx dy sum(clip(p - (e - t) / A_II, 0, H)),

and the bodies approach by t plus the change of the load over the stiffness of the punch. The equation also holds if all
cells are elastic, and if all cells are plastic.
"""

from app.halfspace.window import bounding_boxes

_STEP_RTOL = 1e-2  # relative error of the change of the load
_MAX_TRIALS = 60


def step_to_load(state, load, target, stiffness=0.0):
    """Return the change of depth that brings the load to a target [mm].

    Collective. `load` is the present load [N], `target` the prescribed load [N]. On periodic patches `stiffness` is the
    stiffness of elastic contact [N/mm]. Return also the load that the model expects at the present depth [N].
    """
    grid, distance, compliance = state.grid, state.distance, state.operator.diagonal
    fields = distance.b, state.depth, state.u, state.p
    cells = max(state.elastic_cells(), 1)
    if stiffness:
        compliance = cells * grid.cell_area / stiffness

    def error(t):
        total = state.sum([state.bounds.local_load(*fields, t, compliance)])[0]
        return grid.cell_area * float(total) - target

    low, at_low = 0.0, (first := error(0.0))
    step = -at_low * compliance / (cells * grid.cell_area)
    high, at_high = step, error(step)
    for _ in range(_MAX_TRIALS):
        if at_low * at_high <= 0:
            break
        step *= 2
        low, at_low, high = high, at_high, high + step
        at_high = error(high)
    t = _zero(error, (low, at_low), (high, at_high), _STEP_RTOL * abs(target - load))
    step = t if grid.symbol else t + (target - load) / punch_stiffness(state)
    return step, target + first


def _zero(function, one, other, allowed):
    """Find the zero of a monotone function by the Illinois method.

    `one` and `other` are points (t, value) with values of opposite signs. A value up to `allowed` counts as zero.
    """
    (a, at_a), (b, at_b) = one, other
    for _ in range(_MAX_TRIALS):
        if abs(at_b) <= allowed or at_a == at_b:
            break
        c = b - at_b * (b - a) / (at_b - at_a)
        at_c = function(c)
        if at_c * at_b <= 0:
            a, at_a = b, at_b
        else:
            at_a /= 2
        b, at_b = c, at_c
    return b


def punch_stiffness(state):
    """Return the stiffness of a round punch [N/mm]. Collective.

    The area of the punch is that of the bounding box of contact.
    """
    [box] = bounding_boxes([state.in_contact()], state.operator.slabs, state.comm)
    area = state.grid.cell_area * (box.n if box else 1)
    return state.operator.kernel.punch_stiffness(area)
