"""Where the load and the contact are: centre of pressure, moments, ellipse of the contact.

On a periodic patch there is no origin to count from: these numbers are NaN there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.compiled import njit
from app.halfspace.reductions import any_order


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
    load, at_x, at_y, cells, sx, sy, sxx, syy, sxy = state.sum(_moments(state.p, state.contact, x, y))
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


@any_order
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
def _moments(p, contact, x, y):
    """Sums of p, p x, p y, and over C of 1, x, y, x x, y y, x y."""
    sums = np.zeros(9)
    for j in range(y.size):
        load, at_x, cells, sx, sxx = _moments_row(p[j], contact[j], x)
        row = load, at_x, load * y[j], cells, sx, cells * y[j], sxx, cells * y[j] ** 2, sx * y[j]
        for k in range(9):
            sums[k] += row[k]
    return sums


def warm_up():
    """Load the compiled loops now, not after the first solve. Not collective."""
    fixed, mask = np.zeros((0, 0)), np.zeros((0, 0), bool)
    fixed.flags.writeable = False
    _moments(fixed, mask, np.zeros(0), np.zeros(0))
