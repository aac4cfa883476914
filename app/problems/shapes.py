"""Base shapes: smooth bodies, apex at the origin.

Lengths are numbers [mm] or texts with units, such as "10 um".

A shape has `name`, `sampled`, `shape_on` and `describe`, as `app.problems.problem.Problem` has. A shape may have a
method `check_grid`, which raises InputError for a grid that does not fit, and a method `measure` as a problem has.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from app import reference
from app.base.errors import InputError, format_distinct, format_exact, is_number
from app.base.types import ArrayLike, Floats, Length
from app.base.units import to_length
from app.base.usage import usage
from app.halfspace.grid import Grid
from app.reference.base import NormalContact, require_positive


@dataclass(frozen=True)
class Shape:
    """Base of shapes that are functions of x and y."""

    sampled, by_rows = False, True
    _solution = None  # class of `app.reference`, and its parameters

    def _read_lengths(self, **labels):
        """Replace fields by their lengths as floats; `labels` are their names in messages."""
        for field, label in labels.items():
            object.__setattr__(self, field, to_length(label, getattr(self, field)))

    def shape_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return the undeformed distance in `rows`; see `Problem.shape_on`."""
        x, y = grid.x()[None, :], grid.y(rows)[:, None]
        return np.array(np.broadcast_to(self.distance(x, y), (len(y), grid.nx)), order="C")

    def analytic(
        self, contact_modulus: float, approach: float | None = None, load: float | None = None
    ) -> NormalContact | None:
        """Return the analytic solution at an approach or load, None if unknown.

        `contact_modulus` is E* [N/mm2].
        """
        if self._solution is None:
            return None
        kind, *parameters = self._solution
        if load is None:
            return kind.from_approach(*parameters, contact_modulus, approach)
        return kind.from_load(*parameters, contact_modulus, load)

    def describe(self) -> dict[str, Any]:
        """Return the sizes by option names, without infinite ones, for result files."""
        sizes = {f"{self.name}_{f.name}": getattr(self, f.name) for f in fields(self)}
        return {name: size for name, size in sizes.items() if math.isfinite(size)}


@dataclass(frozen=True)
class Plane(Shape):
    """A flat body that extends beyond the patch."""

    name = "rough"

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return np.zeros(np.broadcast(x, y).shape)


@usage("Paraboloid(10, 20), radii of curvature [mm], of a ball Sphere(10)")
@dataclass(frozen=True)
class Paraboloid(Shape):
    """Paraboloid of relative radii rx, ry [mm].

    The undeformed distance is x^2/(2 rx) + y^2/(2 ry), as in the paper's Sec. 5.1. Contact is Hertz's ellipse.

    Examples
    --------
    A ring and a roller whose axes cross at right angles:

    >>> shape = Paraboloid.between((20.0, np.inf), (20.0, np.inf), angle=90)
    >>> round(shape.rx, 12), round(shape.ry, 12)
    (20.0, 20.0)
    """

    rx: float
    ry: float
    bodies: tuple = ()  # radii of body 1, of body 2; angles of body 2's first axis and of x to body 1's

    name = "hertz"

    def __post_init__(self):
        labels = {"rx": "radius of curvature rx", "ry": "radius of curvature ry"}
        self._read_lengths(**labels)
        require_positive(**{label: getattr(self, field) for field, label in labels.items()})

    @classmethod
    def between(
        cls, radii1: Length | Sequence[Length], radii2: Length | Sequence[Length], angle: float = 0.0
    ) -> Self:
        """Return the relative paraboloid of two bodies.

        `radii1` and `radii2` [mm] are the radii of curvature of each body along its first and second axis, or the one
        radius of a ball. The radius inf means straight, a negative radius concave. `angle` [degrees] is the angle from
        the first axis of body 1 to the first axis of body 2.

        The curvatures of both bodies in the direction theta add up to (Johnson, Contact Mechanics, Sec. 4.1)
        ``k(theta) = (s + d1 cos 2 theta + d2 cos 2(theta - angle)) / 2``. Here s is the sum of all four curvatures, and
        d1 and d2 are the differences of the two curvatures of body 1 and body 2. The x axis of the patch is the
        principal direction of k nearest to the first axis of body 1.
        """
        radii1, radii2 = _read_radii(1, radii1), _read_radii(2, radii2)
        if not (is_number(angle) and math.isfinite(angle)):
            raise InputError(f"angle {angle!r} between the bodies: must be a finite number [degree]")
        k1, k2 = (tuple(1 / radius for radius in radii) for radii in (radii1, radii2))
        total, d1, d2 = sum(k1) + sum(k2), k1[0] - k1[1], k2[0] - k2[1]
        twice = math.radians(2 * angle)
        across, along = d2 * math.sin(twice), d1 + d2 * math.cos(twice)
        difference = math.hypot(along, across)
        turn = math.atan2(across, along) / 2 if difference > 1e-14 * max(map(abs, (*k1, *k2))) else 0.0
        if abs(turn) > math.pi / 4:  # x along the axis of least curvature
            turn, difference = turn - math.copysign(math.pi / 2, turn), -difference
        curvatures = (total + difference) / 2, (total - difference) / 2
        if min(curvatures) <= 1e-12 * max(map(abs, (*k1, *k2))):
            one, other = (format_distinct(curvature, 0, 4) for curvature in curvatures)
            raise InputError(
                f"the bodies' relative curvatures are {one} and {other} per mm; must both be positive "
                "(0 is a line contact, see -problem cylinder; a negative one touches at the rim first)"
            )
        bodies = (radii1, radii2, float(angle), math.degrees(turn) + 0.0)
        return cls(1 / curvatures[0], 1 / curvatures[1], bodies)

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return x**2 / (2 * self.rx) + y**2 / (2 * self.ry)

    @property
    def _solution(self):
        return reference.EllipticHertz, self.rx, self.ry

    def describe(self) -> dict[str, Any]:
        """Return relative radii, and the bodies' if known.

        The result file contains them.
        """
        facts = {"hertz_rx": self.rx, "hertz_ry": self.ry}
        if self.bodies:
            radii1, radii2, angle, turn = self.bodies
            facts |= {"body1_radii": list(radii1), "body2_radii": list(radii2)}
            facts |= {"body_angle": angle, "hertz_axes_angle": turn}
        return facts


def _read_radii(body, radii):
    """Return the two radii of a body, given as two lengths or one, as floats [mm]."""
    radii = (radii, radii) if np.ndim(radii) == 0 else radii
    lengths = [to_length(f"radii of body {body}:", radius) for radius in radii]
    if len(lengths) != 2 or not all(abs(length) > 0 for length in lengths):
        raise InputError(
            f"radii of body {body}: must be two numbers, not 0, or one; inf: straight; negative: concave"
        )
    return tuple(lengths)


@usage("Sphere(10), radius [mm]")
class Sphere(Paraboloid):
    """Sphere of radius R [mm], approximated by a paraboloid.

    The error is of the order of the terms that the half-space approximation neglects.
    """

    name = "sphere"

    def __init__(self, radius: Length) -> None:
        radius = to_length("radius", radius)
        require_positive(radius=radius)
        super().__init__(radius, radius)

    def describe(self) -> dict[str, Any]:
        """Return the radius and the data of the paraboloid, for result files."""
        return {"sphere_radius": self.rx, **super().describe()}


@usage("Cylinder(10, length=8) [mm]")
@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder along y; contact is impossible past its ends [mm]."""

    radius: float
    length: float = math.inf

    name = "cylinder"

    def __post_init__(self):
        self._read_lengths(radius="radius", length="length")
        require_positive(radius=self.radius)
        if self.length != math.inf:
            require_positive(length=self.length)

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return np.where(np.abs(y) <= self.length / 2, x**2 / (2 * self.radius), np.nan)

    def check_grid(self, grid: Grid) -> None:
        """Raise if a grid is unsuitable, see `check_length`."""
        if self.length == math.inf:
            check_strip(grid)
        else:
            check_length(grid, "cylinder", self.length, self.length / 2)


@dataclass(frozen=True)
class Cone(Shape):
    """A cone with an `angle` [degrees] between its flank and a plane."""

    angle: float

    name = "cone"

    def __post_init__(self):
        if not (is_number(self.angle) and 0 < self.angle < 90):
            raise InputError(f"angle of the cone {self.angle!r}: must be between 0 and 90 degrees")

    @property
    def slope(self) -> float:
        """Height over radius, the tangent of the angle."""
        return math.tan(math.radians(self.angle))

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return self.slope * np.hypot(x, y)

    @property
    def _solution(self):
        return reference.Cone, self.slope


@dataclass(frozen=True)
class FlatPunch(Shape):
    """A rigid circular punch with a flat end, of a `diameter` [mm].

    This is the punch of the paper's Sec. 5.2, centred at the origin. Contact is impossible outside of the punch.
    """

    diameter: float

    name = "punch"

    def __post_init__(self):
        self._read_lengths(diameter="diameter")
        require_positive(diameter=self.diameter)

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return np.where(x**2 + y**2 <= (self.diameter / 2) ** 2, 0.0, np.nan)

    def check_grid(self, grid: Grid) -> None:
        """Raise if no cell is under the punch."""
        if np.isnan(self.distance(np.abs(grid.x()).min(), np.abs(grid.y()).min())):
            raise InputError(
                f"punch diameter {format_exact(self.diameter)}: no cell centre of the patch lies under the punch"
            )

    @property
    def _solution(self):
        return reference.FlatCircularPunch, self.diameter / 2


def check_length(grid, name, length, half_length):
    """Raise InputError for a grid that is unsuitable for a body along y.

    A grid must not be one cell wide, unless periodic, and must have cells under the body. A period in y must contain
    the whole body.
    """
    check_strip(grid)
    if not (np.abs(grid.y()) <= half_length).any():
        raise InputError(
            f"length of the {name} {format_exact(length)}: no cell centre of the patch lies under it"
        )
    low, high = grid.domain[2:]
    if grid.repeats[0] and max(low + length / 2, length / 2 - high) > grid.dy / 2:
        raise InputError(
            f"length of the {name} {format_exact(length)}: the {name} reaches from y = {format_exact(-length / 2)} to "
            f"{format_exact(length / 2)} mm; it must lie inside the patch, which repeats in y and reaches from "
            f"{format_exact(low)} to {format_exact(high)} mm"
        )


def check_strip(grid):
    """Raise InputError for a patch one cell wide, unless it repeats there.

    Users may expect a line contact, but only a narrow strip would carry pressure.
    """
    narrow = [
        axis
        for n, repeats, axis in zip(grid.shape, grid.repeats, "yx", strict=True)
        if n == 1 and not repeats
    ]
    if narrow:
        raise InputError(
            f"grid {grid.nx},{grid.ny}: a patch one cell wide is a strip pressed on that width only, no line contact; "
            f"for plane strain take the same grid with -periodic {narrow[0]}, or else -problem cylinder with "
            "-cylinder_length on cells in both directions"
        )
