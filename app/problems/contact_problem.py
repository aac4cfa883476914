"""Contact problem: a base shape with rough surfaces."""

from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, replace
from itertools import chain, count
from typing import Any

import numpy as np

from app.base.errors import InputError
from app.base.types import ArrayLike, Floats
from app.base.units import format_lengths
from app.base.usage import usage
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.arrays import (
    check_background,
    check_compliance,
    check_hardness,
    check_shape,
    check_size,
    is_measured,
    real_numbers,
    share_or_copy,
)
from app.problems.problem import Problem
from app.problems.residual_surface import ResidualSurface
from app.problems.shapes import Plane, Shape
from app.reference.base import NormalContact


class _SampledOrFunction:
    """Gap or surface given as array or function."""

    name = "given"

    def __init__(self, label, values):
        self._label, self.sampled = label, not callable(values)
        self._values, self.by_rows = share_or_copy(label, values) if self.sampled else values, self.sampled

    def check_grid(self, grid):
        """Raise if an array misfits the grid or has too large values."""
        if self.sampled:
            check_shape(self._label, self._values.shape, grid)
            check_size(self._label, self._values)

    def shape_on(self, grid, rows=slice(None)):
        """Return the distance or heights in `rows`; see `Problem.shape_on`."""
        if self.sampled:
            return np.array(self._values[rows], order="C")
        x, y = grid.x()[None, :], grid.y(rows)[:, None]
        shape, values = (y.shape[0], grid.nx), real_numbers(self._label, self._call(x, y))
        try:
            values = np.require(np.broadcast_to(values, shape), requirements="CW")
        except ValueError:
            raise InputError(
                f"{self._label}: a function that gives an array of shape {values.shape}; must be {shape} here"
            ) from None
        check_size(self._label, values, rows.start or 0)
        return values

    heights_on = shape_on

    def _call(self, x, y):
        try:
            return self._values(x, y)
        except (TypeError, ValueError) as error:
            if type(error) not in (TypeError, ValueError) or "array" not in str(error):
                raise
            advice = f"a {self._label} is called with arrays x, y; np.vectorize(f) makes one of a function f of numbers"
            raise type(error)(f"{error}; {advice}").with_traceback(error.__traceback__) from None

    def describe(self):
        """Return an empty dict: a result file does not repeat the values."""
        return {}


@usage("ContactProblem(grid, material, Sphere(10), surfaces=[surface])")
@dataclass(frozen=True, eq=False)
class ContactProblem(Problem):
    """Two bodies on a patch of cells.

    Parameters
    ----------
    grid : Grid
    material : Material
    gap : array_like, shape (ny, nx), or callable, or shape, [mm]
        Undeformed distance at zero approach in the cell centres; NaN, or masked, where contact is impossible. An array
        has all cells on every rank; its first row is at the smallest y, and coarser grids average it. It is copied,
        unless it is float64 and read-only (``gap.flags.writeable = False``), which saves memory. A function
        ``gap(x, y)`` is called with arrays that broadcast to the shape of some cells. A function is also called for
        coarser grids, whose last cells may lie beyond the patch. A shape is one of `app.problems.shapes`, or another
        problem. None means a plane.
    periodic : bool or str, optional
        True if the patch repeats without end in x and y, "x" or "y" if in this direction only. "spectral" and "love"
        choose a symbol of `app.halfspace.periodic_symbol`; True means "spectral". Default: as the grid. The attribute
        `periodic` is the direction or the name of the symbol, empty if the patch is not periodic.
    surfaces : sequence of array_like, callable or surface
        Roughness of either body: heights [mm], positive towards the other body, which are subtracted from the gap. Each
        is an array or a function as for `gap`, a surface of `app.problems.random_surfaces`, or a measured surface
        (`app.read_surface`).
    hardness : float or array_like, shape (ny, nx), [N/mm2], optional
        Largest pressure of the softer body, positive; infinite where it stays elastic. Coarser grids average an array.
        Default: no limit, or the hardness of a problem given as `gap`.
    background_pressure : float or array_like, shape (ny, nx), [N/mm2], optional
        Pressure in the gap, of a gas or a fluid, from 0: the least pressure of a cell, also where contact is
        impossible. It is part of the load. Default: 0, or the background pressure of a problem given as `gap`.
    surface_compliance : float or array_like, shape (ny, nx), [mm3/N], optional
        Displacement of a cell by its own pressure, from 0: that of a thin soft layer. Coarser grids average an array.
        Default: 0, or the surface compliance of a problem given as `gap`.

    Examples
    --------
    >>> from app import ContactProblem, Grid, Material, Sphere
    >>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
    >>> sphere.shape_on(grid).shape
    (64, 64)
    >>> wavy = ContactProblem(grid, sphere.material, Sphere(20), surfaces=[lambda x, y: 1e-3 * np.cos(30 * x)])
    >>> float(np.abs(sphere.shape_on(grid) - wavy.shape_on(grid)).max()) < 1e-3
    True
    """

    gap: ArrayLike | Callable[[Floats, Floats], ArrayLike] | Problem | Shape | None = None
    periodic: InitVar[bool | str | None] = None
    surfaces: Sequence[Any] = ()
    hardness: ArrayLike | None = None
    background_pressure: ArrayLike | None = None
    surface_compliance: ArrayLike | None = None

    name = "given"

    def __post_init__(self, periodic):
        for part, kind in (("grid", Grid), ("material", Material)):
            if not isinstance(getattr(self, part), kind):
                raise InputError(f"{part}: {getattr(self, part)!r}; must be a {kind.__name__}")
        if np.ndim(periodic):
            raise InputError(
                f"periodic: is {type(periodic).__name__}; must be True, False, 'x', 'y', 'spectral' or 'love'; "
                "surfaces are given by name, surfaces=[...]"
            )
        periodic = bool(periodic) if isinstance(periodic, np.bool_) else periodic
        if periodic is not None and not (periodic is True and self.grid.doubly_periodic):
            object.__setattr__(self, "grid", replace(self.grid, periodic=periodic))
        if isinstance(self.surfaces, np.ndarray) and self.surfaces.ndim == 2:
            raise InputError(f"surfaces: is an array of shape {self.surfaces.shape}; must be [array]")
        try:
            surfaces = () if self.surfaces is None else tuple(self.surfaces)
        except TypeError:
            kind = type(self.surfaces).__name__
            raise InputError(f"surfaces: is {kind}; must be a sequence of surfaces, [...]") from None
        for label, part in (("gap", self.gap), *(("surface", part) for part in surfaces)):
            if isinstance(part, type):
                raise InputError(
                    f"{label}: is the class {part.__name__}; must be an instance, {part.__name__}(...)"
                )
        if self.gap is None and not surfaces:
            raise InputError("gap: must be an array of numbers, a function of x and y, or a shape")
        shape = Plane() if self.gap is None else self.gap
        if not hasattr(shape, "shape_on"):
            if hasattr(shape, "heights_on"):
                raise InputError(f"gap: is a surface, {type(shape).__name__}; put it in surfaces=[...]")
            shape = _SampledOrFunction("gap", shape)
        surfaces = tuple(
            s if hasattr(s, "heights_on") else _SampledOrFunction("surface", s) for s in surfaces
        )
        for part in (shape, *surfaces):
            if hasattr(part, "check_grid"):
                part.check_grid(self.grid)
        hardness = getattr(shape, "hardness", None) if self.hardness is None else self.hardness
        hardness = check_hardness(hardness, self.grid)
        background = self.background_pressure
        background = getattr(shape, "background_pressure", None) if background is None else background
        object.__setattr__(self, "hardness", hardness)
        compliance = self.surface_compliance
        compliance = getattr(shape, "surface_compliance", 0.0) if compliance is None else compliance
        compliance = check_compliance(compliance, self.grid)
        object.__setattr__(self, "surface_compliance", compliance)
        object.__setattr__(self, "background_pressure", check_background(background, hardness, self.grid))
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "surfaces", surfaces)
        object.__setattr__(self, "name", shape.name)

    def __repr__(self):
        grid, n = self.grid, len(self.surfaces)
        periodic = (", periodic" if grid.periodic else "") + (f" in {grid.one_way}" if grid.one_way else "")
        material = self.material
        elastic = f"E* {material.contact_modulus:g} N/mm2" if material.is_half_space else repr(material)
        if material.coatings:
            each = (
                f"{coating.thickness:g} mm of E {coating.young[0]:g} N/mm2" for coating in material.coatings
            )
            elastic = f"coated by {' and '.join(each)}"
        return (
            f"<ContactProblem: {self.name}, {grid.nx} x {grid.ny} cells of "
            f"{format_lengths(grid.dx, grid.dy)}{periodic}, {elastic}, "
            f"{n} surface{'s'[: n != 1]}>"
        )

    @property
    def _parts(self):
        return self.shape, *self.surfaces

    @property
    def sampled(self) -> bool:
        """True if coarse grids average the gap instead of evaluating it."""
        return any(part.sampled for part in self._parts)

    @property
    def by_rows(self) -> bool:
        """True if the gap can be evaluated by some rows at a time."""
        return all(getattr(part, "by_rows", False) for part in self._parts)

    @property
    def refinable(self) -> bool:
        """True if gap and surfaces exist on finer grids."""
        parts = all(getattr(part, "refinable", not part.sampled) for part in self._parts)
        return parts and not self._varies

    @property
    def indentation(self) -> Floats | None:
        """Depth of the residual surfaces [mm], shape (ny, nx), or None."""
        depths = [surface.depth for surface in self.surfaces if isinstance(surface, ResidualSurface)]
        return sum(depths[1:], depths[0]) if depths and self.hardness is not None else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about gap and surfaces for the user, one line each."""
        return tuple(note for part in self._parts for note in getattr(part, "notes", ()))

    def shape_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return the gap minus the surfaces' heights; see `Problem.shape_on`."""
        distance = self.shape.shape_on(grid, rows)
        if self.surfaces:
            distance = np.array(distance, dtype=float)
            for surface in self.surfaces:
                distance -= surface.heights_on(grid, rows)
        return distance

    def reference(self, approach: float) -> NormalContact | None:
        """Return the analytic solution, None if unknown.

        The analytic solution is known for some smooth shapes on half-spaces, if the patch is not periodic and there is
        no background pressure.
        """
        smooth = not (self.grid.periodic or self.surfaces or isinstance(self.shape, Problem))
        smooth = smooth and self.background_pressure is None and not np.any(self.surface_compliance)
        if not (smooth and self.material.is_half_space) or not hasattr(self.shape, "analytic"):
            return None
        return self.shape.analytic(self.material.contact_modulus, approach=approach)

    def measure(self, solution: Any) -> dict[str, Any]:
        """Return more numbers of a Solution, those of the shape."""
        return self.shape.measure(solution) if hasattr(self.shape, "measure") else {}

    def describe(self) -> dict[str, Any]:
        """Return data on gap, material, surfaces for result files."""
        own = self.shape.describe()
        if isinstance(self.shape, Problem):  # its material and patch are not used
            own = {name: value for name, value in own.items() if name not in Problem.describe(self.shape)}
        facts = {**super().describe(), **own}
        for surface in self.surfaces:
            reading = {"surface_read": surface.understood(self.grid)} if is_measured(surface) else {}
            for name, value in {**surface.describe(), **reading}.items():
                numbered = chain([name], (f"{name}{k}" for k in count(2)))
                facts[next(key for key in numbered if key not in facts)] = value
        inner = facts.get("surfaces", 0) if isinstance(self.shape, ContactProblem) else 0
        if rough := inner + sum(not isinstance(surface, ResidualSurface) for surface in self.surfaces):
            facts["surfaces"] = rough
        facts["problem"] = self.name
        return facts


del ContactProblem.periodic  # the default of the argument would hide the property
