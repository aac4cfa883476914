"""Part of the patch that a map shows: small contacts are enlarged."""

from __future__ import annotations

import numpy as np
from matplotlib.patches import Rectangle

MARGIN = 0.25  # of the contact's extent, shown on each side
MAX_SHARE = 0.5  # of the patch; larger views show the whole patch
_SIDE, _MIN_SIDE = 0.2, 0.4  # of the inset: over the shorter side of the map; [inch]
_MIN_TITLED_SIDE = 0.5  # of an inset with a title [inch]


def find_view(result):
    """Return the slices of rows and of columns that a map shows.

    The map shows the part around the contact; the whole patch if the contact is not small, or the patch is periodic.
    """
    contact = np.asarray(result.contact)
    whole = slice(0, contact.shape[0]), slice(0, contact.shape[1])
    if not contact.any() or result.grid.periodic:
        return whole
    view = []
    for axis in (1, 0):  # cells of a row, then of a column
        cells = np.flatnonzero(contact.any(axis=axis))
        margin = int(np.ceil(MARGIN * (cells[-1] + 1 - cells[0]))) + 1
        view.append(slice(max(cells[0] - margin, 0), min(cells[-1] + 1 + margin, contact.shape[1 - axis])))
    rows, columns = view
    shown = (rows.stop - rows.start) * (columns.stop - columns.start)
    return (rows, columns) if shown <= MAX_SHARE * contact.size else whole


def draw_inset(axes, size, patch, view):
    """Draw an inset of the whole patch, with the view's outline.

    The inset is transparent, in the lower left corner, which is usually outside the contact. `size` is width and height
    of the map [inch]. `patch` and `view` are x0, x1, y0, y1.
    """
    side = max(_SIDE * min(size), _MIN_SIDE)
    inset = axes.inset_axes([0, 0, side / size[0], side / size[1]], facecolor="none")
    inset.set(xlim=patch[:2], ylim=patch[2:], xticks=[], yticks=[])
    for spine in inset.spines.values():
        spine.set_visible(True)
    x0, x1, y0, y1 = view
    inset.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="0.35", edgecolor="0.35"))
    if side >= _MIN_TITLED_SIDE:
        inset.set_title("patch", fontsize="x-small", pad=1)
    return inset
