"""Full contact: where a periodic patch without holes is in contact everywhere, the answer costs two products.

With all gaps closed u is the negative undeformed distance but for its mean, so ``p = mean pressure + B (-h)``, B the
inverse of A on fields without mean. If the bounds allow this p it solves (2.8)-(2.10), and the approach is the mean
undeformed distance. Means over cells are smoother than what is in them, and mostly ask for less pressure: where a
coarser grid is far from full contact, it is not tried before anything else, but afterwards, if the iteration finds no
cell free, or no answer.
"""

from __future__ import annotations

import numpy as np

from app.contact.history import Outcome
from app.contact.state import Update
from app.parallel.reductions import minimum_over

FULL_CONTACT = "contact everywhere"
_ROUNDING = 1e-12  # of what the highest pressure displaces a cell by
_PROBED = 2  # grids between the target and the one that is asked first ...
_FAR = 0.5  # ... and believed, if so much of the mean pressure that it needs is not there


class FullContact:
    """Solves with all cells in contact, if that is the answer; in place of a linear solver in the history.

    Parameters
    ----------
    hierarchy : Hierarchy
    distances : list of UndeformedDistance
        On every level.

    Attributes
    ----------
    postponed : bool
        Not tried, on a coarser grid's word.
    """

    work_units, postponed = 0.0, False

    def __init__(self, hierarchy, distances):
        self.hierarchy, self._distances, self.level = hierarchy, distances, len(distances) - 1

    def solve(self, state, loading, stop, history):
        """Set pressure, displacement and approach of `state`, if contact is full.

        Collective over all ranks. At most one product and one with the inverse. At the approach of full contact the
        mean pressure is the least possible.

        Parameters
        ----------
        state : ContactState
        loading : Loading
        stop : StoppingTest
        history : History

        Returns
        -------
        Outcome or None
            None if contact is not full; `state` may be thrown away then.
        """
        grid, distance = state.grid, state.distance
        wanted = loading.mean_pressure_on(grid)
        if not (state.highest < np.inf and loading.depth_on(distance) >= state.highest):
            return None
        prescribed, (least, most) = wanted < np.inf, distance.full_contact_pressures
        if prescribed and not least <= wanted <= most:
            return None
        if prescribed and np.isinf(least) and not self.postponed:
            self.postponed = self._far(wanted)
            if self.postponed:
                return None
        p = state.values
        least, most = self._find_allowed(state.operator.exact_inverse, distance, p)
        wanted = wanted if prescribed else max(least, 0.0)
        if not least <= wanted <= most:
            return None
        p += wanted
        state.project()
        history.start(state, self)
        state.contact[...] = True
        mean = distance.statistics.mean
        distance.move_to(mean, neglected_gap=max(mean - loading.depth_on(distance), 0.0))
        state.compute_displacement(exact=True)
        rms = state.on_contact_or_overlap().rms
        residual = np.sqrt(grid.n) * rms
        # Heights may differ by rounding only, which is no measure of what is left.
        highest = -float(state.minimum([-state.p.max(initial=0.0)])[0])
        solved = stop(state, residual) or rms <= _ROUNDING * highest * state.operator.diagonal
        history.add(state, self, Update(grid.n, grid.n, 0, residual), 0)
        return Outcome(solved, FULL_CONTACT, 1, residual / distance.norm(), to_rounding=True)

    def _find_allowed(self, inverse, distance, p):
        """Find the mean pressures of full contact on a grid; p becomes B (-h). Collective over all ranks."""
        if inverse is not None:
            inverse.apply(distance.b, p)
        least, most = distance.bounds.mean_pressures(p)
        minus_least, most = minimum_over(self.hierarchy.comm, [-least, most]).tolist()
        distance.full_contact_pressures = -minus_least, most
        return distance.full_contact_pressures

    def _far(self, wanted):
        """Whether a coarser grid, if there is one, is far from full contact under a mean pressure. Collective."""
        if not self.level:
            return False
        number = max(self.level - _PROBED, 0)
        operator, distance = self.hierarchy.levels[number], self._distances[number]
        if np.isinf(distance.full_contact_pressures[0]):
            inverse = operator.inverse if operator.active else None
            self._find_allowed(inverse, distance, np.empty(operator.local_shape))
        return wanted < _FAR * distance.full_contact_pressures[0]
