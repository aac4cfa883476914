"""Base class of contact problems.

The paper's undeformed distance h(x, y) is ``shape - approach``, and its delta is ``approach`` [mm]. `shape` is the
distance at zero approach. It is NaN in *inadmissible* cells, where contact is impossible, such as outside a punch or at
holes in measured data.
"""

from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from app.base.errors import InputError
from app.base.types import Floats
from app.halfspace.compliant_kernel import CompliantKernel
from app.halfspace.grid import Grid
from app.halfspace.kernel import Kernel
from app.halfspace.material import Material
from app.halfspace.one_way_kernel import patch_kernel
from app.problems.arrays import check_size, real_numbers
from app.reference.base import NormalContact

_BLOCK = 1 << 20  # cells of the rows that are evaluated at a time


@dataclass(frozen=True)
class Problem:
    """A patch of cells, a material and a shape, which subclasses define.

    If `sampled` is true, coarse grids average the shape on the target grid; else `shape_on` is called for each grid. If
    `by_rows` is true, it is called for some rows at a time, so that its work arrays are small.
    """

    grid: Grid
    material: Material

    name = ""
    sampled = by_rows = False
    # Largest and least pressure [N/mm2], numbers or arrays of shape (ny, nx); None: no limit, and 0.
    hardness = None  # type: Any
    background_pressure = None  # type: Any
    # Displacement of a cell by its own pressure [mm / (N/mm2)], a number or an array of shape (ny, nx).
    surface_compliance = 0.0  # type: Any
    # Permanent indentation of earlier loads [mm], an array of shape (ny, nx); None without one.
    indentation = None  # type: Floats | None
    notes = ()  # type: tuple[str, ...]  # doubts for the user, one line each

    def shape_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return the undeformed distance of the cells in `rows`.

        The array of shape (rows, nx) has the distance in cell centres at zero approach [mm], NaN where contact is
        impossible.
        """
        raise NotImplementedError(f"{type(self).__name__}.shape_on")

    def fits(self, other: object) -> bool:
        """Return whether a problem has equal grid, material and surface compliance."""
        same = isinstance(other, Problem) and (other.grid, other.material) == (self.grid, self.material)
        return same and np.array_equal(other.surface_compliance, self.surface_compliance)

    @property
    def kernel(self) -> Kernel:
        """Kernel of the bodies on this patch, with the part of the surface compliance that all cells have.

        On a periodic patch, where displacements by the kernel have no mean, a surface compliance that varies is left
        out.
        """
        kernel, compliance = patch_kernel(self.material.kernel, self.grid), self.surface_compliance
        if np.ndim(compliance):
            compliance = 0.0 if self.grid.doubly_periodic else float(np.min(compliance))
        return CompliantKernel(kernel, compliance) if compliance else kernel

    @property
    def compliance(self) -> Floats | None:
        """Surface compliance of each cell that the kernel leaves out, shape (ny, nx), or None."""
        if np.ndim(self.surface_compliance) == 0:
            return None
        return np.asarray(self.surface_compliance) - getattr(self.kernel, "surface_compliance", 0.0)

    def fields(self, rows: slice) -> dict[str, Floats]:
        """Return hardness and surface compliance by name if they are arrays, shape (rows, nx)."""
        laws = {name: getattr(self, name) for name in ("hardness", "surface_compliance")}
        return {name: np.asarray(values)[rows] for name, values in laws.items() if np.ndim(values)}

    @property
    def periodic(self) -> str:
        """`periodic` of the grid, see `Grid`."""
        return self.grid.periodic

    @property
    def refinable(self) -> bool:
        """True if the shape exists on finer grids."""
        return not self.sampled and not self._varies

    @property
    def _varies(self):
        laws = self.hardness, self.background_pressure, self.surface_compliance
        return any(map(np.ndim, laws))

    def on(self, grid: Grid) -> Self:
        """Return the same problem on the grid `grid`."""
        other = copy(self)
        object.__setattr__(other, "grid", grid)
        return other

    def reference(self, approach: float) -> NormalContact | None:
        """Return the analytic solution, None if unknown."""
        return None

    def measure(self, solution: Any) -> dict[str, Any]:
        """Return more numbers of a `Solution` by name, for its attributes and files. Collective."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return names and values that describe the problem in result files."""
        return {
            "problem": self.name,
            **self.material.describe(),
            "periodic": self.grid.one_way or int(bool(self.grid.periodic)),
            "periodic_symbol": self.grid.symbol,
            **{
                name: value
                for name in ("hardness", "background_pressure", "surface_compliance")
                if np.ndim(value := getattr(self, name)) == 0 and value
            },
        }


def evaluate_shape(problem, grid, rows):
    """Return what `Problem.shape_on` returns, as a checked float64 copy.

    Raises InputError unless these are real numbers of shape (rows, nx).
    """
    first, stop, _ = rows.indices(grid.ny)
    step = max(_BLOCK // grid.nx, 1)
    if not problem.by_rows or stop - first <= step:
        return _evaluate_rows(problem, grid, rows)
    shape = np.empty((stop - first, grid.nx))
    for start in range(first, stop, step):
        some = slice(start, min(start + step, stop))
        shape[some.start - first : some.stop - first] = _evaluate_rows(problem, grid, some)
    return shape


def _evaluate_rows(problem, grid, rows):
    expected = len(range(*rows.indices(grid.ny))), grid.nx
    if not expected[0]:
        return np.empty(expected)
    label = f"problem {problem.name}"
    shape = real_numbers(
        label, problem.shape_on(grid, rows), "undeformed distances, an array of real numbers"
    )
    if shape.shape != expected:
        raise InputError(
            f"{label}: undeformed distances of shape {shape.shape}; must be (rows, nx) = {expected}"
        )
    check_size(label, shape, rows.start or 0)
    return np.ascontiguousarray(shape)
