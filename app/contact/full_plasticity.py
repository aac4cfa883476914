"""Solution under the largest load, with all cells at the hardness.

The solution costs one product.
"""

import numpy as np

from app.contact.history import Outcome
from app.contact.state import Update

ALL_PLASTIC = "all cells plastic"
LOAD_ROUNDING = 1e-13  # relative rounding error of the largest load


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
        """Solve if the load is the largest one. Collective.

        Many approaches are possible under the largest load. The smallest of these approaches is chosen. Return the
        Outcome, or None under a smaller load.
        """
        bounds, load = state.bounds, loading.load
        if load is None or load < (1 - LOAD_ROUNDING) * bounds.largest_load:
            return None
        history.start(state, self)
        state.contact[...] = False
        np.copyto(state.values, bounds.upper, where=state.admissible)
        state.compute_displacement(exact=True)
        state.depth = 0.0
        gap = state.gap()
        state.depth = -float(state.minimum(-gap[state.admissible].max(initial=-np.inf)))
        cells = state.distance.statistics.cells
        history.add(state, self, Update(cells, cells, 0, 0.0), 0)
        return Outcome(True, ALL_PLASTIC, 1, 0.0, to_rounding=True)
