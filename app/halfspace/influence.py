"""Influence coefficients of an elastic half-space (paper, eqs. (2.4)-(2.6)).

``A_IJ = (1 - nu) / (pi G) * integral over cell J of 1/rho``, rho the distance from the centre of cell I. All cells are
equal, so A_IJ depends only on the offsets between the two cells in x and y. The *quadrant* K contains all values:
``K[j, i]`` is the displacement at an offset of i cells in x and j cells in y from a cell under unit pressure.

========================  ===========================  ==============
paper                     here                         unit
========================  ===========================  ==============
G, nu                     ``Material``                 N/mm2, 1
A_(0,0),(i,j)             ``quadrant[j, i]``           mm / (N/mm2)
(1 - nu) / (pi G)         ``kernel.compliance``        mm2/N
========================  ===========================  ==============
"""

import numpy as np

from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.periodic_symbol import fold_offsets, periodic_quadrant


def quadrant_rows(grid, kernel):
    """Return a function ``rows(slice, columns=None)`` for rows of `influence_quadrant`.

    The quadrant of a periodic grid is computed once and stored; it takes a quarter of the memory of a field.
    """
    kernel = patch_kernel(kernel, grid)
    quadrant = periodic_quadrant(grid, kernel) if grid.doubly_periodic else None

    def rows(selected=slice(None), columns=None):
        offsets, count = np.arange(*selected.indices(grid.ny)), grid.nx if columns is None else columns
        if quadrant is None:
            return kernel.coefficients(grid, offsets, count)
        return quadrant[np.ix_(fold_offsets(offsets, grid.ny), fold_offsets(np.arange(count), grid.nx))]

    return rows


def influence_quadrant(grid, kernel, rows=slice(None), columns=None):
    """Return influence coefficients at all offsets with non-negative components.

    The slice `rows` selects offsets in y; the offsets in x are 0 to `columns` - 1, by default all. The shape is (rows,
    columns), the unit mm / (N/mm2). On a periodic grid the influence of all images of the cell is included.
    """
    return quadrant_rows(grid, kernel)(rows, columns)


def dense_matrix(grid, kernel):
    """Return A as an array of shape (n, n) for n cells."""
    quadrant = influence_quadrant(grid, kernel)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    dj, di = np.abs(j[:, None] - j), np.abs(i[:, None] - i)
    return quadrant[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)
