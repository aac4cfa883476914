"""Where the load and the contact are: centre of pressure, moments, ellipse of the contact.

On a periodic patch there is no origin to count from: these numbers are NaN there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class ContactExtent(NamedTuple):
    """Of a solution on a free patch, NaN on a periodic one; the same on all ranks."""

    pressure_centre_x: float  # sum(p x) / sum(p) [mm]
    pressure_centre_y: float
    moment_x: float  # of the pressure about the axes through the origin: integral of p y [N mm]
    moment_y: float  # integral of -p x
    semi_axis_major: float  # of the ellipse with the second moments of the contact set [mm]
    semi_axis_minor: float
    major_axis_angle: float  # from the x axis, above -90 to 90 [degree]


_NOWHERE = ContactExtent(*[float("nan")] * 7)


def measure_extent(state):
    """Measure a `ContactState` of all cells of a grid. Collective; one pass over pressure and contact set.

    The semi-axes of an ellipse are twice the roots of its principal second moments over its area; those of the cells
    count in.

    Returns
    -------
    ContactExtent
    """
    grid, rows = state.grid, state.operator.slabs.rows
    if grid.periodic:
        return _NOWHERE
    x, y = grid.x(), grid.y(rows)
    px, py = state.p.sum(axis=0), state.p.sum(axis=1)
    cx, cy = np.count_nonzero(state.contact, axis=0), np.count_nonzero(state.contact, axis=1)
    cross = np.array([x[row].sum() for row in state.contact])
    load, at_x, at_y, cells, sx, sy, sxx, syy, sxy = state.sum(
        [px.sum(), px @ x, py @ y, cx.sum(), cx @ x, cy @ y, cx @ x**2, cy @ y**2, cross @ y]
    )
    force = grid.cell_area * np.array([load, at_x, at_y])
    centre = force[1:] / load / grid.cell_area if load > 0 else (np.nan, np.nan)
    if not cells:
        return _NOWHERE._replace(moment_x=float(force[2]), moment_y=float(-force[1]))
    mean = np.array([sx, sy]) / cells
    second = np.array([[sxx, sxy], [sxy, syy]]) / cells - np.outer(mean, mean)
    second += np.diag([grid.dx**2, grid.dy**2]) / 12
    (low, high), axes = np.linalg.eigh(second)
    along = axes[:, 1] if high - low > 1e-9 * high else (1.0, 0.0)
    angle = np.degrees(np.arctan2(along[1], along[0]))
    angle -= 180 * np.ceil((angle - 90) / 180)
    return ContactExtent(
        *map(float, (*centre, force[2], -force[1], 2 * np.sqrt(high), 2 * np.sqrt(low), angle))
    )
