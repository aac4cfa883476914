"""What all analytic solutions have in common. No call in this package is collective."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import fields, replace
from numbers import Real
from typing import ClassVar

import numpy as np

from app.base.errors import InputError, format_exact


def require_numbers(**values):
    """Raise InputError for the first of `values` that is no real number."""
    for name, value in values.items():
        if not isinstance(value, float | Real):  # Real alone asks long
            raise InputError(f"{name} {value!r}: must be a number")


def require_positive(**values):
    """Raise InputError for the first of `values` that is not positive and finite."""
    require_numbers(**values)
    for name, value in values.items():
        if not 0 < value < math.inf:
            raise InputError(f"{name} {format_exact(value)}: must be positive and finite")


class NormalContact(ABC):
    """Frictionless contact with an elastic half-space, in an ellipse about the origin.

    A subclass is a frozen dataclass of its geometry, `e_star` and `approach`; everything else follows
    from these. Coordinates broadcast; without contact (approach <= 0) pressure and displacement are zero.

    Attributes
    ----------
    e_star : float
        Contact modulus E* [N/mm2], 1/E* = (1 - nu)/G.
    approach : float
        Depth the bodies would overlap undeformed, delta [mm].
    a, b : float
        Semi-axes of the contact area along x and y [mm]; 0 without contact.
    load : float
        Normal force [N].
    max_pressure : float
        Supremum of the pressure [N/mm2]; infinite where the pressure is singular.
    mean_pressure, contact_area : float
        Load over contact area [N/mm2], and that area [mm2].
    stiffness : float
        d load / d approach [N/mm].
    """

    e_star: float
    approach: float
    load_exponent: ClassVar[float]  # load ~ approach ** load_exponent

    def __post_init__(self):
        require_positive(**{f.name: getattr(self, f.name) for f in fields(self) if f.name != "approach"})
        if not math.isfinite(self.approach):
            raise InputError(f"approach {format_exact(self.approach)}: must be finite")

    def at_load(self, load):
        """Return the same bodies pressed together by `load` [N], at least 0."""
        if not 0 <= load < math.inf:
            raise InputError(f"load {format_exact(load)}: must be finite and not negative")
        unit = replace(self, approach=1.0)
        return replace(self, approach=(load / unit.load) ** (1 / self.load_exponent))

    @property
    def _depth(self):
        return max(self.approach, 0.0)

    @property
    @abstractmethod
    def a(self):
        """Semi-axis of the contact area along x [mm]."""

    @property
    @abstractmethod
    def b(self):
        """Semi-axis of the contact area along y [mm]."""

    @property
    @abstractmethod
    def load(self):
        """Normal force [N]."""

    @property
    @abstractmethod
    def max_pressure(self):
        """Supremum of the pressure [N/mm2]."""

    @property
    @abstractmethod
    def stiffness(self):
        """Derivative of the load with respect to the approach [N/mm]."""

    @property
    def contact_area(self):
        """Area of the contact ellipse [mm2]."""
        return math.pi * self.a * self.b

    @property
    def mean_pressure(self):
        """Load over contact area [N/mm2]."""
        return self.load / (math.pi * self.a) / self.b if self.a else 0.0

    def _radius2(self, x, y):
        """Return (x/a)^2 + (y/b)^2; infinite without contact."""
        if self.a == 0:
            return np.full(np.broadcast(x, y).shape, np.inf)
        return (np.asarray(x) / self.a) ** 2 + (np.asarray(y) / self.b) ** 2

    def in_contact(self, x, y):
        """Return whether points lie inside the contact area; its rim does not."""
        return self._radius2(x, y) < 1

    @abstractmethod
    def pressure(self, x, y):
        """Return the contact pressure p at points [N/mm2]; zero outside the contact area."""

    @abstractmethod
    def undeformed_distance(self, x, y):
        """Return the distance of the undeformed surfaces at zero approach [mm]; NaN: contact impossible."""

    @abstractmethod
    def displacement(self, x, y):
        """Return the normal surface displacement u of both bodies together [mm], inside and outside."""

    def gap(self, x, y):
        """Return the distance of the deformed surfaces, e = h + u [mm]; zero in contact but for round-off."""
        return self.undeformed_distance(x, y) - self.approach + self.displacement(x, y)
