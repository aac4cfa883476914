"""What a user should look at twice in a solution that solves the problem as it was given."""

from __future__ import annotations

import numpy as np


def notes_on(state):
    """Say in a line each what a user should look at twice. Collective."""
    if not state.grid.periodic and _touches_rim(state):
        what = "contact reaches" if state.in_contact() else "the smallest distance is found at"
        return [f"{what} the rim of the patch: enlarge the domain if the bodies go on beyond it"]
    return []


def _touches_rim(state):
    """Whether a cell on the rim of the patch is in contact, or is nearest to it if there is none. Collective."""
    if state.in_contact():
        cells = state.contact
    else:
        b = np.where(state.admissible, state.distance.b, -np.inf)
        cells = -b == float(state.minimum(-b.max(initial=-np.inf)))
    rows = state.operator.slabs.rows
    touches = cells[:, [0, -1]].any()
    if cells.size:
        touches |= rows.start == 0 and cells[0].any()
        touches |= rows.stop == state.grid.ny and cells[-1].any()
    return state.sum([touches])[0] > 0
