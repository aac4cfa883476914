"""Grids of cells on the potential contact area.

A grid has ``nx * ny`` equal rectangular cells, numbered row by row (x fastest). A field is an array of shape
``(ny, nx)``. A rank owns a *slab*: consecutive whole rows.

Coarsening joins 2 x 2 cells (paper, Sec. 4.2). A direction of at most `coarsest` cells is not coarsened. If a direction
has an odd number of cells, half of the last coarse cell is outside the patch. The fine cells that this coarse cell
lacks are treated as inadmissible (contact is impossible there). The result is the same as with a padded patch, but the
padding is not stored.

In a direction in which the patch repeats, it has no outside. If it has an odd number of cells there, coarse cells are a
little shorter than two fine cells. Coarse cell k has the fine cells 2 k and 2 k + 1 as children, also on periodic
patches; the last coarse cell has one child. The coarse grid begins half a fine cell later, so that the centre of each
coarse cell is at most half a fine cell from the middle of its children.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from operator import index
from typing import Self

import numpy as np

from app.base.errors import InputError, format_exact
from app.base.types import Floats, Length
from app.base.units import to_length
from app.base.usage import usage

SYMBOLS = ("spectral", "love")  # names of the influence matrices of a patch periodic in x and y
ONE_WAY = ("x", "y")  # directions of a patch that is periodic in one of them


def validate_periodic(periodic):
    """Return a periodic patch's symbol name or direction, otherwise "".

    The symbol gives the eigenvalues of the influence matrix of a patch that is periodic in x and y. `periodic` is one
    of `SYMBOLS` or `ONE_WAY`, or True for the first symbol; False and "" mean a patch that is not periodic. Raises
    InputError for anything else.
    """
    name = SYMBOLS[0] if periodic is True else periodic or ""
    if name and name not in (*SYMBOLS, *ONE_WAY):
        allowed = ", ".join(map(repr, (*ONE_WAY, *SYMBOLS)))
        raise InputError(f"periodic: {periodic!r}; must be True, False, {allowed}")
    return name


def repeats_in(periodic):
    """Return two bools: whether a patch repeats in y, and in x.

    `periodic` is a value of ``Grid.periodic``.
    """
    return (periodic != "x", periodic != "y") if periodic else (False, False)


@usage("Grid.from_domain(128, 128, (-1, 1, -1, 1)): cells in x and y; x0, x1, y0, y1 [mm]")
@dataclass(frozen=True)
class Grid:
    """Grid of rectangular cells; lengths in mm.

    Raises InputError if a number is invalid.

    Attributes
    ----------
    nx, ny : int
        Number of cells in x and y.
    dx, dy : float
        Size of a cell [mm], or a text with a unit.
    x0, y0 : float
        Lower left corner of the patch, as well.
    periodic : str
        "x" or "y" if the patch repeats in this direction only. If it repeats in both, the name of the symbol that
        defines its influence matrix (`app.halfspace.periodic_symbol`). Empty for a free patch.
    """

    nx: int
    ny: int
    dx: float
    dy: float
    x0: float = 0.0
    y0: float = 0.0
    periodic: str = ""

    def __post_init__(self):
        checked = dict(zip(("nx", "ny"), _cells(self.nx, self.ny), strict=True))
        try:
            checked |= {name: to_length(name, getattr(self, name)) for name in ("dx", "dy", "x0", "y0")}
        except InputError:
            checked["dx"] = np.nan
        numbers = list(checked.values())[2:]
        if not (all(map(isfinite, numbers)) and min(numbers[:2]) > 0):
            raise InputError(
                f"grid: cells of {self.dx} x {self.dy} mm, corner at {self.x0}, {self.y0}: "
                "must be finite numbers, and positive sizes"
            )
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "periodic", validate_periodic(self.periodic))

    @classmethod
    @usage("Grid.from_domain(128, 128, (-1, 1, -1, 1)): cells in x and y; x0, x1, y0, y1 [mm]")
    def from_domain(cls, nx: int, ny: int, domain: Sequence[Length], periodic: bool | str = False) -> Self:
        """Divide a patch ``(x0, x1, y0, y1)`` into cells.

        `periodic` is True, False, one of `SYMBOLS`, or one of `ONE_WAY`. Raises InputError for invalid numbers.
        """
        nx, ny = _cells(nx, ny)
        try:
            x0, x1, y0, y1 = (to_length("domain", side) for side in domain)
        except (TypeError, ValueError):
            wanted = "four numbers (x0, x1, y0, y1) [mm], or texts with units"
            raise InputError(f"domain {domain!r}: must be {wanted}") from None
        if not (np.isfinite([x0, x1, y0, y1]).all() and x1 > x0 and y1 > y0):
            sides = ",".join(map(format_exact, (x0, x1, y0, y1)))
            raise InputError(f"domain {sides}: must be finite, with x0 < x1 and y0 < y1")
        return cls(nx, ny, (x1 - x0) / nx, (y1 - y0) / ny, x0, y0, periodic)

    @cached_property
    def symbol(self) -> str:
        """Name of the symbol of a patch periodic in x and y, else empty."""
        return self.periodic if self.doubly_periodic else ""

    @cached_property
    def doubly_periodic(self) -> bool:
        """Whether the patch is periodic in x and in y."""
        return self.periodic in SYMBOLS

    @cached_property
    def one_way(self) -> str:
        """Direction of a patch periodic in one direction, else empty."""
        return self.periodic if self.periodic in ONE_WAY else ""

    @cached_property
    def repeats(self) -> tuple[bool, bool]:
        """Whether the patch repeats, in y and in x."""
        return repeats_in(self.periodic)

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Shape ``(ny, nx)`` of a field on this grid."""
        return self.ny, self.nx

    @cached_property
    def n(self) -> int:
        """Number of cells."""
        return self.nx * self.ny

    @cached_property
    def cell_area(self) -> float:
        """Area of a cell [mm2]."""
        return self.dx * self.dy

    @cached_property
    def sides(self) -> tuple[float, float]:
        """Lengths of the patch in x and in y [mm]."""
        return self.nx * self.dx, self.ny * self.dy

    @property
    def widest_cell(self) -> float:
        """Largest cell side [mm], ignoring repeated directions with one cell.

        In such a direction the pressure does not vary.
        """
        sides = zip((self.dy, self.dx), self.shape, self.repeats, strict=True)
        return max(side if n > 1 or not repeats else 0.0 for side, n, repeats in sides)

    @property
    def domain(self) -> tuple[float, float, float, float]:
        """The patch as x0, x1, y0, y1 [mm]."""
        width, height = self.sides
        return self.x0, self.x0 + width, self.y0, self.y0 + height

    @property
    def area(self) -> float:
        """Area of the patch [mm2]."""
        return self.n * self.cell_area

    def x(self) -> Floats:
        """Return cell centres in x, shape ``(nx,)`` [mm]."""
        return self.x0 + (np.arange(self.nx) + 0.5) * self.dx

    def y(self, rows: slice = slice(None)) -> Floats:
        """Return cell centres in y [mm], by default all."""
        return (self.y0 + (np.arange(self.ny) + 0.5) * self.dy)[rows]

    def refine(self) -> Self:
        """Return the grid with cells of half the size."""
        return replace(self, nx=2 * self.nx, ny=2 * self.ny, dx=self.dx / 2, dy=self.dy / 2)

    def coarsening(self, coarsest: int = 4) -> tuple[int, ...]:
        """Return ``(fy, fx)``: 2 in directions of more than `coarsest` cells, else 1."""
        return tuple(2 if n > coarsest else 1 for n in self.shape)

    def coarsen(self, coarsest: int = 4) -> Self | None:
        """Return the next coarser grid.

        Directions of at most `coarsest` cells are not coarsened. Return None if neither direction is coarsened.
        """
        if self.coarsening(coarsest) == (1, 1):
            return None

        def halve(n, d, start, repeats):
            if n <= coarsest:
                return n, d, start
            cells = -(-n // 2)
            return (cells, n * d / cells, start + d / 2) if repeats and n % 2 else (cells, 2 * d, start)

        in_y, in_x = self.repeats
        nx, dx, x0 = halve(self.nx, self.dx, self.x0, in_x)
        ny, dy, y0 = halve(self.ny, self.dy, self.y0, in_y)
        return replace(self, nx=nx, ny=ny, dx=dx, dy=dy, x0=x0, y0=y0)

    def places_in(self, coarse: "Grid") -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the positions of this grid's cell centres in a coarser grid.

        The positions are given by two pairs (a, b), the first for y and the second for x. The centre of cell j is
        ``a j + b`` coarse cells from the first coarse centre.
        """
        in_y = (self.dy / coarse.dy, (self.y0 - coarse.y0 + (self.dy - coarse.dy) / 2) / coarse.dy)
        in_x = (self.dx / coarse.dx, (self.x0 - coarse.x0 + (self.dx - coarse.dx) / 2) / coarse.dx)
        return in_y, in_x


def plan_grids(grid, coarsest=4, target_only=False):
    """Return the list of grids of a hierarchy, the target `grid` first.

    Directions of at most `coarsest` cells are not coarsened. If no direction is longer, there is still one coarser
    grid. With `target_only` there are no coarser grids.
    """
    grids = [grid]
    most = 1 if target_only else grid.n  # grids
    if not target_only and grid.coarsen(coarsest) is None:
        coarsest, most = 1, 2  # a multigrid method needs two grids
    while len(grids) < most and (coarser := grids[-1].coarsen(coarsest)) is not None:
        if coarser.doubly_periodic and coarser.n == 1:
            break  # A of a single periodic cell is zero
        grids.append(coarser)
    return grids


def _cells(nx, ny):
    try:
        cells = index(nx), index(ny)
    except TypeError:
        raise InputError(f"grid {nx},{ny}: must be whole numbers of cells") from None
    if min(cells) < 1:
        raise InputError(f"grid {nx},{ny}: must be at least one cell in each direction")
    return cells


def row_blocks(rows, columns, cells=1 << 16):
    """Return slices of an array's rows, of about `cells` cells each."""
    step = max(1, cells // max(columns, 1))
    return (slice(start, min(start + step, rows)) for start in range(0, rows, step))
