"""Elliptic contact of smooth bodies (Hertz 1882).

The pressure p_max sqrt(1 - x^2/a^2 - y^2/b^2) displaces the surface by

    u = p_max a b / (2 E*) * int_lam^inf (1 - x^2/(a^2 + w) - y^2/(b^2 + w)) / sqrt((a^2 + w) (b^2 + w) w) dw
      = p_max a b / E* * (R_F(A, B, lam) - x^2/3 R_D(B, lam, A) - y^2/3 R_D(A, lam, B)),

with Carlson's elliptic integrals R_F and R_D, A = a^2 + lam and B = b^2 + lam. Inside the contact area lam is 0;
outside it is the positive root of x^2/A + y^2/B = 1. The condition u = delta - x^2/(2 Rx) - y^2/(2 Ry) inside gives
b/a, a and p_max.

References
----------
K. L. Johnson, Contact Mechanics, Cambridge 1985, Sec. 3.5 and 4.2. DLMF, Sec. 19.16 (R_F, R_D).
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.special import elliprd, elliprf

from app.base.errors import InputError, format_exact
from app.base.types import ArrayLike, Floats
from app.reference.base import NormalContact

MAX_LOG_RATIO = 300.0  # of rx / ry; larger squares overflow


@lru_cache(maxsize=64)
def axis_ratio(rx, ry):
    """Return the contact ellipse's ratio of semi-axes b/a.

    `rx` and `ry` are the relative radii of curvature.
    """
    log_radii = math.log(rx) - math.log(ry)
    if abs(log_radii) > MAX_LOG_RATIO:
        raise InputError(f"rx {format_exact(rx)}, ry {format_exact(ry)}: must have a ratio closer to 1")

    def excess(log_k):
        k2 = math.exp(2 * log_k)
        return math.log(elliprd(1.0, 0.0, k2) / elliprd(k2, 0.0, 1.0)) - log_radii

    # rx/ry falls from infinity to 0 as b/a grows, like (b/a)^-1.5 near 1 and faster elsewhere: b/a lies
    # between 1 and ry/rx.
    low, high = sorted((-log_radii, 0.0))
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return math.exp(middle)


@dataclass(frozen=True)
class EllipticHertz(NormalContact):
    """Hertz's contact: undeformed distance x^2/(2 rx) + y^2/(2 ry).

    The principal axes of the bodies are parallel to x and y. Either of the relative radii of curvature rx, ry [mm] may
    be the larger one.
    """

    rx: float
    ry: float
    e_star: float
    approach: float
    load_exponent = 1.5

    @cached_property
    def _ratio(self):
        return axis_ratio(self.rx, self.ry)

    @cached_property
    def _rf(self):
        """Carlson's integral R_F(a^2, b^2, 0), times a."""
        return float(elliprf(1.0, self._ratio**2, 0.0))

    @cached_property
    def a(self) -> float:
        """Semi-axis of the contact area along x [mm]."""
        rd = float(elliprd(self._ratio**2, 0.0, 1.0))
        return math.sqrt(2 * self.rx * self._depth * rd / (3 * self._rf))

    @property
    def b(self) -> float:
        """Semi-axis of the contact area along y [mm]."""
        return self._ratio * self.a

    @property
    def max_pressure(self) -> float:
        """Pressure at the origin [N/mm2]."""
        return self.e_star * self._depth / (self.b * self._rf) if self.a else 0.0

    @property
    def stiffness(self) -> float:
        """Stiffness d load / d approach [N/mm]."""
        return math.pi * self.e_star * self.a / self._rf

    def undeformed_distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance of the paraboloids [mm]."""
        return np.asarray(x) ** 2 / (2 * self.rx) + np.asarray(y) ** 2 / (2 * self.ry)

    def displacement(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the displacement u of both surfaces together [mm]."""
        if self.a == 0:
            return np.zeros(np.broadcast(x, y).shape)
        # Lengths in units of a.
        x2, y2, k2 = (np.asarray(x) / self.a) ** 2, (np.asarray(y) / self.a) ** 2, self._ratio**2
        # lam is the positive root of lam^2 + 2 half lam = c, written without cancellation for either sign.
        half = (1 + k2 - x2 - y2) / 2
        c = np.maximum(x2 * k2 + y2 - k2, 0)
        root = np.sqrt(half**2 + c)
        lam = np.where(half > 0, c / (root + np.abs(half)), root - half)
        ax, by = 1 + lam, k2 + lam
        integral = elliprf(ax, by, lam) - x2 / 3 * elliprd(by, lam, ax) - y2 / 3 * elliprd(ax, lam, by)
        return self._depth / self._rf * integral
