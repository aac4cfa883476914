"""Rollers of finite length with a crown."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.base.errors import InputError, format_exact, is_number
from app.base.types import ArrayLike, Floats
from app.halfspace.grid import Grid
from app.problems.arrays import real_numbers
from app.problems.shapes import Shape, check_length
from app.reference.base import require_positive
from app.reference.line import LineContact

CROWNS = ("none", "log", "arc")
MAX_TILT = 0.1  # rad; slopes must be small
NUMBERS = (  # of a Solution, see `Roller.measure`
    "line_load", "line_pressure", "line_half_width", "edge_factor", "half_width_middle", "half_width_lower_end",
    "half_width_upper_end",
)  # fmt: skip
_NOT_HERTZ = {"background_pressure", "relaxation_times", "surface_compliance"}
_END = 0.1  # share of the length that counts as an end, for the edge factor


@dataclass(frozen=True)
class Roller(Shape):
    """Roller parallel to y, with middle at the origin.

    Contact is impossible on the chamfers and past the ends. The crown is the profile along the roller, between the
    chamfers: the drop z of the surface from its highest line.

    Parameters
    ----------
    radius : float
        Radius in the middle [mm]. For two rollers give the relative radius R, 1/R = 1/R1 + 1/R2.
    length : float
        Length with the chamfers [mm].
    crown : str, callable or array_like, shape (n, 2)
        "none" for a straight roller; "log" for the profile of `app.reference.line.LineContact`, whose pressure is
        nearly uniform along the roller at the design load; "arc" for a parabola. Or a function z(y), or a table of y
        and z [mm]. A table is linear between its rows; if all y are at least 0, it is used for both halves.
    end_chamfer : float
        Axial length of the chamfer at each end [mm].
    design_load : float, optional
        Load at which the pressure under the "log" crown is nearly uniform [N].
    contact_modulus : float, optional
        E* for the "log" crown, `Material.contact_modulus` [N/mm2].
    crown_radius : float, optional
        Radius of the "arc" crown in the middle [mm].
    tilt : float
        Angle between the roller's axis and the flat body [rad]; positive: the end at positive y is pressed in more.

    Examples
    --------
    >>> roller = Roller(10, 16, crown="log", design_load=20000, contact_modulus=115385)
    >>> [round(1000 * float(drop), 2) for drop in roller.distance(0.0, np.array([0.0, 6.0, 8.0]))]
    [0.0, 2.79, 14.7]
    """

    radius: float
    length: float
    crown: str | ArrayLike | Callable[[Floats], ArrayLike] = "none"
    end_chamfer: float = 0.0
    design_load: float | None = None
    contact_modulus: float | None = None
    crown_radius: float | None = None
    tilt: float = 0.0

    name = "roller"

    def __post_init__(self):
        self._read_lengths(radius="radius", length="length", end_chamfer="chamfer of the roller")
        require_positive(radius=self.radius, length=self.length)
        if not 0 <= 2 * self.end_chamfer < self.length:
            raise InputError(
                f"chamfer of the roller {format_exact(self.end_chamfer)}: must be from 0 to less than half its length, "
                f"{format_exact(self.length / 2)} mm"
            )
        if not (is_number(self.tilt) and abs(self.tilt) <= MAX_TILT):
            raise InputError(
                f"tilt of the roller {self.tilt!r}: must be a number from -{MAX_TILT} to {MAX_TILT} rad"
            )
        if isinstance(self.crown, str) and self.crown not in CROWNS:
            raise InputError(
                f"crown of the roller {self.crown!r}: must be one of {', '.join(CROWNS)}, a function z(y), or a table"
            )
        needed = {"log": ("design_load", "contact_modulus"), "arc": ("crown_radius",)}
        needed = needed.get(self.crown, ()) if isinstance(self.crown, str) else ()
        for name in ("design_load", "contact_modulus", "crown_radius"):
            value = getattr(self, name)
            if name in needed and value is None:
                raise InputError(f"crown {self.crown!r} of the roller: needs {name}")
            if name not in needed and value is not None:
                raise InputError(f"{name} of the roller: has no effect with this crown")
        if "crown_radius" in needed:
            self._read_lengths(crown_radius="crown_radius")
        require_positive(**{name: getattr(self, name) for name in needed})
        if not (isinstance(self.crown, str) or callable(self.crown)):
            table = real_numbers("crown of the roller", self.crown)
            object.__setattr__(self, "crown", self._checked_table(table))

    def _checked_table(self, table):
        if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2 or not np.isfinite(table).all():
            raise InputError("crown of the roller: must be a table of two columns, y and z [mm]")
        if (np.diff(table[:, 0]) <= 0).any():
            raise InputError("crown of the roller: y must increase from row to row")
        low, high = table[0, 0], table[-1, 0]
        if (low > 0 if low >= 0 else -low < self.half_length) or high < self.half_length:
            raise InputError(
                f"crown of the roller: y from {format_exact(low)} to {format_exact(high)} mm; must reach "
                f"{format_exact(self.half_length)} mm, and from there to 0 or the other end"
            )
        return tuple(map(tuple, table.tolist()))

    @property
    def half_length(self) -> float:
        """Half the length between the chamfers [mm]."""
        return self.length / 2 - self.end_chamfer

    def line_contact(
        self, contact_modulus: float, approach: float | None = None, load: float | None = None
    ) -> LineContact:
        """Return the roller's `LineContact`, without crown."""
        numbers = self.radius, 2 * self.half_length, contact_modulus
        return LineContact.from_approach(*numbers, approach) if load is None else LineContact(*numbers, load)

    def drop(self, y: ArrayLike) -> Floats:
        """Return the crown's drop at y [mm]; NaN past the ends."""
        y = np.asarray(y, dtype=float)
        inside = np.where(np.abs(y) <= self.half_length, y, np.nan)
        if callable(self.crown):
            within = np.clip(y, -self.half_length, self.half_length)
            return real_numbers("crown of the roller", self.crown(within)) + 0 * inside
        if self.crown == "none":
            return 0 * inside
        if self.crown == "arc":
            return inside**2 / (2 * self.crown_radius)
        if self.crown == "log":
            return self.line_contact(self.contact_modulus, load=self.design_load).crown(inside)
        table = np.array(self.crown)
        return np.interp(np.abs(inside) if table[0, 0] >= 0 else inside, *table.T) + 0 * inside

    def distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at points x, y [mm]."""
        return x**2 / (2 * self.radius) + self.drop(y) - self.tilt * y

    def check_grid(self, grid: Grid) -> None:
        """Raise if a grid is unsuitable, see `check_length`."""
        check_length(grid, "roller", self.length, self.half_length)

    def measure(self, solution: Any) -> dict[str, Any]:
        """Return numbers of a roller by their names, `NUMBERS`. Collective.

        The line load is the load over the length between the chamfers [N/mm]. Hertz's line contact has the line
        pressure [N/mm2] and line half-width [mm] under it; they are unknown for coated, viscoelastic and compliant
        bodies, and with a background pressure. The edge factor is the largest pressure on the last tenth of this length
        at either end, over the line pressure, the nominal one of bearing design. It is about 1 under a good crown, 0 if
        the contact does not reach the ends, and at a sharp end the larger, the finer the grid. The half-widths [mm] are
        those of the cells in contact, in the middle of the roller, and in the first and last row of contact.
        """
        if not solution.contact_cells:
            return {}
        grid, facts = solution.grid, solution.problem
        y, counts, largest = np.abs(grid.y()), np.zeros(grid.ny), np.zeros(grid.ny)
        counts[solution.slabs.rows] = solution.contact.sum(axis=1)
        largest[solution.slabs.rows] = solution.pressure.max(axis=1, initial=0.0)
        from app.parallel.reductions import sum_over  # results are read without MPI

        counts, largest = sum_over(solution.comm, [counts, largest])
        widths, (lower, upper) = counts * grid.dx / 2, np.flatnonzero(counts)[[0, -1]]
        numbers = {
            "line_load": solution.load / (2 * self.half_length),
            "half_width_middle": float(widths[y < y.min() + grid.dy / 2].mean()),
            "half_width_lower_end": float(widths[lower]),
            "half_width_upper_end": float(widths[upper]),
        }
        if "contact_modulus" in facts and not {*facts, *solution.extra} & _NOT_HERTZ:
            line = self.line_contact(facts["contact_modulus"], load=solution.load)
            at_ends = largest[y >= (1 - 2 * _END) * self.half_length].max(initial=0.0)
            numbers |= {"line_pressure": line.max_pressure, "line_half_width": line.a}
            numbers["edge_factor"] = float(at_ends / line.max_pressure)
        return numbers

    def describe(self) -> dict[str, Any]:
        """Return sizes and crown by name, for result files."""
        facts = {"roller_radius": self.radius, "roller_length": self.length}
        table = not (isinstance(self.crown, str) or callable(self.crown))
        facts["roller_crown"] = self.crown if isinstance(self.crown, str) else "profile"
        if table:
            facts["roller_profile"] = [number for row in self.crown for number in row]
        numbers = ("end_chamfer", "design_load", "crown_radius", "tilt")
        return facts | {f"roller_{name}": value for name in numbers if (value := getattr(self, name))}


def read_profile(path):
    """Read a crown's table from a text file.

    The table has two columns: y, and the drop z of the surface [mm].
    """
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123
            rows = [line.replace(",", " ").split("#")[0] for line in file]
        table = np.loadtxt(rows, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"profile {path}: cannot be read: {error}") from None
    return table
