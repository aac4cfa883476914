"""Kernel of the bodies: surface displacement by a pressure.

Products, sweeps, preconditioners and the certificate get all numbers that depend on the elasticity of the bodies from a
kernel. So another kind of body needs only another kernel. `Material.kernel` makes the kernel of a material.
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
        True if, in units of a cell, the displacement by short waves does not depend on the size of cells. Then all
        grids share stencils.
    far_reaching : bool
        True if, far from a load, the displacement is proportional to the load divided by the distance.
    encloses_images : bool
        True if coefficients contain the images of a load in a direction in which the patch repeats.
    """

    scale_free = far_reaching = True
    encloses_images = False
    film = None  # see `LayeredKernel.film`
    layers = ()  # the Layers of the bodies

    def __init__(self, compliance):
        self.compliance = float(compliance)

    def period_cells(self, grid):
        """Return the periods of coefficients in y and x [cells], 0 without a period."""
        return 0, 0

    @property
    def base(self):
        """Kernel without the images of a load."""
        return self

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return (self.compliance,)

    def __eq__(self, other):
        return type(self) is type(other) and self.parameters == other.parameters

    def __hash__(self):
        return hash((type(self), self.parameters))

    def in_units(self, length):
        """Return the kernel for lengths in units of `length` [mm], and compliance 1.

        Influence coefficients are divided by this kernel's compliance and by `length`.
        """
        return UNIT

    def uniform_compliance(self, grid):
        """Return the displacement by pressure 1 on all cells [mm / (N/mm2)].

        The patch is periodic. A p is relative to its mean, and does not include this displacement. For half-spaces,
        where it would be infinite, the result is 0.
        """
        return 0.0

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

    def self_displacement(self, grid):
        """Return a free cell's displacement by pressure 1 on it [mm / (N/mm2)]."""
        return float(self.coefficients(grid, np.arange(1), 1)[0, 0])

    def scale(self, eigenvalues, q):
        """Return eigenvalues for unit compliance times the compliance at `q` [1/mm]."""
        return self.compliance * eigenvalues

    def scale_sampled(self, eigenvalues, grid, columns, rows):
        """Return eigenvalues for the compliance of this kernel.

        In contrast to `scale`, each aliased wave has its own compliance. `eigenvalues` are for unit compliance and
        uniform pressures on cells, at frequencies `columns` and `rows`, as in `influence_symbol`.
        """
        return self.compliance * eigenvalues

    def is_positive(self, grid):
        """Return whether no influence coefficient of a free patch is negative."""
        return True

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of the eigenvalues of A [mm / (N/mm2)].

        The constant field of a periodic patch is left out. The bound is the eigenvalue of the shortest wave, also on a
        free patch, because constant pressures on cells displace their centres by 1.17 (long cells) to 1.4 times as much
        as this wave.
        """
        return 2 * self.compliance / np.hypot(1 / grid.dx, 1 / grid.dy)

    def largest_eigenvalue(self, grid):
        """Return a periodic patch's largest eigenvalue of A [mm / (N/mm2)]."""
        return self.compliance * max(grid.sides)

    def softest_parts(self, length):
        """Return an estimate of a displacement, and an upper bound of a compliance.

        The displacement [mm / (N/mm2)] is for layers on a rigid base, by pressure 1 in waves twice the `length` long;
        shorter waves may displace nearly incompressible layers more. The compliance [mm2/N] is for half-spaces; a
        layered body counts as a half-space of its softer material.
        """
        return 0.0, self.compliance

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded rectangle, (2.4) [mm].

        The pressure is 1 N/mm2; `lengths` are the sides of the rectangle in y and x [mm].
        """
        b, a = lengths[0] / 2, lengths[1] / 2
        return 4 * self.compliance * (a * np.arcsinh(b / a) + b * np.arcsinh(a / b))

    def punch_stiffness(self, area):
        """Return the stiffness [N/mm] of a round flat punch with an end `area` [mm2]."""
        return 2 / (np.pi * self.compliance) * np.sqrt(area / np.pi)

    def contrast(self, grid):
        """Return how much softer the bodies are for long waves than for short ones.

        This is the compliance for the longest waves on a grid over that for the shortest ones, at least 1. It exceeds 1
        if a layer is stiffer than its substrate.
        """
        return 1.0

    def is_thin_film(self, grid):
        """Return whether long waves displace the bodies much less than shorter ones.

        This is true of thin, nearly incompressible layers on a rigid base. Then the inverse of A is not nearly local.
        """
        return False

    def is_resolved(self, grid):
        """Return whether the cells of a grid resolve the layer."""
        return True

    def compliance_at(self, length):
        """Return 1 / E* [mm2/N] for waves of a `length` [mm]."""
        return np.pi * self.compliance


UNIT = HalfSpaceKernel(1.0)
