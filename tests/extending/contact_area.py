"""Loading ``contact_area``: the area in contact [mm2], met as nearly as whole cells allow."""

import numpy as np

from app import InputError
from app.contact.approach_search import SearchedLoading
from app.contact.loading_input import LOADINGS


class PrescribedContactArea(SearchedLoading):
    """Prescribed contact area, on patches that are not periodic in x and y."""

    name = kind = "contact_area"
    unit, meaning = "mm2", "area in contact"
    is_geometric = True  # also with a background pressure and in creep
    result_rtol = 0.1  # several cells come into contact at once

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        """Return the loading; the area is that of one cell at least, and less than that of all cells."""
        least, most = grid.cell_area, distance.statistics.cells * grid.cell_area
        if not least <= value < most:
            raise InputError(
                f"contact_area {value:g}: must be from {least:g} mm2, a cell, to below {most:g} mm2"
            )
        return cls(value)

    def measure(self, state):
        """Return the area of the cells in contact [mm2]. Collective."""
        return state.grid.cell_area * float(state.sum([np.count_nonzero(state.in_contact())])[0])

    def resolution(self, grid):
        """Return half a cell over the area."""
        return 0.5 * grid.cell_area / self.target


LOADINGS[PrescribedContactArea.name] = PrescribedContactArea

if __name__ == "__main__":  # python contact_area.py: app.solve with this loading
    from app.cli import session, solve

    session.run(solve.main)
