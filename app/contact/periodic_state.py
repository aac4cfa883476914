"""The contact state on a periodic patch, where A is singular."""

import numpy as np

from app.contact.state import ContactState

_PATIENCE = 4  # iterations in which the number of changed cells may stagnate


def contact_state(operator, distance, **options):
    """Make the `ContactState` for a grid, periodic or not; see there. Collective."""
    kind = PeriodicState if operator.grid.periodic else ContactState
    return kind(operator, distance, **options)


class PeriodicState(ContactState):
    """A `ContactState` of a periodic patch."""

    _fewest_changed, _stagnating, _tensile = float("inf"), 0, 0

    def before_iteration(self, k):
        """Open a cell if all are in contact below full contact. Collective.

        Otherwise (2.11) could not be solved. It is the cell with the least pressure or the largest gap.
        """
        if k == 1:
            self._fewest_changed, self._stagnating, self._tensile = float("inf"), 0, 0
        if not np.isfinite(self.distance.max_depth) or self.cells_in_contact() < self.grid.n:
            return
        inclination = self._p + self.distance.b / (self.operator.diagonal or 1.0)
        least = self.minimum([inclination.min(initial=np.inf)])[0]
        np.greater(inclination, least, out=self.contact)
        self.bounds.project(self.p, self.contact, self.values)
        self.compute_displacement()

    def release_tensile(self, *args, **options):
        """See `ContactState.release_tensile`."""
        self._tensile = super().release_tensile(*args, **options)
        return self._tensile

    def activate_penetrating(self, expected=None):
        """See `ContactState.activate_penetrating`.

        Contact sets may cycle near full contact. If the number of changed cells stagnates, cells enter only if none
        have left, as in Kalker's NORM.
        """
        if self._tensile and self._stagnating >= _PATIENCE:
            expected = np.full(self.u.shape, np.inf)
        update, self._tensile = super().activate_penetrating(expected), 0
        self._stagnating = 0 if update.changed < self._fewest_changed else self._stagnating + 1
        self._fewest_changed = min(self._fewest_changed, update.changed)
        return update

    def set_load(self, load, present_load):
        """Add a constant to high pressures; compute u. Collective.

        Near full contact a constant hardly displaces anything, a factor would displace everything.
        """
        cells = max(self.cells_in_contact(), 1)
        missing = (load - present_load) / self.grid.cell_area
        inside = self._p > 2 * abs(missing) / cells
        cells_inside = self.sum([np.count_nonzero(inside)])[0]
        if 2 * cells_inside < cells:
            return self.scale(load / present_load)
        p = self.values
        p += inside * (missing / cells_inside)
        if not (remaining := self.load) > 0:
            return self.distribute_load(load)
        p *= load / remaining  # the sum has few digits if nearly all pressure was subtracted
        return self.compute_displacement()
