"""Results of the flow through a gap.

The module can be imported without MPI or numba.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from app.base.types import Floats

_OF_BOTH = "percolates", "transmissivity", "hydraulic_aperture"  # directions
FLOW_NUMBERS = (*(f"{name}_{along}" for name in _OF_BOTH for along in "xy"), "flow_error")  # of a result file
FLOW_FIELDS = "fluid_pressure", "flux_x", "flux_y"


@dataclass(frozen=True, eq=False)
class DirectedFlow:
    """Flow for a pressure drop of one along one direction.

    The fields have the local rows, shape (rows, nx).

    Attributes
    ----------
    lower, upper : float
        Proved bounds of the transmissivity [mm3]; both 0 if the gap does not percolate.
    fluid_pressure : ndarray of float64
        Pressure for a drop of one; NaN in cells that do not connect the sides of the patch.
    flux_x, flux_y : ndarray of float64
        Flow rate per width in each cell [mm2], for a drop and a viscosity of one.
    """

    lower: float
    upper: float
    fluid_pressure: Floats
    flux_x: Floats
    flux_y: Floats

    @property
    def percolates(self) -> bool:
        """Whether the open cells connect the sides of the patch."""
        return self.upper > 0

    @property
    def transmissivity(self) -> float:
        """Middle of the bounds [mm3]."""
        return (self.lower + self.upper) / 2

    @property
    def hydraulic_aperture(self) -> float:
        """Uniform gap with the same transmissivity [mm]."""
        return float(np.cbrt(12 * self.transmissivity))

    @property
    def error(self) -> float:
        """Proved relative error of the transmissivity."""
        return (self.upper - self.lower) / (self.upper + self.lower) if self.percolates else 0.0


class Flow(NamedTuple):
    """Flow through the gap of a solution, for pressure drops along x and along y.

    The flow rate is transmissivity * width / length * pressure drop / viscosity, where the length is that of the patch
    in the direction of the drop. A uniform gap g has the transmissivity g^3 / 12.

    Attributes
    ----------
    x, y : DirectedFlow
        Flow for a pressure drop along x, and along y. Their attributes have the names below without ``_x`` and ``_y``.
    percolates_x, percolates_y : bool
        Whether the open cells connect the sides of the patch.
    transmissivity_x, transmissivity_y : float
        Transmissivity [mm3]; 0 if the gap does not percolate.
    lower_x, upper_x, lower_y, upper_y : float
        Proved bounds of the transmissivity on this grid [mm3].
    hydraulic_aperture_x, hydraulic_aperture_y : float
        Uniform gap with the same transmissivity [mm].
    flow_error : float
        Proved relative error of the transmissivities, the larger of the two.
    fluid_pressure, flux_x, flux_y : ndarray of float64, shape (rows, nx)
        Fields of ``x``: pressure for a drop of one along x, and flow rate per width in x and in y [mm2].
    """

    x: DirectedFlow
    y: DirectedFlow

    def __getattr__(self, name: str) -> Any:
        """Return a number of one direction, or a field of ``x``."""
        quantity, _, direction = name.rpartition("_")
        if name in FLOW_FIELDS:
            return getattr(self.x, name)
        if direction in self._fields and quantity in (*_OF_BOTH, "lower", "upper"):
            return getattr(getattr(self, direction), quantity)
        raise AttributeError(f"this flow has no {name}")

    @property
    def flow_error(self) -> float:
        """Proved relative error of the transmissivities."""
        return max(self.x.error, self.y.error)

    def select(self, names: Iterable[str]) -> dict[str, Any]:
        """Return a dict of `FLOW_NUMBERS` or `FLOW_FIELDS`."""
        return {name: getattr(self, name) for name in names}

    def map_fields(self, function: Callable[[Floats], Floats]) -> "Flow":
        """Return a copy with a function applied to all fields."""
        fields = ({name: function(getattr(flow, name)) for name in FLOW_FIELDS} for flow in self)
        return Flow(*(replace(flow, **mapped) for flow, mapped in zip(self, fields, strict=True)))
