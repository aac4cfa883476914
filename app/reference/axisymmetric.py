"""Axisymmetric contact: paraboloid, flat-ended cylinder, cone.

References
----------
K. L. Johnson, Contact Mechanics, Cambridge 1985, Sec. 3.4, 4.2 and 5.2.
I. N. Sneddon, Int. J. Engng. Sci. 3 (1965), 47-57.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.base.types import ArrayLike, Floats
from app.reference.base import NormalContact


class AxisymmetricContact(NormalContact):
    """Contact of bodies of revolution, in a circle.

    Subclasses define the undeformed distance `_shape(r)` at a distance r from the axis, and the displacement
    `_outer_displacement(r)` for r >= a > 0.
    """

    @property
    def b(self) -> float:
        """Semi-axis along y [mm]; the same radius as `a`."""
        return self.a

    @property
    def stiffness(self) -> float:
        """Stiffness d load / d approach [N/mm]."""
        return 2 * self.e_star * self.a

    @property
    def max_pressure(self) -> float:
        """Largest pressure [N/mm2], infinite at an edge or tip; 0 without contact."""
        return math.inf if self.a else 0.0

    def undeformed_distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance [mm]; NaN where contact is impossible."""
        return self._shape(np.hypot(x, y))

    def displacement(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the displacement u of both surfaces together [mm]."""
        r = np.hypot(x, y)
        if self.a == 0:
            return np.zeros_like(r)
        return np.where(
            r < self.a, self.approach - self._shape(r), self._outer_displacement(np.maximum(r, self.a))
        )


@dataclass(frozen=True)
class Sphere(AxisymmetricContact):
    """Sphere of a relative `radius` R [mm], approximated by r^2/(2 R)."""

    radius: float
    e_star: float
    approach: float
    load_exponent = 1.5

    @property
    def a(self) -> float:
        """Radius of the contact area [mm]."""
        return math.sqrt(self.radius * self._depth)

    @property
    def max_pressure(self) -> float:
        """Pressure at the centre [N/mm2]."""
        return 1.5 * self.mean_pressure

    def _shape(self, r):
        return r**2 / (2 * self.radius)

    def _outer_displacement(self, r):
        from scipy.special import spherical_jn

        # Johnson, Sec. 3.4: ((2 a^2 - r^2) asin(a/r) + a sqrt(r^2 - a^2)) / (pi R). With t = 2 asin(a/r) the
        # bracket is r^2/2 (sin t - t cos t) = r^2/2 t^2 j1(t), which does not cancel far away.
        t = 2 * np.arcsin(self.a / r)
        return (r * t) ** 2 * spherical_jn(1, t) / (2 * math.pi * self.radius)


@dataclass(frozen=True)
class FlatCircularPunch(AxisymmetricContact):
    """Rigid cylinder of a `radius` [mm], pressed on with its flat end.

    The pressure is infinite at the edge, but its integral is finite.
    """

    radius: float
    e_star: float
    approach: float
    load_exponent = 1.0

    @property
    def a(self) -> float:
        """Radius of the contact area [mm]."""
        return self.radius if self.approach > 0 else 0.0

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the contact pressure at points [N/mm2]."""
        s = self._radius2(x, y)
        inside = s < 1
        return np.where(inside, self.mean_pressure / 2 / np.sqrt(1 - np.where(inside, s, 0)), 0)

    def _shape(self, r):
        return np.where(r <= self.radius, 0.0, np.nan)

    def _outer_displacement(self, r):
        return 2 * self.approach / math.pi * np.arcsin(self.a / r)


@dataclass(frozen=True)
class Cone(AxisymmetricContact):
    """Cone with undeformed distance `slope` times the radius r.

    The pressure is infinite at the tip, as log(1/r).
    """

    slope: float
    e_star: float
    approach: float
    load_exponent = 2.0

    @property
    def a(self) -> float:
        """Radius of the contact area [mm]."""
        return 2 * self._depth / (math.pi * self.slope)

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the contact pressure at points [N/mm2]."""
        with np.errstate(divide="ignore"):  # the tip
            return self.mean_pressure * np.arccosh(np.maximum(1 / np.sqrt(self._radius2(x, y)), 1))

    def _shape(self, r):
        return self.slope * r

    def _outer_displacement(self, r):
        # sqrt(r^2 - a^2) - r, without cancellation far away
        drop = self.a**2 / (r + np.sqrt(r**2 - self.a**2))
        return self.slope * (self.a * np.arcsin(self.a / r) - drop)
