"""Base class of analytic solutions, and checks of parameters."""

import math
from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import ClassVar, Self

import numpy as np

from app.base.errors import InputError, format_exact, is_number
from app.base.types import ArrayLike, Floats


def require_numbers(**values):
    """Raise InputError unless all values are numbers."""
    for name, value in values.items():
        if not is_number(value):
            raise InputError(f"{name} {value!r}: must be a number")


def require_positive(**values):
    """Raise InputError unless all values are positive and finite."""
    require_numbers(**values)
    for name, value in values.items():
        if not 0 < value < math.inf:
            raise InputError(f"{name} {format_exact(value)}: must be positive and finite")


def require_hardness(hardness):
    """Raise InputError unless the hardness is positive; it may be infinite."""
    if hardness != math.inf:
        require_positive(hardness=hardness)


class NormalContact(ABC):
    """Frictionless contact in an ellipse with its centre at the origin.

    A subclass is a frozen dataclass of its geometry, `e_star` and `approach`, with properties `a`, `b`, `max_pressure`
    and `stiffness`. Methods take arrays x and y [mm], which broadcast. Without contact (approach <= 0)
    pressure and displacement are zero.

    Attributes
    ----------
    e_star : float
        Contact modulus E* [N/mm2], 1/E* = (1 - nu)/G.
    approach : float
        Depth by which the bodies would overlap if they were not deformed, delta [mm].
    a, b : float
        Semi-axes of the contact area along x and y [mm]; 0 without contact.
    load : float
        Normal force [N].
    max_pressure : float
        Largest pressure [N/mm2]; infinite if the pressure is singular.
    stiffness : float
        Derivative of the load with respect to the approach [N/mm].

    Raises
    ------
    InputError
        If a geometric parameter or the modulus is not positive, or a value is not finite.
    """

    e_star: float
    approach: float
    load_exponent: ClassVar[float]  # load ~ approach ** load_exponent

    def __post_init__(self):
        require_positive(**{f.name: getattr(self, f.name) for f in fields(self) if f.name != "approach"})
        if not math.isfinite(self.approach):
            raise InputError(f"approach {format_exact(self.approach)}: must be finite")

    @classmethod
    def from_approach(cls, *parameters: float, **named: float) -> Self:
        """Return the contact at an approach.

        The parameters are the geometry's, E* and ``approach`` [mm].
        """
        return cls(*parameters, **named)

    @classmethod
    def from_load(cls, *parameters: float, **named: float) -> Self:
        """Return the contact under a load.

        The parameters are the geometry's, E* and ``load`` [N].
        """
        names = [f.name for f in fields(cls) if f.name != "approach"]
        values = dict(zip([*names, "load"], parameters, strict=False)) | named
        if missing := [name for name in (*names, "load") if name not in values]:
            raise InputError(
                f"{cls.__name__}.from_load: needs {', '.join(names)} and load; {', '.join(missing)} is missing"
            )
        load = values.pop("load")
        return cls(**values, approach=1.0).at_load(load)

    def at_load(self, load: float) -> Self:
        """Return these bodies' contact under a load [N]."""
        if not 0 <= load < math.inf:
            raise InputError(f"load {format_exact(load)}: must be finite and not negative")
        unit = replace(self, approach=1.0)
        return replace(self, approach=(load / unit.load) ** (1 / self.load_exponent))

    @property
    def _depth(self):
        return max(self.approach, 0.0)

    @property
    def load(self) -> float:
        """Normal force [N]."""
        return self.stiffness * self._depth / self.load_exponent

    @property
    def contact_area(self) -> float:
        """Area of the contact ellipse [mm2]."""
        return math.pi * self.a * self.b

    @property
    def mean_pressure(self) -> float:
        """Load divided by contact area [N/mm2]; 0 without contact."""
        return self.load / (math.pi * self.a) / self.b if self.a else 0.0

    def _radius2(self, x, y):
        """Return (x/a)^2 + (y/b)^2; infinite without contact."""
        if self.a == 0:
            return np.full(np.broadcast(x, y).shape, np.inf)
        return (np.asarray(x) / self.a) ** 2 + (np.asarray(y) / self.b) ** 2

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the contact pressure p at points [N/mm2].

        The pressure is Hertz's semi-ellipsoid, unless a subclass has another one.
        """
        return self.max_pressure * np.sqrt(np.maximum(1 - self._radius2(x, y), 0))

    @abstractmethod
    def undeformed_distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance [mm]; NaN where contact is impossible."""

    @abstractmethod
    def displacement(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the displacement u of both surfaces together [mm]."""

    def gap(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the gap of the deformed surfaces [mm]."""
        return self.undeformed_distance(x, y) - self.approach + self.displacement(x, y)
