"""Axisymmetric contact with a hardness, solved on rings.

The pressure is constant on rings about the axis. A pressure p on a disc of radius s displaces the surface by
(Johnson, Sec. 3.4)::

    u = 4 p s / (pi E*) E(m),                       m = (r/s)^2,   r <= s
    u = 4 p r / (pi E*) (E(m) - (1 - m) K(m)),      m = (s/r)^2,   r > s

and a ring is the difference of two discs. The conditions of contact hold at the middle of each ring.

References
----------
K. L. Johnson, Contact Mechanics, Cambridge 1985.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ellipe, ellipkm1

from app.base.types import ArrayLike, Floats
from app.reference.base import require_hardness, require_positive


def solve_box(matrix: Floats, h: Floats, upper: float | Floats) -> Floats:
    """Solve e = h + A p for pressures from 0 to `upper`.

    The conditions are e >= 0 where p = 0, e = 0 where 0 < p < upper, and e <= 0 where p = upper. Each cell is in one of
    these three sets. Newton's method moves all cells that violate the condition of their set.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        Influence matrix A, with a positive diagonal that dominates enough for Newton's method.
    h : ndarray, shape (n,)
    upper : float or ndarray, shape (n,)
        Largest pressure; infinite without a limit.

    Raises
    ------
    ArithmeticError
        If the sets still change after many iterations.
    """
    upper = np.broadcast_to(upper, h.shape)
    elastic, plastic = h < 0, np.zeros(h.shape, bool)
    for _ in range(len(h) + 20):
        p = np.where(plastic, upper, 0.0)
        p[elastic] = np.linalg.solve(
            matrix[np.ix_(elastic, elastic)], -(h + matrix[:, plastic] @ upper[plastic])[elastic]
        )
        # Of elastic cells e is 0, of others p is a bound: one test for all.
        guess = p - np.where(elastic, 0.0, h + matrix @ p) / matrix.diagonal()
        found = (guess > 0) & (guess < upper), guess >= upper
        if (found[0] == elastic).all() and (found[1] == plastic).all():
            return p
        elastic, plastic = found
    raise ArithmeticError("the sets do not settle")


@dataclass(frozen=True)
class CappedSphere:
    """Paraboloid r^2/(2 radius) with a hardness, on rings of equal width.

    Parameters
    ----------
    radius : float
        Relative radius R [mm].
    e_star, hardness : float
        Contact modulus E* and largest pressure H [N/mm2]; H may be infinite.
    approach : float
        Approach of the bodies [mm].
    rings : int
        Number of rings in the area where the undeformed bodies overlap.
    """

    radius: float
    e_star: float
    hardness: float
    approach: float
    rings: int = 300

    def __post_init__(self):
        require_positive(radius=self.radius, e_star=self.e_star, approach=self.approach)
        require_hardness(self.hardness)

    @property
    def edges(self) -> Floats:
        """Radii between the rings [mm], shape (rings + 1,)."""
        return math.sqrt(2 * self.radius * self.approach) * np.arange(self.rings + 1) / self.rings

    @property
    def r(self) -> Floats:
        """Radius at the middle of each ring [mm]."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @cached_property
    def _solution(self):
        """Pressure and gap e = h + u of each ring."""
        s, r = self.edges[None, 1:], self.r[:, None]
        m = (np.minimum(s, r) / np.maximum(s, r)) ** 2
        rest = np.abs(s - r) * (s + r) / np.maximum(s, r) ** 2  # 1 - m
        discs = np.where(r <= s, s * ellipe(m), r * (ellipe(m) - rest * ellipkm1(rest)))
        matrix = 4 / (math.pi * self.e_star) * np.diff(discs, axis=1, prepend=0)
        h = self.r**2 / (2 * self.radius) - self.approach
        p = solve_box(matrix, h, self.hardness)
        return p, h + matrix @ p

    @property
    def ring_pressure(self) -> Floats:
        """Pressure of the rings [N/mm2]."""
        return self._solution[0]

    @property
    def ring_plastic_depth(self) -> Floats:
        """Plastic depth of the rings [mm]."""
        return np.where(self.ring_pressure == self.hardness, -self._solution[1], 0.0)

    def _sum(self, values):
        return float(math.pi * (values @ np.diff(self.edges**2)))

    @property
    def load(self) -> float:
        """Normal force [N]."""
        return self._sum(self.ring_pressure)

    @property
    def contact_area(self) -> float:
        """Area of the contact [mm2]."""
        return self._sum(self.ring_pressure > 0)

    @property
    def plastic_area(self) -> float:
        """Area of the plastic contact [mm2]."""
        return self._sum(self.ring_pressure == self.hardness)

    @property
    def plastic_volume(self) -> float:
        """Integral of the plastic depth [mm3]."""
        return self._sum(self.ring_plastic_depth)

    @property
    def max_plastic_depth(self) -> float:
        """Plastic depth of the innermost ring [mm]."""
        return float(self.ring_plastic_depth[0])

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return contact pressure at points [N/mm2], linear between rings."""
        return np.interp(np.hypot(x, y), self.r, self.ring_pressure, right=0.0)
