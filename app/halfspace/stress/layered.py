"""Stress in a body with a layer, below a frictionless pressure.

The layer, or coating, is bonded to a substrate, which is either a half-space or rigid. At the interface sigma_xx,
sigma_yy and sigma_xy jump; the other components are continuous. At a depth equal to the thickness, the stress is
computed in the coating, unless `side` is "substrate". `layer_sums` has the formulas.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from app.base.arithmetic import in_default_arithmetic
from app.base.errors import InputError
from app.base.types import ArrayLike, Floats
from app.base.units import format_lengths
from app.halfspace.grid import Grid
from app.halfspace.layer import Layer
from app.halfspace.stress import subsurface
from app.halfspace.stress.subsurface import StressMaximum, SubsurfaceStress, von_mises

_SIDES = "coating", "substrate"
_COATING_DEPTHS = 8  # of a section, at least
_SAME_DEPTH = 1e-12  # relative; depths that differ less from the thickness are at the interface


class LayerMaxima(NamedTuple):
    """Largest stresses in the parts of a layered body, each a `StressMaximum`.

    `coating` and `substrate` have the largest von Mises stresses of the two materials, `coating_interface` and
    `substrate_interface` those on the two sides of the interface. `shear` has the largest shear stress on the interface
    (`StressMaximum.horizontal_shear`), which the bond carries. On a rigid base the maxima in the substrate are None.
    """

    coating: StressMaximum
    substrate: StressMaximum | None
    coating_interface: StressMaximum
    substrate_interface: StressMaximum | None
    shear: StressMaximum


class LayeredStress(SubsurfaceStress):
    """Stress at any points in a layered body, below a surface pressure.

    `pressure` has the values on the whole grid, shape (ny, nx) [N/mm2]. `layer` is a `app.halfspace.layer.Layer`, with
    the materials of layer and substrate. Raises InputError for invalid numbers.

    Examples
    --------
    >>> from app import Grid
    >>> from app.halfspace.layer import Layer
    >>> hard = Layer(0.5, young=(400e3, 20e3), poisson=(0.3, 0.3))
    >>> below = LayeredStress(np.ones((1, 1)), Grid(1, 1, 2.0, 2.0), hard)
    >>> coating, substrate = (below.plane(0.5, side) for side in ("coating", "substrate"))
    >>> bool(coating[0, 0, 0] > 0 > substrate[0, 0, 0])  # tension where the coating bends
    True
    """

    def __init__(self, pressure: ArrayLike, grid: Grid, layer: Layer) -> None:
        self.layer, self.nu = layer, layer.poisson[: 1 if layer.on_rigid_base else 2]
        self._set_pressure(pressure, grid)

    def _make_sums(self, pressure, grid):
        from app.halfspace.stress import layer_sums

        if grid.one_way:
            return layer_sums.LayeredOneWayStress(pressure, grid, self.layer)
        kind = layer_sums.LayeredPeriodicStress if grid.doubly_periodic else layer_sums.LayeredFreeStress
        return kind(pressure, grid, self.layer)

    def describe(self, nu: str = "nu") -> str:
        """Describe the materials of the body; `nu` is written for Poisson's ratio."""
        base = "a rigid base" if self.layer.on_rigid_base else f"{nu} = {self.nu[1]:.3g}"
        thickness = format_lengths(self.layer.thickness)
        thickness = thickness if nu.isascii() else thickness.replace("um", "µm")
        return f"layer of {thickness}, {nu} = {self.nu[0]:.3g}, on {base}"

    @property
    def interface(self) -> float:
        """Depth of the interface [mm]."""
        return self.layer.thickness

    @property
    def _below(self):
        """Interface depth, rounded up into the substrate [mm]."""
        return float(np.nextafter(self.layer.thickness, np.inf))

    def include_interface(self, depths: Floats) -> Floats:
        """Return `depths`, with both sides of the interface if they reach it.

        The coating has at least `_COATING_DEPTHS` depths. A rigid base has none.
        """
        t = self.layer.thickness
        if depths[-1] <= t:
            return depths
        coating = depths[depths < t]
        if coating.size < _COATING_DEPTHS:
            coating = np.linspace(0, t, _COATING_DEPTHS, endpoint=False)
        substrate = [] if self.layer.on_rigid_base else [self._below, *depths[depths > t]]
        return np.concatenate([coating, [t], substrate])

    def _at_side(self, depths, side):
        """Check depths, and move those at the interface to its `side`, the coating or the substrate."""
        t = self.layer.thickness
        if side not in _SIDES:
            raise InputError(f"side {side!r}: allowed: {', '.join(_SIDES)}")
        depths = np.array(subsurface.check_depths(depths))
        at_interface = np.isclose(depths, t, rtol=_SAME_DEPTH, atol=0) & (depths != self._below)
        depths[at_interface] = t if side == "coating" else self._below
        if self.layer.on_rigid_base and (deepest := depths.max()) > t:
            most = f"must be at most the thickness {t:.6g} mm, because the base is rigid"
            raise InputError(f"depth {deepest:.6g}: {most}")
        return depths

    def plane(self, depth: float, side: str = "coating") -> Floats:
        """Return the stress on a horizontal plane, below the cell centres.

        If `depth` is the depth of the interface, `side` selects the stress in the "coating" or in the "substrate".
        Otherwise as `SubsurfaceStress.plane`.
        """
        return super().plane(float(self._at_side(depth, side)[0]))

    def section(
        self, depths: ArrayLike, x: float | None = None, y: float | None = None, side: str = "coating"
    ) -> Floats:
        """Return the stress on a vertical plane; see `plane` and `SubsurfaceStress.section`."""
        return super().section(self._at_side(depths, side), x, y)

    def line(self, depths: ArrayLike, x: float, y: float, side: str = "coating") -> Floats:
        """Return the stress on a vertical line; see `plane` and `SubsurfaceStress.line`."""
        return super().line(self._at_side(depths, side), x, y)

    def maximum(self) -> StressMaximum:
        """Return the largest von Mises stress; see `SubsurfaceStress.maximum`."""
        return self.maxima()[0]

    @in_default_arithmetic
    def maxima(self) -> list[StressMaximum]:
        """Return the largest von Mises and shear stress in both materials."""
        mises, shear = zip(*self._by_material, strict=True)
        return [max(mises, key=lambda at: at.von_mises), max(shear, key=lambda at: at.max_shear)]

    @cached_property
    def _by_material(self):
        """Largest von Mises and shear stress of the coating, and of the substrate."""
        t, depths = self.layer.thickness, self._search_depths()
        parts = [np.append(depths[depths < t], t)]
        if not self.layer.on_rigid_base:
            deeper = depths[depths > t]
            parts.append(np.concatenate([[self._below], deeper if deeper.size else [2 * t]]))
        return [self._search(part, von_mises, subsurface.shear_where_large) for part in parts]

    @in_default_arithmetic
    def layer_maxima(self) -> LayerMaxima:
        """Return the `LayerMaxima` of both materials and the interface."""
        largest = [at for at, _ in self._by_material]
        sides = [self.layer.thickness] if self.layer.on_rigid_base else [self.layer.thickness, self._below]
        (one, shear), *other = (
            self._search([depth], von_mises, subsurface.horizontal_shear) for depth in sides
        )
        if not other:
            return LayerMaxima(largest[0], None, one, None, shear)
        return LayerMaxima(*largest, one, other[0][0], shear)
