"""Full contact: where a periodic patch without holes is in contact everywhere, the answer costs two products.

With all gaps closed u is the negative undeformed distance but for its mean, so ``p = mean pressure + B (-h)``, B the
inverse of A on fields without mean. If p >= 0 that solves (2.8)-(2.10), and the approach is the mean undeformed
distance.
"""

from __future__ import annotations

import numpy as np

from app.contact.history import Outcome
from app.contact.state import Update

FULL_CONTACT = "contact everywhere"
_ROUNDING = 1e-12  # of what the highest pressure displaces a cell by


class FullContact:
    """Solves with all cells in contact, if that is the answer; in place of a linear solver in the history.

    Parameters
    ----------
    level : int
        Number of the target grid.
    """

    work_units = 0.0

    def __init__(self, level):
        self.level = level

    def solve(self, state, loading, stop, history):
        """Set pressure, displacement and approach of `state`, if contact is full.

        Collective. At most one product and one with the inverse. At the approach of full contact the mean pressure is
        the least possible.

        Parameters
        ----------
        state : ContactState
        loading : PrescribedApproach or PrescribedLoad
        stop : StoppingTest
        history : History

        Returns
        -------
        Outcome or None
            None if contact is not full; `state` may be thrown away then.
        """
        grid, distance = state.grid, state.distance
        wanted = loading.load / (grid.cell_area * grid.n) if loading.prescribes_load else None
        if not self._possible(state, loading, wanted):
            return None
        with state.pressure as values:
            p = values.reshape(state.u.shape)
            state.operator.inverse_product.apply(distance.b, p)
            least = distance.least_mean_pressure = -float(state.minimum([p.min(initial=np.inf)])[0])
            if wanted is not None and wanted < least:
                return None
            p += max(least, 0.0) if wanted is None else wanted
            np.maximum(p, 0.0, out=p)
        history.start(state, self)
        before = int(state.sum([np.count_nonzero(state.contact)])[0])
        state.contact[...] = True
        distance.move_to(distance.statistics.mean)
        state.compute_displacement(exact=True)
        rms = state.gap_on_contact()[0]
        residual = np.sqrt(grid.n) * rms
        # Heights may differ by rounding only, which is no measure of what is left.
        highest = -float(state.minimum([-state.p.max(initial=0.0)])[0])
        solved = stop(state, residual) or rms <= _ROUNDING * highest * state.operator.diagonal
        history.add(state, self, Update(grid.n, grid.n - before, 0, residual), 0)
        return Outcome(solved, FULL_CONTACT, 1, residual / distance.norm())

    @staticmethod
    def _possible(state, loading, wanted):
        """Whether anything speaks for full contact. Not collective."""
        if not np.isfinite(state.highest):
            return False
        if wanted is None:
            return loading.approach - state.distance.reference >= state.highest
        return wanted >= state.distance.least_mean_pressure
