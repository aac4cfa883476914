"""Stress in a half-space below a normal pressure on its surface, without friction.

z points into the body; both bodies of a contact see the same pressure, each from its own side and with its own nu.
Young's modulus does not count. Compression is negative, as usual for stresses: sigma_zz = -p at z = 0.

How it is summed up: `stress_sums`.

Only cells from the first to the last that carry pressure are summed over. A plane takes some twenty arrays of the cells
of the patch and the loaded ones together, a section those of a few rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from app.base.errors import InputError

COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
_STARTS = 3  # cells below which the depth is refined
_SMOOTH = 8  # cells: the search goes on with larger ones from twice this depth on
_FINEST = 0.25  # of a cell: first depth below the surface that is looked at


@dataclass(frozen=True)
class StressMaximum:
    """Where a stress is largest: that of von Mises, or the shear stress.

    Attributes
    ----------
    von_mises, max_shear : float
        There [N/mm2].
    x, y, depth : float
        [mm]
    stress : ndarray, shape (6,), [N/mm2]
        In the order of `COMPONENTS`.
    """

    von_mises: float
    x: float
    y: float
    depth: float
    stress: np.ndarray

    @property
    def max_shear(self):
        """See the class."""
        return float(max_shear(self.stress))


def von_mises(stress):
    """Equivalent stress of von Mises of components (6, ...) [N/mm2]."""
    xx, yy, zz, xy, xz, yz = stress
    return np.sqrt(((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * (xy**2 + xz**2 + yz**2))


def max_shear(stress):
    """Largest shear stress of components (6, ...), half of what principal ones differ [N/mm2]."""
    xx, yy, zz, xy, xz, yz = stress
    tensors = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*np.shape(xx), 3, 3)
    principal = np.linalg.eigvalsh(tensors)
    return (principal[..., 2] - principal[..., 0]) / 2


def _shear_where_large(stress):
    """`max_shear` where it can be largest, else 0: it is 1/2 to 1/sqrt(3) of the von Mises stress."""
    mises = von_mises(stress)
    there = mises >= 0.86 * mises.max()
    shear = np.zeros_like(mises)
    shear[there] = max_shear(stress[:, there])
    return shear


class SubsurfaceStress:
    """Stress below a pressure, wherever it is asked for. No method is collective.

    Parameters
    ----------
    pressure : ndarray, shape (ny, nx), [N/mm2]
        All of it.
    grid : Grid
        Its cells; says whether the patch is periodic.
    poisson_ratio : float
        Of the body looked at, from 0 to 0.5.

    Raises
    ------
    InputError
        If something is out of its range.

    Examples
    --------
    >>> from app import Grid
    >>> below = SubsurfaceStress(np.ones((1, 1)), Grid(1, 1, 2.0, 2.0), 0.3)
    >>> below.line([0.0], 1.0, 1.0)[2]  # sigma_zz under the middle of the cell
    array([-1.])
    """

    def __init__(self, pressure, grid, poisson_ratio):
        pressure = np.asarray(pressure, dtype=float)
        if pressure.shape != grid.shape:
            raise InputError(f"pressure: has shape {pressure.shape}; the grid needs (ny, nx) = {grid.shape}")
        if not np.isfinite(pressure).all():
            raise InputError("pressure: not finite everywhere; a run that diverged has no stresses")
        if not (isinstance(poisson_ratio, Real) and 0 <= poisson_ratio <= 0.5):
            raise InputError(f"Poisson ratio {poisson_ratio}: must be from 0 to 0.5")
        # Not before: who draws stresses need not wait for MPI, FFTs and numba.
        from app.halfspace.stress.stress_sums import Cells, Waves

        self.grid, self.nu = grid, float(poisson_ratio)
        self._below = Waves(pressure, grid, self.nu) if grid.periodic else Cells(pressure, grid, self.nu)

    def __repr__(self):
        return f"<SubsurfaceStress: below {self.grid.nx} x {self.grid.ny} cells, Poisson ratio {self.nu:g}>"

    def plane(self, depth):
        """Stress on a horizontal plane below the cell centres.

        Returns
        -------
        ndarray, shape (6, ny, nx), [N/mm2]
            In the order of `COMPONENTS`.
        """
        return self._below.plane(_checked(depth))

    def section(self, depths, x=None, y=None):
        """Stress on a vertical plane: along x through `y`, or along y through `x`; give one of the two [mm].

        Returns
        -------
        ndarray, shape (6, depths, nx or ny), [N/mm2]
            Below the cell centres.
        """
        if (x is None) == (y is None):
            raise InputError("section: give either x or y of the plane")
        _check_places(**({"x": x} if y is None else {"y": y}))
        return np.stack([self._below.row(depth, x, y) for depth in _depths(depths)], axis=1)

    def line(self, depths, x, y):
        """Stress on a vertical line [mm].

        Returns
        -------
        ndarray, shape (6, depths), [N/mm2]
        """
        _check_places(x=x, y=y)
        return np.stack([self._below.point(depth, x, y) for depth in _depths(depths)], axis=1)

    def depths_to_search(self):
        """Depths at which `maximum` looks at whole planes [mm]: the surface, then by factors of sqrt 2."""
        extent = max(self._below.extent)
        first = _FINEST * min(self.grid.dx, self.grid.dy)
        steps = max(1, int(np.ceil(2 * np.log2(extent / first))))
        return np.concatenate([[0.0], extent / 2 ** (np.arange(steps, -1, -1) / 2)])

    def maximum(self):
        """Find the largest von Mises stress.

        Planes down to the width of the loaded part are looked at, one at a time, deep ones on larger cells; then the
        depth is refined below the most stressed cells of all. Before that an asperity's own maximum is missed by 2% at
        the most.

        Returns
        -------
        StressMaximum
            At the surface without pressure.
        """
        return self._search(von_mises)[0]

    def maxima(self):
        """Find the largest von Mises stress and the largest shear stress, in one search; see `maximum`.

        Returns
        -------
        StressMaximum, StressMaximum
        """
        return self._search(von_mises, _shear_where_large)

    def _search(self, *measures):
        """Where each of some measures of the stress is largest."""
        depths, found = self.depths_to_search(), [[] for _ in measures]
        below, grid = self._below, self.grid
        for level, depth in enumerate(depths):
            while depth > 2 * _SMOOTH * max(grid.dx, grid.dy) and (halved := _halved(below.pressure, grid)):
                pressure, grid = halved
                below = type(below)(pressure, grid, self.nu)
            stress = below.plane(depth)
            for measure, peaks in zip(measures, found, strict=True):
                field = measure(stress)
                peaks += [(field[j, i], level, grid.x()[i], grid.y()[j]) for j, i in _peaks(field)]
        return [self._refined(measure, peaks, depths) for measure, peaks in zip(measures, found, strict=True)]

    def _refined(self, measure, peaks, depths):
        """Largest of a measure below the highest peaks of the search, near their depths."""
        from scipy.optimize import minimize_scalar

        looked_at = {}

        def deficit(depth, x, y):
            looked_at[x, y, depth] = self._below.point(depth, x, y)
            return -float(measure(looked_at[x, y, depth]))

        for _, level, x, y in sorted(peaks, key=lambda peak: -peak[0])[:_STARTS]:
            low, high = depths[max(level - 1, 0)], depths[min(level + 1, len(depths) - 1)]
            deficit(depths[level], x, y)
            if high > 0:
                how = {"method": "bounded", "options": {"xatol": 2e-3 * high}}
                minimize_scalar(deficit, args=(x, y), bounds=(low, high), **how)
        place, stress = max(looked_at.items(), key=lambda item: measure(item[1]))
        return StressMaximum(float(von_mises(stress)), *map(float, place), stress)


def _checked(depth):
    if not (isinstance(depth, Real) and 0 <= depth < np.inf):
        raise InputError(f"depth {depth!r}: must be 0 or more, and finite")
    return float(depth)


def _check_places(**places):
    for name, place in places.items():
        if not (isinstance(place, Real) and np.isfinite(place)):
            raise InputError(f"{name} {place!r}: must be a finite number")


def _depths(depths):
    found = [_checked(depth) for depth in np.atleast_1d(depths)]
    if not found:
        raise InputError("depths: needed: one at least")
    return found


def _peaks(field):
    """Cells of the largest values that are no neighbours of each other."""
    most = min(field.size, 50 * _STARTS)
    order = np.argpartition(field, -most, axis=None)[-most:]
    found, order = [], order[np.argsort(field.ravel()[order])[::-1]]
    for cell in zip(*np.unravel_index(order, field.shape), strict=True):
        if all(max(abs(cell[0] - j), abs(cell[1] - i)) > 1 for j, i in found):
            found.append(cell)
    return found[:_STARTS]


def _halved(pressure, grid):
    """Pressure and grid of cells joined by two; None where that is not possible."""
    fy, fx = (1 if n % 2 or n < 4 else 2 for n in grid.shape)
    if fx == fy == 1:
        return None
    ny, nx = grid.ny // fy, grid.nx // fx
    joined = pressure.reshape(ny, fy, nx, fx).mean(axis=(1, 3))
    return joined, replace(grid, nx=nx, ny=ny, dx=fx * grid.dx, dy=fy * grid.dy)
