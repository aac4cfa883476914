"""Stress in a half-space below a frictionless pressure.

z points into the body. Both bodies of a contact have the same surface pressure p. The stress depends on Poisson's ratio
of the body, not on Young's modulus. Compression is negative: sigma_zz = -p at z = 0. `stress_sums` has the formulas.

On a free patch the sums are over the bounding box of the loaded cells only. Memory on a free patch: a horizontal plane
needs about twenty arrays, each with as many cells as the patch and the bounding box together. A vertical section needs
a few rows of these arrays.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.base import views
from app.base.arithmetic import in_default_arithmetic
from app.base.errors import InputError, is_number, plain_number
from app.base.types import ArrayLike, Figure, Floats
from app.base.units import format_quantity
from app.halfspace.grid import Grid

COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
_REFINED_PEAKS = 3  # cells below which the depth is refined
_MAX_CELLS_DEEP = 16  # cells: beyond this depth the search uses larger cells
_ROUNDING = 1e-12  # relative rounding error of stresses
_FIRST_DEPTH = 0.25  # first depth of the search below the surface, in cells


@dataclass(frozen=True, repr=False)
class StressMaximum:
    """Stress at the point with the largest von Mises or shear stress.

    Stresses are in N/mm2, lengths in mm. `stress` has the components at the point, in the order of `COMPONENTS`.
    """

    von_mises: float
    x: float
    y: float
    depth: float
    stress: Floats

    def __repr__(self):
        x, y, depth = (format_quantity(length, "mm") for length in (self.x, self.y, self.depth))
        stresses = f"von Mises {self.von_mises:.4g}, shear {self.max_shear:.4g} N/mm2"
        return f"<StressMaximum: {stresses} at x {x}, y {y}, depth {depth}>"

    @property
    def max_shear(self) -> float:
        """Largest shear stress at this point [N/mm2]."""
        return float(max_shear(self.stress))

    @property
    def horizontal_shear(self) -> float:
        """Shear stress on the horizontal plane through this point [N/mm2]."""
        return float(horizontal_shear(self.stress))


def von_mises(stress: ArrayLike) -> Floats:
    """Return the von Mises stress [N/mm2] of `COMPONENTS`, shape (6, ...)."""
    xx, yy, zz, xy, xz, yz = stress
    return np.sqrt(((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * (xy**2 + xz**2 + yz**2))


def max_shear(stress: ArrayLike) -> Floats:
    """Return the largest shear stress [N/mm2] of `COMPONENTS`, shape (6, ...)."""
    xx, yy, zz, xy, xz, yz = stress
    tensors = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*np.shape(xx), 3, 3)
    principal = np.linalg.eigvalsh(tensors)
    return (principal[..., 2] - principal[..., 0]) / 2


def horizontal_shear(stress: ArrayLike) -> Floats:
    """Return the shear stress on horizontal planes [N/mm2]; `stress` has the `COMPONENTS`, shape (6, ...)."""
    return np.hypot(stress[4], stress[5])


def shear_where_large(stress):
    """Return `max_shear` where it may be largest, else 0 to save time."""
    mises = von_mises(stress)
    large = mises >= 0.86 * mises.max()  # The shear stress is 1/2 to 1/sqrt(3) of it.
    shear = np.zeros_like(mises)
    shear[large] = max_shear(stress[:, large])
    return shear


class SubsurfaceStress:
    """Stress at any points below a surface pressure.

    `pressure` has the values on the whole grid, shape (ny, nx) [N/mm2]. `poisson_ratio` is the body's, from 0 to 0.5.
    Raises InputError for invalid numbers.

    Examples
    --------
    >>> from app import Grid
    >>> below = SubsurfaceStress(np.ones((1, 1)), Grid(1, 1, 2.0, 2.0), 0.3)
    >>> below.line([0.0], 1.0, 1.0)[2]  # sigma_zz under the middle of the cell
    array([-1.])
    """

    interface: float | None = None  # depth [mm]

    def __init__(self, pressure: ArrayLike, grid: Grid, poisson_ratio: float) -> None:
        poisson_ratio = plain_number(poisson_ratio)
        if not (is_number(poisson_ratio) and 0 <= poisson_ratio <= 0.5):
            raise InputError(f"Poisson ratio {poisson_ratio}: must be from 0 to 0.5")
        self.nu = float(poisson_ratio)
        self._set_pressure(pressure, grid)

    def _set_pressure(self, pressure, grid):
        pressure = np.asarray(pressure, dtype=float)
        if pressure.shape != grid.shape:
            raise InputError(f"pressure: has shape {pressure.shape}; the grid needs (ny, nx) = {grid.shape}")
        if not np.isfinite(pressure).all():
            raise InputError("pressure: not finite everywhere; a run that diverged has no stresses")
        self.pressure, self.grid = pressure, grid
        self._sums = self._make_sums(pressure, grid)

    def _make_sums(self, pressure, grid):
        # Imported late, so that plots of stresses do not load MPI and numba.
        from app.halfspace.stress.stress_sums import FreeStress, OneWayStress, PeriodicStress

        kind = PeriodicStress if grid.doubly_periodic else OneWayStress if grid.one_way else FreeStress
        return kind(pressure, grid, self.nu)

    def __repr__(self):
        return f"<{type(self).__name__}: below {self.grid.nx} x {self.grid.ny} cells, {self.describe()}>"

    def describe(self, nu: str = "nu") -> str:
        """Return a text on the material of the body; `nu` is the symbol."""
        return f"{nu} = {self.nu:.3g}"

    def include_interface(self, depths: Floats) -> Floats:
        """Return `depths`, with both sides of an interface if they reach it."""
        return depths

    def layer_maxima(self) -> Any:
        """Return a layered body's largest stresses, else None."""
        return None

    def plot(self) -> tuple[Figure, Any]:
        """Draw the stress on two vertical sections and on a vertical line.

        All of them contain the point of the largest von Mises stress. Return figure and axes.
        """
        return views.load().plot_stress(self)

    @in_default_arithmetic
    def plane(self, depth: float) -> Floats:
        """Return the stress on a horizontal plane, below the cell centres.

        The result has the shape (6, ny, nx) [N/mm2], with components in the order of `COMPONENTS`. The depth is in mm.
        """
        return self._sums.plane(_checked(depth))

    @in_default_arithmetic
    def section(self, depths: ArrayLike, x: float | None = None, y: float | None = None) -> Floats:
        """Return the stress on a vertical plane.

        Give either x or y of the plane [mm]. The result has the shape (6, depths, ny or nx) [N/mm2], below the cell
        centres. The depths are in mm.
        """
        if (x is None) == (y is None):
            raise InputError("section: give either x or y of the plane")
        _check_places(**({"x": x} if y is None else {"y": y}))
        depths = check_depths(depths)
        if y is not None:
            return np.stack([self._sums.row(depth, y) for depth in depths], axis=1)
        grid = self.grid
        transposed = replace(grid, nx=grid.ny, ny=grid.nx, dx=grid.dy, dy=grid.dx, x0=grid.y0, y0=grid.x0)
        if grid.one_way:
            transposed = replace(transposed, periodic="x" if grid.one_way == "y" else "y")
        sums = self._make_sums(self.pressure.T, transposed)
        return np.stack([sums.row(depth, x)[[1, 0, 2, 3, 5, 4]] for depth in depths], axis=1)

    @in_default_arithmetic
    def line(self, depths: ArrayLike, x: float, y: float) -> Floats:
        """Return the stress on a vertical line, (6, depths) [N/mm2]; lengths in mm."""
        _check_places(x=x, y=y)
        return np.stack([self._sums.point(depth, x, y) for depth in check_depths(depths)], axis=1)

    @in_default_arithmetic
    def maximum(self) -> StressMaximum:
        """Return the largest von Mises stress, a `StressMaximum`.

        The search compares horizontal planes, down to a depth equal to the width of the loaded part. On deep planes the
        cells are larger. Then the depth of the maximum is refined below the three most stressed cells. Below all other
        cells the depth is not refined; a maximum there would be underestimated by at most 2%. Without pressure the
        returned point is at the surface.
        """
        return self._search(None, von_mises)[0]

    @in_default_arithmetic
    def maxima(self) -> list[StressMaximum]:
        """Return the largest von Mises and shear stress, each a `StressMaximum`."""
        return self._search(None, von_mises, shear_where_large)

    def _search_depths(self):
        """Return the depths of the planes on which maxima are sought [mm]."""
        width, first = max(self._sums.extent), _FIRST_DEPTH * min(self.grid.dx, self.grid.dy)
        count = max(1, int(np.ceil(2 * np.log2(width / first))))
        return np.concatenate([[0.0], width / 2 ** (np.arange(count, -1, -1) / 2)])

    def _search(self, depths, *measures):
        """Return each measure's maximum between depths, a `StressMaximum`.

        A measure is a function of the stress components, such as `von_mises`. Default depths: `_search_depths`.
        """
        sums, grid, peaks = self._sums, self.grid, [[] for _ in measures]
        depths = self._search_depths() if depths is None else depths
        for level, depth in enumerate(depths):
            while depth > _MAX_CELLS_DEEP * max(grid.dx, grid.dy) and (
                coarse := coarsen(sums.pressure, grid)
            ):
                sums, grid = self._make_sums(*coarse), coarse[1]
            stress = sums.plane(depth)
            for k, measure in enumerate(measures):
                field = measure(stress)
                peaks[k] += [(field[j, i], level, grid.x()[i], grid.y()[j]) for j, i in _find_peaks(field)]
        return [self._refine(*pair, depths) for pair in zip(measures, peaks, strict=True)]

    def _refine(self, measure, peaks, depths):
        """Return the maximum of `measure`, refined in depth below the `peaks`."""
        from scipy.optimize import minimize_scalar

        stresses = {}

        def negative(depth, x, y):
            stresses[x, y, depth] = self._sums.point(depth, x, y)
            return -float(measure(stresses[x, y, depth]))

        for _, level, x, y in sorted(peaks, key=lambda peak: -peak[0])[:_REFINED_PEAKS]:
            low, high = depths[max(level - 1, 0)], depths[min(level + 1, len(depths) - 1)]
            negative(depths[level], x, y)
            if high > low:
                settings = {"method": "bounded", "options": {"xatol": 2e-3 * high}}
                minimize_scalar(negative, args=(x, y), bounds=(low, high), **settings)
        place, stress = max(stresses.items(), key=lambda item: measure(item[1]))
        return StressMaximum(float(von_mises(stress)), *map(float, place), stress)


def _checked(depth):
    depth = plain_number(depth)
    if not (is_number(depth) and 0 <= depth < np.inf):
        raise InputError(f"depth {depth!r}: must be 0 or more, and finite")
    return float(depth)


def _check_places(**places):
    for name, place in places.items():
        if not (is_number(place) and np.isfinite(place)):
            raise InputError(f"{name} {place!r}: must be a finite number")


def check_depths(depths):
    """Return valid depths as a list, else raise InputError."""
    depths = [_checked(depth) for depth in np.atleast_1d(depths)]
    if not depths:
        raise InputError("depths: must be at least one")
    return depths


def is_largest(values):
    """Return a mask of the values equal to the maximum within rounding.

    Where the stress is uniform along a direction, rounding alone would choose the place of the largest one.
    """
    largest = values.max()
    return values >= largest - _ROUNDING * abs(largest)


def _find_peaks(field):
    """Return the cells of a field's largest values, without their neighbours.

    Of cells with the same value up to rounding, only the first counts, and all their neighbours are left out.
    """
    rest, peaks = field.copy(), []
    while len(peaks) < _REFINED_PEAKS and rest.max() > -np.inf:
        j, i = np.nonzero(is_largest(rest))
        peaks.append((j[0], i[0]))
        for in_y, in_x in np.ndindex(3, 3):
            near = np.clip(j + in_y - 1, 0, field.shape[0] - 1), np.clip(i + in_x - 1, 0, field.shape[1] - 1)
            rest[near] = -np.inf
    return peaks


def coarsen(pressure, grid):
    """Return pressure and grid with cells twice as large.

    A direction with an odd number of cells keeps its cells. Return None if both directions keep their cells.
    """
    fy, fx = (1 if n % 2 or n < 4 else 2 for n in grid.shape)
    if fx == fy == 1:
        return None
    ny, nx = grid.ny // fy, grid.nx // fx
    joined = pressure.reshape(ny, fy, nx, fx).mean(axis=(1, 3))
    return joined, replace(grid, nx=nx, ny=ny, dx=fx * grid.dx, dy=fy * grid.dy)
