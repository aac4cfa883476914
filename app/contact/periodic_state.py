"""The contact state on a periodic patch, where A is singular."""

import numpy as np

from app.contact.state import ContactState

_PATIENCE = 4  # iterations in which the number of changed cells may stagnate


def contact_state(operator, distance, **options):
    """Make a grid's `ContactState`, a `PeriodicState` if periodic. Collective."""
    kind = PeriodicState if operator.is_singular else ContactState
    return kind(operator, distance, **options)


class PeriodicState(ContactState):
    """A `ContactState` on a periodic patch."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.patience = min(_PATIENCE, self.patience)

    def leave_full_contact(self):
        """Remove one cell from C if C has all cells. Collective.

        If all cells are in C, the system (2.11) has no solution, because A is singular. Below full contact the cell
        with the least p - h / A_II becomes open; it has a low pressure or a large gap. Beyond full contact, which is
        possible with a hardness, the cell in which p - h / A_II exceeds H most becomes plastic.
        """
        if not np.isfinite(self.distance.full_depth) or self.sum([self.contact.sum()])[0] < self.grid.n:
            return
        inclination = self._p + self.distance.b / (self.operator.diagonal or 1.0)
        p, beyond = self.values, self.distance.is_beyond_full_contact(self.depth)
        if beyond:
            inclination = self.bounds.upper - inclination
        least = self.minimum([inclination.min(initial=np.inf)])[0]
        np.greater(inclination, least, out=self.contact)
        self.bounds.project(p, self.contact, p)
        if beyond:
            np.copyto(p, self.bounds.upper, where=~self.contact)
        self.compute_displacement()

    def set_load(self, load, present_load):
        """Reach a load [N] by adding a constant to high pressures. Collective.

        High pressures exceed twice the mean change of pressure on C. If less than half of C has such pressures, p and u
        are scaled instead; otherwise u is recomputed. Near full contact a constant hardly changes u, but a factor does.
        If cells may reach the hardness, `ContactState.set_load` is called instead.
        """
        cells = max(self.cells_in_contact(), 1)
        missing = (load - present_load) / self.grid.cell_area
        if self.bounds.capped:
            most = np.maximum(self._p * (load / present_load), self._p + 2 * abs(missing) / cells)
            if self.sum([np.count_nonzero(self.bounds.plastic(most))])[0]:
                return super().set_load(load, present_load)
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
