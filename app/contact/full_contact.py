"""Full contact of a periodic patch without holes, which costs two products.

If all gaps are closed, u is -h minus its mean, so ``p = mean pressure + B (-h)``, where B is the inverse of A on fields
without mean. If this p is within its bounds, it solves (2.8)-(2.10), and the approach is the mean of the shape.

Shapes on coarser grids are smoother, and mostly need less pressure for full contact. So if a coarser grid is far from
full contact, the iteration runs first. Full contact is then tried only if the iteration closes all cells or fails.
"""

import numpy as np

from app.contact.history import Outcome
from app.contact.updates import Update
from app.parallel.reductions import minimum_over

FULL_CONTACT = "contact everywhere"
_ROUNDING = 1e-12  # residual by rounding, over the displacement of a cell by the highest pressure
_PROBED_LEVELS = 2  # number of levels by which the grid tried first is coarser than the target
# Full contact is unlikely at a pressure below this share of that for full contact on a coarser grid.
_MAX_PRESSURE_FRACTION = 0.5


class FullContact:
    """Solver for the case with all cells in contact.

    `distances` are the undeformed distances on all levels, coarsest first. The attribute `postponed` is true if a
    coarser grid showed that full contact is unlikely.
    """

    work_units, postponed = 0.0, False

    def __init__(self, hierarchy, distances):
        self.hierarchy, self._distances, self.level = hierarchy, distances, len(distances) - 1

    def solve(self, state, loading, stop, history):
        """Return the Outcome of full contact; None if it is no solution.

        Collective over all ranks. If the result is None, the pressure of `state` may have changed. Many mean pressures
        give the same approach at full contact. If the approach is prescribed, the solution has the least of them.
        """
        grid, distance = state.grid, state.distance
        wanted = loading.mean_pressure_on(grid)
        depth = loading.depth_on(distance)
        if not distance.full_depth <= depth or distance.full_depth == np.inf:
            return None
        if distance.max_depth == np.inf and distance.statistics.mean < depth < np.inf:  # beyond full contact
            return None
        prescribed, (least, most) = wanted < np.inf, distance.full_contact_pressures
        if prescribed and not least <= wanted <= most:
            return None
        if prescribed and np.isinf(least) and not self.postponed:
            self.postponed = self._is_unlikely(wanted)
            if self.postponed:
                return None
        p = state.values
        self.hierarchy.prepare_target()
        least, most = self._find_allowed(state.operator.exact_inverse, distance, p)
        wanted = wanted if prescribed else max(least, 0.0)
        if not least <= wanted <= most:
            return None
        p += wanted
        state.project()
        history.start(state, self)
        state.contact[...] = True
        mean = distance.statistics.mean
        state.move_to(mean, neglected_gap=max(mean - depth, 0.0))
        state.compute_displacement(exact=True)
        rms = state.on_contact_or_overlap().rms
        residual = np.sqrt(grid.n) * rms
        # ||h|| is no measure of the residual if heights differ by rounding only.
        highest = -float(state.minimum([-state.p.max(initial=0.0)])[0])
        solved = stop(state, residual) or rms <= _ROUNDING * highest * state.operator.diagonal
        history.add(state, self, Update(grid.n, grid.n, 0, residual), 0)
        return Outcome(solved, FULL_CONTACT, 1, residual / state.h_norm, to_rounding=True)

    def _find_allowed(self, inverse, distance, p):
        """Compute the pressure of full contact, and its allowed means. Collective.

        p is set to B (-h), where B is the `inverse` of A (None on ranks without rows). Return the least and the largest
        mean pressure that may be added to p [N/mm2].
        """
        if inverse is not None:
            inverse.apply(distance.b, p)
        least, most = distance.bounds.mean_pressures(p)
        minus_least, most = minimum_over(self.hierarchy.comm, [-least, most]).tolist()
        distance.full_contact_pressures = -minus_least, most
        return distance.full_contact_pressures

    def _is_unlikely(self, mean_pressure):
        """Return whether full contact needs much more than `mean_pressure` on coarser grids. Collective."""
        if not self.level:
            return False
        number = max(self.level - _PROBED_LEVELS, 0)
        operator, distance = self.hierarchy.levels[number], self._distances[number]
        if np.isinf(distance.full_contact_pressures[0]):
            inverse = operator.inverse if operator.active else None
            self._find_allowed(inverse, distance, np.empty(operator.local_shape))
        least, most = distance.full_contact_pressures
        return mean_pressure < _MAX_PRESSURE_FRACTION * least or mean_pressure > most
