"""Line contact of a cylinder of finite length.

If a load W is uniform along the length L of a cylinder of radius R, the contact has Hertz's half-width a,
``a^2 = 4 W R / (pi E* L)``. In the middle the bodies approach each other by ``W / (pi E* L) (1 + 2 ln(2 L / a))``, if a
is small compared with L. The load is uniform if the cylinder has Lundberg's profile, a drop of
``W / (pi E* L) ln(1 / (1 - (2 y / L)^2))`` along y. This drop is infinite at the ends. To make it finite there, Johns
and Gohar multiply (2 y / L)^2 by ``1 - 0.6066 a / L``.

References
----------
G. Lundberg, Forsch. Ing.-Wes. 10 (1939) 201-211. P. M. Johns and R. Gohar, Tribol. Int. 14 (1981) 131-136.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from app.base.types import ArrayLike, Floats
from app.reference.base import require_positive

END_DROP = 0.6066  # a / L times this is what Johns and Gohar leave of 1 - (2 y / L)^2 at the ends
_STEPS = 60  # of the fixed-point iteration for the half-width


@dataclass(frozen=True)
class LineContact:
    """Contact of a cylinder, uniformly loaded along its length.

    `radius` R and `length` L are in mm, `e_star` is E* [N/mm2], and `load` is W [N].

    Examples
    --------
    >>> contact = LineContact(radius=10, length=16, e_star=115385, load=20000)
    >>> round(contact.a, 3), round(contact.max_pressure), round(contact.approach, 4)
    (0.371, 2143, 0.0342)
    """

    radius: float
    length: float
    e_star: float
    load: float

    def __post_init__(self):
        require_positive(radius=self.radius, length=self.length, contact_modulus=self.e_star, load=self.load)

    @classmethod
    def from_approach(cls, radius: float, length: float, e_star: float, approach: float) -> Self:
        """Return the contact whose middle has an approach [mm]."""
        require_positive(radius=radius, length=length, approach=approach)
        a = math.sqrt(2 * radius * approach)  # where the undeformed bodies overlap
        for _ in range(_STEPS):
            a = math.sqrt(4 * radius * approach / (1 + 2 * math.log(max(2 * length / a, 1.0))))
        return cls(radius, length, e_star, math.pi * e_star * length * a**2 / (4 * radius))

    @property
    def compliance(self) -> float:
        """Factor ``W / (pi E* L)`` in `approach` and `crown` [mm]."""
        return self.load / (math.pi * self.e_star * self.length)

    @property
    def a(self) -> float:
        """Half-width of the contact [mm]."""
        return math.sqrt(4 * self.radius * self.compliance)

    @property
    def max_pressure(self) -> float:
        """Pressure on the middle line [N/mm2]."""
        return 2 * self.load / (math.pi * self.a * self.length)

    @property
    def approach(self) -> float:
        """Approach in the middle of the cylinder [mm]."""
        return self.compliance * (1 + 2 * math.log(2 * self.length / self.a))

    def crown(self, y: ArrayLike) -> Floats:
        """Return the drop of the logarithmic profile [mm]; NaN past the ends."""
        rest = max(1 - END_DROP * self.a / self.length, 0.0)
        s = 2 * np.abs(y) / self.length
        s = np.where(s <= 1, s, np.nan)
        return -self.compliance * np.log1p(-rest * s**2)
