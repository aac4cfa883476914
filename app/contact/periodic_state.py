"""The contact state on a periodic patch, where A is singular on all cells and contact sets may cycle."""

from __future__ import annotations

import numpy as np

from app.contact.state import ContactState

_MEAN_GAP_ROUNDING = 1e-15  # of the mean distance: least mean gap below full contact
_MIN_SEARCHED_GAP = 1e-10  # of the mean distance: least mean gap in the search for a load
_PATIENCE = 4  # iterations in which the number of changed cells may stagnate


def contact_state(operator, distance, **options):
    """Return a `ContactState` of the kind that the grid needs; parameters as there. Collective."""
    kind = PeriodicState if operator.grid.periodic else ContactState
    return kind(operator, distance, **options)


class PeriodicState(ContactState):
    """A `ContactState` of a periodic patch.

    Without holes mean(gap) = mean(undeformed distance) - approach. Where it is zero contact is full at any load; a
    coarse grid may get there before the target does.
    """

    _fewest_changed, _stagnating, _tensile = float("inf"), 0, 0

    @property
    def highest(self):
        """See `ContactState`. Not collective."""
        cells, mean, *_ = self.distance.statistics
        return np.inf if cells < self.grid.n else mean - _MEAN_GAP_ROUNDING * abs(mean)

    @property
    def highest_searched(self):
        """See `ContactState`. Not collective."""
        highest = self.highest
        return highest - _MIN_SEARCHED_GAP * abs(highest) if highest < np.inf else highest

    def begin(self):
        """See `ContactState.begin`."""
        self._fewest_changed, self._stagnating, self._tensile = float("inf"), 0, 0

    def keep_solvable(self):
        """Open the cell that is most inclined to, if all are in contact: A is singular there. Collective."""
        if not np.isfinite(self.highest) or self.cells_in_contact() < self.grid.n:
            return
        tends = self._p + self.distance.b / (self.operator.diagonal or 1.0)
        least = self.minimum([tends.min(initial=np.inf)])[0]
        np.greater(tends, least, out=self.contact)
        self.bounds.project(self.p, self.contact, self.values)
        self.compute_displacement()

    def release_tensile(self, *args, **options):
        """See `ContactState.release_tensile`."""
        self._tensile = super().release_tensile(*args, **options)
        return self._tensile

    def activate_penetrating(self, expected=None):
        """See `ContactState.activate_penetrating`. Collective.

        Near full contact the sets may cycle. If the number of changed cells stagnates, cells enter only if none have
        left, as in Kalker's own NORM.
        """
        if self._tensile and self._stagnating >= _PATIENCE:
            expected = np.full(self.u.shape, np.inf)
        update, self._tensile = super().activate_penetrating(expected), 0
        self._stagnating = 0 if update.changed < self._fewest_changed else self._stagnating + 1
        self._fewest_changed = min(self._fewest_changed, update.changed)
        return update

    def set_load(self, load, carried):
        """Add a constant to p on C, except in cells with next to no pressure; u = A p. Collective.

        The more of the patch is in contact, the less a constant displaces. A factor would displace everything.
        """
        cells = max(self.cells_in_contact(), 1)
        lacks = (load - carried) / self.grid.cell_area
        inside = self._p > 2 * abs(lacks) / cells
        cells_inside = self.sum([np.count_nonzero(inside)])[0]
        if 2 * cells_inside < cells:
            return self.scale(load / carried)
        p = self.values
        p += inside * (lacks / cells_inside)
        if not (left := self.load) > 0:
            return self.distribute_load(load)
        p *= load / left  # where nearly all is taken off, the rest has few digits
        return self.compute_displacement()
