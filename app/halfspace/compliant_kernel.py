"""Kernel of bodies with a compliant surface.

A pressure p also displaces each cell by c p, with the surface compliance c: the matrix is A + c. A thin soft layer on
stiffer bodies acts like this (Winkler 1867), and so does wear in a step of implicit time integration.
"""

import numpy as np

from app.halfspace.kernel import Kernel


class CompliantKernel(Kernel):
    """Kernel of bodies whose surface has a compliance of its own.

    Parameters
    ----------
    base : Kernel
        Kernel of the bodies on the patch.
    surface_compliance : float
        Displacement c by pressure 1 [mm / (N/mm2)], positive.
    """

    base = None
    _SAME = "layers", "film", "isotropic", "far_reaching", "encloses_images", "has_love_symbol"
    _METHODS = "check_patch", "period_cells", "is_resolved", "is_positive"

    def __init__(self, base, surface_compliance):
        super().__init__(base.compliance)
        self.bodies, self.surface_compliance = base, float(surface_compliance)
        self.base = base.base
        for name in (*self._SAME, *self._METHODS):
            setattr(self, name, getattr(base, name))

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return *self.bodies.parameters, self.surface_compliance

    def __eq__(self, other):
        return super().__eq__(other) and self.bodies == other.bodies

    def __hash__(self):
        return hash((self.bodies, self.surface_compliance))

    def describe(self):
        """Return names and values for result files."""
        return {}

    def in_units(self, length):
        """Return the kernel in other units; see `Kernel.in_units`."""
        return CompliantKernel(
            self.bodies.in_units(length), self.surface_compliance / (self.compliance * length)
        )

    def wave_compliance(self, qx, qy=0.0):
        """Return the compliance for waves, with that of the surface."""
        return self.bodies.wave_compliance(qx, qy) + self.surface_compliance / (2 * np.pi) * np.hypot(qx, qy)

    def unit_coefficients(self, grid, rows, columns):
        """Return coefficients for unit compliance; see `Kernel.unit_coefficients`."""
        coefficients = np.array(self.bodies.unit_coefficients(grid, rows, columns))
        in_y, in_x = (
            offsets % period == 0 if period else offsets == 0  # of a cell to itself, or to its copies
            for offsets, period in zip(map(np.asarray, (rows, columns)), self.period_cells(grid), strict=True)
        )
        return coefficients + np.outer(in_y, in_x) * (self.surface_compliance / self.compliance)

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix, 0 for the constant."""
        values = np.array(self.bodies.eigenvalues(grid, columns, rows))
        waves = (np.asarray(columns)[:, None] != 0) | (np.asarray(rows) != 0)
        return values + self.surface_compliance * waves

    def scale(self, eigenvalues, qx, qy):
        """Return eigenvalues for this compliance; see `Kernel.scale`."""
        return self.bodies.scale(eigenvalues, qx, qy) + self.surface_compliance

    def scale_sampled(self, eigenvalues, grid, columns, rows):
        """Return eigenvalues for this compliance; see `Kernel.scale_sampled`."""
        return self.bodies.scale_sampled(eigenvalues, grid, columns, rows) + self.surface_compliance

    def uniform_compliance(self, grid):
        """Return the displacement by pressure 1 on all cells; see `Kernel.uniform_compliance`."""
        return self.bodies.uniform_compliance(grid) + (
            self.surface_compliance if grid.doubly_periodic else 0.0
        )

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of the eigenvalues of A + c."""
        return self.bodies.smallest_eigenvalue(grid) + self.surface_compliance

    def largest_eigenvalue(self, grid):
        """Return an upper bound of the eigenvalues of A + c."""
        return self.bodies.largest_eigenvalue(grid) + self.surface_compliance

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded rectangle; see `Kernel.middle_displacement`."""
        return self.bodies.middle_displacement(lengths) + self.surface_compliance

    def softest_parts(self, length):
        """Return a displacement and a compliance; see `Kernel.softest_parts`."""
        rigid, compliance = self.bodies.softest_parts(length)
        return rigid + self.surface_compliance, compliance

    def punch_stiffness(self, area):
        """Return the stiffness of a punch, that of bodies and surface in series [N/mm]."""
        return 1 / (1 / self.bodies.punch_stiffness(area) + self.surface_compliance / area)
