"""Influence coefficients of an elastic half-space (paper, eqs. (2.4)-(2.6)).

``A_IJ = (1 - nu) / (pi G) * integral over cell J of 1/rho``, rho the distance from the centre of cell I. All cells are
equal, so A_IJ depends only on the offsets between the two cells in x and y. The *quadrant* K contains all values:
``K[j, i]`` is the displacement at an offset of i cells in x and j cells in y from a cell under unit pressure.

========================  ===========================  ==============
paper                     here                         unit
========================  ===========================  ==============
G, nu                     ``Material``                 N/mm2, 1
A_(0,0),(i,j)             ``quadrant[j, i]``           mm / (N/mm2)
(1 - nu) / (pi G)         ``Material.compliance``      mm2/N
========================  ===========================  ==============
"""

import numpy as np

from app.halfspace.love import love_coefficients
from app.halfspace.periodic_symbol import fold_offsets, periodic_quadrant


def quadrant_rows(grid, compliance):
    """Return a function ``rows(slice, columns=None)``, which returns rows of `influence_quadrant`.

    The quadrant of a periodic grid is computed once and stored; it takes a quarter of the memory of a field.
    """
    quadrant = periodic_quadrant(grid, compliance) if grid.periodic else None

    def rows(selected=slice(None), columns=None):
        offsets, count = np.arange(*selected.indices(grid.ny)), grid.nx if columns is None else columns
        if quadrant is None:
            return love_coefficients((grid.dx, grid.dy), compliance, offsets, count)
        return quadrant[np.ix_(fold_offsets(offsets, grid.ny), fold_offsets(np.arange(count), grid.nx))]

    return rows


def influence_quadrant(grid, compliance, rows=slice(None), columns=None):
    """Return influence coefficients at all offsets with non-negative components.

    The slice `rows` selects offsets in y; the offsets in x are 0 to `columns` - 1, by default all. The shape is (rows,
    columns), the unit mm / (N/mm2). On a periodic grid the influence of all images of the cell is included.
    """
    return quadrant_rows(grid, compliance)(rows, columns)


def influence_at(grid, rows, columns):
    """Return influence coefficients of a free patch for unit compliance [mm].

    `rows` and `columns` are arrays of offsets in y and x, from 0 on. The shape is (rows, columns).
    """
    return love_coefficients((grid.dx, grid.dy), 1.0, rows, int(columns.max()) + 1)[:, columns]


def middle_displacement(compliance, lengths):
    """Return the displacement in the middle of a loaded rectangle, (2.4) [mm].

    The pressure is 1 N/mm2; `lengths` are the sides of the rectangle in y and x [mm].
    """
    b, a = (length / 2 for length in lengths)
    return 4 * compliance * (a * np.arcsinh(b / a) + b * np.arcsinh(a / b))


def dense_matrix(grid, compliance):
    """Return A as an array of shape (n, n) for n cells."""
    quadrant = influence_quadrant(grid, compliance)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    dj, di = np.abs(j[:, None] - j), np.abs(i[:, None] - i)
    return quadrant[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)
