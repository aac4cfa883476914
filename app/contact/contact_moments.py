"""Centre of pressure, moments, ellipse and extents of the contact.

These numbers are NaN on a periodic patch. If the patch is periodic in one direction, one coordinate of the centre of
pressure, one moment and one extent are known.
"""

from math import atan2, degrees, hypot, nan, sqrt
from typing import NamedTuple

import numpy as np

from app.base.numba_cache import njit
from app.parallel.reductions import njit_reassoc, sums_and_minima


class ContactMoments(NamedTuple):
    """Moments of pressure and contact set."""

    pressure_centre_x: float  # sum(p x) / sum(p) [mm]
    pressure_centre_y: float
    moment_x: float  # first moments of the pressure: integral of p x [N mm]
    moment_y: float  # integral of p y
    semi_axis_major: float  # semi-axis of the ellipse with the second moments of the contact set [mm]
    semi_axis_minor: float
    major_axis_angle: float  # angle from the x axis, above -90 and at most 90 [degree]
    contact_extent_x: float  # from the first to the last column of cells with contact [mm]
    contact_extent_y: float

    @property
    def width(self):
        """Smaller extent of the contact [mm]; NaN if unknown."""
        return float(np.fmin(self.contact_extent_x, self.contact_extent_y))


_NOWHERE = ContactMoments(*[nan] * 9)


def measure_moments(state):
    """Return the `ContactMoments` of a `Pressed`. Collective.

    The semi-axes of the ellipse are 2 sqrt(m / area), with the principal second moments m of the contact area. The
    second moments of each cell about its own centre are included.
    """
    grid, rows = state.grid, state.operator.slabs.rows
    if grid.doubly_periodic:
        return _NOWHERE
    # Relative to the middle of the patch, which may be far from the origin.
    x, y = grid.x0 + grid.sides[0] / 2, grid.y0 + grid.sides[1] / 2
    sums, box = np.zeros(9), np.array([grid.nx, grid.ny, -1, -1])
    _moments(state.p, state.in_contact(), grid.x() - x, grid.y(rows) - y, sums, box, rows.start)
    sums, (left, lower, right, upper) = sums_and_minima(state.comm, sums, [*box[:2], *-box[2:]])
    sums = sums.tolist()
    load, at_x, at_y, cells, sx, sy, sxx, syy, sxy = sums
    centre = (x + at_x / load, y + at_y / load) if load > 0 else (nan, nan)
    moments = grid.cell_area * (at_x + load * x), grid.cell_area * (at_y + load * y)
    across, up = (
        (1 - right - left) * grid.dx if cells else nan,
        (1 - upper - lower) * grid.dy if cells else nan,
    )
    if grid.one_way == "x":
        return _NOWHERE._replace(pressure_centre_y=centre[1], moment_y=moments[1], contact_extent_y=up)
    if grid.one_way == "y":
        return _NOWHERE._replace(pressure_centre_x=centre[0], moment_x=moments[0], contact_extent_x=across)
    if not cells:
        return _NOWHERE._replace(moment_x=moments[0], moment_y=moments[1])
    mx, my = sx / cells, sy / cells
    xx, yy = sxx / cells - mx * mx + grid.dx**2 / 12, syy / cells - my * my + grid.dy**2 / 12
    xy = sxy / cells - mx * my
    # Mohr's circle gives mean and half difference of the principal moments.
    mean, half = (xx + yy) / 2, hypot((xx - yy) / 2, xy)
    low, high = max(mean - half, 0.0), mean + half
    angle = degrees(atan2(2 * xy, xx - yy) / 2) if 2 * half > 1e-9 * high else 0.0
    angle = 90.0 if angle == -90 else angle
    return ContactMoments(*centre, *moments, 2 * sqrt(high), 2 * sqrt(low), angle, across, up)


@njit_reassoc
def _moments_row(p, contact, x):
    load, at_x, cells, sx, sxx = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(x.size):
        load += p[i]
        at_x += p[i] * x[i]
        inside = x[i] if contact[i] else 0.0
        cells += 1.0 if contact[i] else 0.0
        sx += inside
        sxx += inside * inside
    return load, at_x, cells, sx, sxx


@njit()
def _moments(p, contact, x, y, sums, box, start):
    """Add the contributions of a slab's cells to sums for the moments, and extend the box of cells in contact.

    The `box` has the first column and row, and the last ones. `start` is the first row of the slab.
    """
    for j in range(y.size):
        load, at_x, cells, sx, sxx = _moments_row(p[j], contact[j], x)
        row = load, at_x, load * y[j], cells, sx, cells * y[j], sxx, cells * y[j] ** 2, sx * y[j]
        for k in range(9):
            sums[k] += row[k]
        if cells:
            box[1], box[3] = min(box[1], start + j), start + j
            i = 0
            while i < box[0] and not contact[j, i]:
                i += 1
            box[0] = i
            i = x.size - 1
            while i > box[2] and not contact[j, i]:
                i -= 1
            box[2] = i
