"""Kernel of the elastic bodies: displacement of the surface by a pressure on it.

A kernel has all that products, sweeps, preconditioners and the certificate need of the bodies. `Material.kernel` makes
it. Numbers that depend on the bodies' elasticity come from here, so that another kind of body is another kernel.
"""

import numpy as np

from app.halfspace.love import love_coefficients
from app.halfspace.periodic_symbol import influence_symbol


class HalfSpaceKernel:
    """Kernel of two elastic half-spaces (paper, eqs. (2.4)-(2.6)).

    A point force displaces the surface at a distance by compliance times force divided by distance.

    Parameters
    ----------
    compliance : float
        (1 - nu) / (pi G) = 1 / (pi E*) [mm2/N].

    Attributes
    ----------
    scale_free : bool
        In units of a cell, coefficients do not depend on the size of cells. So grids of all sizes share stencils.
    """

    scale_free = True

    def __init__(self, compliance):
        self.compliance = float(compliance)

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return (self.compliance,)

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix; see `influence_symbol`."""
        return influence_symbol(grid, self.compliance, columns, rows)

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch; see `love_coefficients`."""
        return love_coefficients((grid.dx, grid.dy), self.compliance, rows, columns)

    def unit_coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch for unit compliance [mm].

        `rows` and `columns` are arrays of offsets in y and x, from 0 on. The shape is (rows, columns).
        """
        return love_coefficients((grid.dx, grid.dy), 1.0, rows, int(columns.max()) + 1)[:, columns]

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of the eigenvalues of A on fields without mean [mm / (N/mm2)].

        It is that of the shortest wave, also on a free patch: constant pressures on cells displace their centres by
        1.17 (long cells) to 1.4 times as much as this wave.
        """
        return 2 * self.compliance / np.hypot(1 / grid.dx, 1 / grid.dy)

    def largest_eigenvalue(self, grid):
        """Return the largest eigenvalue of A on a periodic patch [mm / (N/mm2)]."""
        return self.compliance * max(grid.nx * grid.dx, grid.ny * grid.dy)

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded rectangle, (2.4) [mm].

        The pressure is 1 N/mm2; `lengths` are the sides of the rectangle in y and x [mm].
        """
        b, a = lengths[0] / 2, lengths[1] / 2
        return 4 * self.compliance * (a * np.arcsinh(b / a) + b * np.arcsinh(a / b))

    def punch_stiffness(self, area):
        """Return the stiffness of a round flat punch of an area [mm2] in N/mm."""
        return 2 / (np.pi * self.compliance) * np.sqrt(area / np.pi)

    def compliance_at(self, length):
        """Return 1 / E* of waves of a length [mm] in mm2/N."""
        return np.pi * self.compliance


UNIT = HalfSpaceKernel(1.0)
