"""Kernel of an orthotropic half-space against a rigid body.

x, y and the depth are axes of the material. Pressure waves in the direction t displace the surface by [L^-1]_33 / q
with the tensor L(t) of Barnett and Lothe. The displacement by a point force has the same dependence on the direction,
turned by a right angle (J.R. Willis, J. Mech. Phys. Solids 14 (1966) 163-176).
"""

import numpy as np

from app.halfspace.kernel import Kernel

VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
TERMS = 16  # of the cosine series in the direction
NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)


def surface_compliance(stiffness, angle):
    """Return [L^-1]_33 / 2 pi [mm2/N] of a 6 x 6 `stiffness` [N/mm2] for waves at an angle [rad] to x."""
    c = np.asarray(stiffness)[VOIGT[:, :, None, None], VOIGT]
    phi = np.pi * np.arange(64) / 64
    t, z = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
    m, n = (
        np.outer(np.cos(phi), t) + np.outer(np.sin(phi), z),
        np.outer(np.cos(phi), z) - np.outer(np.sin(phi), t),
    )
    mm, mn, nn = (np.einsum("pi,ijkl,pl->pjk", a, c, b) for a, b in ((m, m), (m, n), (n, n)))
    tensor = (mm - mn @ np.linalg.inv(nn) @ mn.transpose(0, 2, 1)).mean(axis=0)
    return np.linalg.inv(tensor)[2, 2] / (2 * np.pi)


class Orthotropic(Kernel):
    """Kernel of a half-space whose compliance is a cosine series in twice the direction [mm2/N]."""

    scale_free, isotropic = True, False

    def __init__(self, series):
        super().__init__(series[0])
        self.series = tuple(series)

    @classmethod
    def from_stiffness(cls, stiffness):
        """Make the kernel of a body with a 6 x 6 stiffness matrix (Voigt's notation) [N/mm2]."""
        angles = np.pi * np.arange(2 * TERMS) / (2 * TERMS)
        values = np.fft.rfft([surface_compliance(stiffness, angle) for angle in angles]).real / TERMS
        return cls([values[0] / 2, *values[1:TERMS]])

    @property
    def parameters(self):
        return self.series

    def in_units(self, length):
        return Orthotropic(np.array(self.series) / self.compliance)

    def wave_compliance(self, qx, qy=0.0):
        return np.polynomial.chebyshev.chebval(np.cos(2 * np.arctan2(qy, qx)), self.series)

    def unit_coefficients(self, grid, rows, columns):
        x, y = ([(d - 0.5) * side, (d + 0.5) * side] for d, side in ((columns, grid.dx), (rows, grid.dy)))
        corners = [[self._corner(across, along[:, None]) for across in x] for along in y]
        return (corners[1][1] - corners[1][0] - corners[0][1] + corners[0][0]) / self.compliance

    def _corner(self, x, y):
        """Return the displacement of a corner of a loaded rectangle with the sides x and y, odd in both."""
        x, y, sign = np.abs(x), np.abs(y), np.sign(x) * np.sign(y)
        return sign * (x * self._side(y / x, -1) + y * self._side(x / y, 1))

    def _side(self, slope, turned):
        half = np.arcsinh(slope)[..., None] / 2  # tan(angle) = sinh(s)
        values = np.polynomial.chebyshev.chebval(
            turned * (2 / np.cosh(half * (1 + NODES)) ** 2 - 1), self.series
        )
        return half[..., 0] * (values @ WEIGHTS)

    def is_positive(self, grid):
        return True
