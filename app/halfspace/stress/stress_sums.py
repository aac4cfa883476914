"""Sums of stresses over waves or cells.

- Periodic patch: with q = (qx, qy), n = q / |q|, depth z and s = |q| z, the pressure wave p exp(i q x) makes the
  stress components

      xx  -p (nx^2 (1 - s) + 2 nu ny^2) e^-s      xy  -p nx ny (1 - s - 2 nu) e^-s
      yy  -p (ny^2 (1 - s) + 2 nu nx^2) e^-s      xz  i p nx s e^-s
      zz  -p (1 + s) e^-s                         yz  i p ny s e^-s

  The mean pressure p compresses a body that cannot expand sideways: xx = yy = -nu / (1 - nu) p, zz = -p. The same
  formulas are used for both periodic symbols, ``spectral`` and ``love``, because the stresses agree at depths of more
  than a cell.
- Free patch: the stress below a uniformly loaded rectangle has a closed form (Love 1929). Zero-padded FFTs sum the
  stresses of all cells. The result is exact for a pressure that is constant on cells.
- Patch periodic in one direction: the mean along the period acts as in plane strain, with closed forms for strips. The
  rest decays within a period across it, so it is computed as on a periodic patch, widened by a few periods.

References
----------
A. E. H. Love, Phil. Trans. R. Soc. A 228 (1929) 377. K. L. Johnson, Contact Mechanics, 1985, Sec. 3.2 and 13.2.
"""

from dataclasses import replace
from math import atan2, log, pi, sqrt

import numpy as np
import scipy.fft

from app.base.numba_cache import njit
from app.halfspace.periodic_symbol import wave_numbers

_ODD_X, _ODD_Y = (3, 4), (3, 5)  # indices of the components that change sign with x, and with y
_GAP_PERIODS = 4.0  # periods added across the period; over these a wave decays by exp(-2 pi 4)
_BLOCK_ROWS = 64  # rows of a kernel that are transformed together
_EDGE_TOLERANCE = 1e-9  # distance, in cells, up to which a point counts as on the edge


class PeriodicStress:
    """Stress below a periodic patch [N/mm2]; lengths in mm."""

    def __init__(self, pressure, grid, nu):
        self.grid, self.nu, self.pressure = grid, nu, pressure
        self.extent = grid.sides
        self._transform = scipy.fft.rfft2(pressure, norm="forward")
        qx, qy = wave_numbers(grid, np.arange(grid.nx // 2 + 1), scipy.fft.fftfreq(grid.ny, 1 / grid.ny))
        self._q = np.hypot(qx, qy[:, None])
        length = np.where(self._q > 0, self._q, 1.0)
        self._direction = [qx / length, qy[:, None] / length]
        # Odd components of a sawtooth wave are zero at the cell centres.
        self._odd = [np.where(2 * np.arange(grid.nx // 2 + 1) == grid.nx, 0.0, 1.0),
                     np.where(2 * np.arange(grid.ny) == grid.ny, 0.0, 1.0)[:, None]]  # fmt: skip

    def _functions(self, depth):
        """Return the stress function of unit waves, two derivatives, and Poisson's ratio.

        They are functions of the wave number times the depth; `app.halfspace.layer_waves` defines them.
        """
        s = self._q * depth
        decay = np.exp(-s)
        return (1 + s) * decay, -s * decay, (s - 1) * decay, self.nu

    def _waves(self, depth):
        """Yield the transform of each stress component."""
        p, (nx, ny), (odd_x, odd_y) = self._transform, self._direction, self._odd
        value, slope, curvature, nu = self._functions(depth)
        across = nu * (curvature - value)  # stress normal to the plane of a wave
        mean = -nu / (1 - nu) * p[0, 0]
        for along, other in ((nx, ny), (ny, nx)):
            field = p * (along**2 * curvature + other**2 * across)
            field[0, 0] = mean
            yield field
        yield -p * value
        yield p * (nx * ny * (curvature - across) * odd_x * odd_y)
        yield -1j * p * (nx * slope * odd_x)
        yield -1j * p * (ny * slope * odd_y)

    def plane(self, depth):
        """Return stress on a horizontal plane, (6, ny, nx)."""
        return np.stack([scipy.fft.irfft2(w, self.grid.shape, norm="forward") for w in self._waves(depth)])

    def _phase_y(self, y):
        rows = scipy.fft.fftfreq(self.grid.ny, 1 / self.grid.ny)
        phase = np.exp(2j * np.pi * rows * (y - self.grid.y()[0]) / self.extent[1])
        return np.where(2 * rows == -self.grid.ny, phase.real, phase)  # a sawtooth wave has a real phase

    def row(self, depth, y):
        """Return stress on a line along x, (6, nx)."""
        phase, nx = self._phase_y(y), self.grid.nx
        return np.stack([scipy.fft.irfft(phase @ w, nx, norm="forward") for w in self._waves(depth)])

    def _phase_x(self, x):
        columns = np.arange(self.grid.nx // 2 + 1)
        multiplicity = np.where((columns == 0) | (2 * columns == self.grid.nx), 1.0, 2.0)
        return multiplicity * np.exp(2j * np.pi * columns * (x - self.grid.x()[0]) / self.extent[0])

    def point(self, depth, x, y):
        """Return stress components at a point, shape (6,)."""
        in_x, in_y = self._phase_x(x), self._phase_y(y)
        return np.array([(in_y @ w @ in_x).real for w in self._waves(depth)])


class FreeStress:
    """Stress below a free patch [N/mm2]; lengths in mm."""

    def __init__(self, pressure, grid, nu):
        self.grid, self.nu, self.pressure = grid, nu, pressure
        loaded = [np.flatnonzero(pressure.any(axis=axis)) for axis in (1, 0)]
        rows, columns = (slice(k[0], k[-1] + 1) if k.size else slice(0, 1) for k in loaded)
        self._loaded = np.ascontiguousarray(pressure[rows, columns])
        self._x, self._y = grid.x()[columns], grid.y()[rows]
        self._first = rows.start, columns.start
        ny, nx = self._loaded.shape
        self.extent = nx * grid.dx, ny * grid.dy

    def _corners(self, x, y, depth):
        """Return the stress due to corners, (6, y.size, x.size); see `_corner`."""
        corners = np.empty((6, y.size, x.size))
        fill_corners(x, y, depth, self.nu, corners)
        return corners

    def plane(self, depth):
        """Return stress on a horizontal plane, (6, ny, nx)."""
        grid, (rows, columns) = self.grid, self._loaded.shape
        # Offsets of the cells of the patch from the loaded cells.
        lengths = grid.ny + rows - 1, grid.nx + columns - 1
        padded = [scipy.fft.next_fast_len(n, real=True) for n in lengths]
        mirror_y, mirror_x = map(_Mirror, 1 - np.array(self._first) - (rows, columns), lengths)
        corners = self._corners(mirror_x.edge(grid.dx), mirror_y.edge(grid.dy), depth)
        transform = scipy.fft.rfft2(self._loaded, padded)
        out = np.empty((6, *grid.shape))
        for k, field in enumerate(out):
            kernel = mirror_y.difference(mirror_x.difference(corners[k], 1, k in _ODD_X), 0, k in _ODD_Y)
            product = scipy.fft.irfft2(scipy.fft.rfft2(kernel, padded) * transform, padded)
            field[...] = product[rows - 1 : rows - 1 + grid.ny, columns - 1 : columns - 1 + grid.nx]
        return out

    def row(self, depth, y):
        """Return stress on a line along x, (6, nx)."""
        grid, loaded = self.grid, self._loaded.shape[1]
        count = grid.nx + loaded - 1
        padded = scipy.fft.next_fast_len(count, real=True)
        mirror = _Mirror(1 - self._first[1] - loaded, count)
        edges = _edges(y - self._y, grid.dy)
        transform = scipy.fft.rfft(self._loaded, padded)
        sums = np.zeros((6, padded // 2 + 1), complex)
        for first in range(0, len(transform), _BLOCK_ROWS):
            sides = edges[first : first + _BLOCK_ROWS + 1]
            for k, part in enumerate(self._corners(mirror.edge(grid.dx), sides, depth)):
                kernel = scipy.fft.rfft(mirror.difference(-np.diff(part, axis=0), 1, k in _ODD_X), padded)
                sums[k] += np.einsum("jk,jk->k", kernel, transform[first : first + _BLOCK_ROWS])
        return scipy.fft.irfft(sums, padded)[:, loaded - 1 : count]

    def point(self, depth, x, y):
        """Return stress components at a point, shape (6,)."""
        x, y = _edges(x - self._x, self.grid.dx), _edges(y - self._y, self.grid.dy)
        corners = self._corners(x, y, depth)
        return np.einsum("kji,ji->k", np.diff(np.diff(corners, axis=1), axis=2), self._loaded)


class OneWayStress:
    """Stress below a patch periodic in one direction [N/mm2]; lengths in mm."""

    def __init__(self, pressure, grid, nu):
        self.grid, self.nu, self.pressure = grid, nu, pressure
        self.extent = grid.sides
        self._along = "yx".index(grid.one_way)  # axis of the period
        self._mean = pressure.mean(axis=self._along)
        size, length = (grid.dx, grid.sides[1]) if self._along == 0 else (grid.dy, grid.sides[0])
        gap = int(np.ceil(_GAP_PERIODS * length / size))
        count = scipy.fft.next_fast_len(self._mean.size + gap, real=True)
        shape = (grid.ny, count) if self._along == 0 else (count, grid.nx)
        padded = np.zeros(shape)
        padded[: grid.ny, : grid.nx] = pressure - np.expand_dims(self._mean, self._along)
        wide = replace(grid, ny=shape[0], nx=shape[1], periodic="spectral")
        self._waves = self._make_waves(padded, wide)

    def _make_waves(self, pressure, grid):
        return PeriodicStress(pressure, grid, self.nu)

    def _strip_edges(self, x, depth):
        """Return stresses xx, zz and xz of line forces from 0 to x, and Poisson's ratio."""
        return _strip_edge(x, depth), self.nu

    def _of_strips(self, depth, at=None):
        """Return the stress due to strips of uniform pressure, on all cells or at the coordinate `at`."""
        grid, n = self.grid, self._mean.size
        size, centres = (grid.dx, grid.x()) if self._along == 0 else (grid.dy, grid.y())
        offsets = size * np.arange(1 - n, n) if at is None else at - centres
        (low, nu), (high, _) = (self._strip_edges(offsets + side * size / 2, depth) for side in (-1, 1))
        inside = slice(n - 1, 2 * n - 1)
        parts = (np.convolve(self._mean, k)[inside] if at is None else k @ self._mean for k in high - low)
        across, zz, shear = parts
        along, none = nu * (across + zz), 0 * across
        if self._along == 0:
            return np.stack([across, along, zz, none, shear, none])
        return np.stack([along, across, zz, none, none, shear])

    def plane(self, depth):
        """Return stress on a horizontal plane, (6, ny, nx)."""
        waves = self._waves.plane(depth)[:, : self.grid.ny, : self.grid.nx]
        return waves + np.expand_dims(self._of_strips(depth), 1 + self._along)

    def row(self, depth, y):
        """Return stress on a line along x, (6, nx)."""
        strips = self._of_strips(depth) if self._along == 0 else self._of_strips(depth, y)[:, None]
        return self._waves.row(depth, y)[:, : self.grid.nx] + strips

    def point(self, depth, x, y):
        """Return stress components at a point, shape (6,)."""
        return self._waves.point(depth, x, y) + self._of_strips(depth, x if self._along == 0 else y)


def _strip_edge(x, z):
    """Integrate stresses xx, zz, xz of line forces from 0 to x."""
    squares = x * x + z * z
    ratio = np.divide(x * z, squares, out=np.zeros_like(x), where=squares > 0)
    share = np.divide(z * z, squares, out=np.zeros_like(x), where=squares > 0)
    angle = np.arctan2(x, z)
    return np.stack([ratio - angle, -ratio - angle, share]) / np.pi


def _edges(offsets, step):
    """Return a point's offsets from cell edges [mm].

    `offsets` are the offsets from the cell centres, `step` is the side of a cell. Stresses at the surface jump between
    cells. So a point that is on an edge, except for rounding, is placed exactly on it, and gets the mean of both sides.
    """
    edges = np.append(offsets + step / 2, offsets[-1] - step / 2)
    edges[np.abs(edges) < _EDGE_TOLERANCE * step] = 0.0
    return edges


class _Mirror:
    """Differences of a function between the two edges of each cell.

    There are `count` cells along one axis; the first has an offset of `first` cells. The function is computed only at
    positive edges; symmetry gives its values at negative edges.
    """

    def __init__(self, first, count):
        edge = np.arange(first - 1, first + count)  # edge m is at (m + 1/2) cells
        self._index, self._negative = np.where(edge < 0, -edge - 1, edge), edge < 0
        self.edges = int(self._index.max()) + 1

    def edge(self, step):
        """Return the positive coordinates of edges of cells with side `step` [mm]."""
        return (np.arange(self.edges) + 0.5) * step

    def difference(self, corners, axis, odd):
        """Return the difference between each cell's two edges.

        It is the value at the upper edge minus that at the lower edge. The values are integrals of a stress component
        up to an edge. `corners` has them for edges at positive coordinates along `axis`; integrals up to other edges
        follow by symmetry. `odd` is true if the component is odd in this coordinate; then the integral is even.
        """
        mirrored = corners.take(self._index, axis)
        if not odd:
            sign = np.where(self._negative, -1.0, 1.0)
            mirrored *= sign if axis else sign[:, None]
        return np.diff(mirrored, axis=axis)


@njit()
def _corner(x, y, z, nu):
    """Return one corner's part of a rectangle's stress.

    The returned stress is multiplied by 2 pi. (x, y, z) is the point seen from the corner. The stress below a rectangle
    under unit pressure is the sum of the parts of its four corners, with alternating signs.
    """
    xx, yy, zz = x * x, y * y, z * z
    r = sqrt(xx + yy + zz)
    if r == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # Love's names: V is the potential 1/r of a uniform layer, chi that of log(z + r). Integrated derivatives of both.
    v_z = -atan2(x * y, z * r)
    in_x, in_y = xx + zz, yy + zz
    v_xx = -x * y / (in_x * r) if in_x > 0.0 else 0.0
    v_yy = -x * y / (in_y * r) if in_y > 0.0 else 0.0
    v_xz = -z * y / (in_x * r) if in_x > 0.0 else 0.0
    v_yz = -z * x / (in_y * r) if in_y > 0.0 else 0.0
    bulge = x * y * (xx + yy) / (r + z)  # x y (r - z), without cancellation
    chi_xx, chi_yy = atan2(bulge, xx * r + z * yy), atan2(bulge, yy * r + z * xx)
    rest = 1.0 - 2.0 * nu
    return (
        2.0 * nu * v_z - rest * chi_xx - z * v_xx,
        2.0 * nu * v_z - rest * chi_yy - z * v_yy,
        v_z + z * (v_xx + v_yy),
        -rest * log(z + r) - z / r,
        -z * v_xz,
        -z * v_yz,
    )


@njit()
def fill_corners(x, y, z, nu, out):
    """Compute `_corner` at offsets x and y, divided by 2 pi."""
    for j in range(y.size):
        for i in range(x.size):
            parts = _corner(x[i], y[j], z, nu)
            for k in range(6):
                out[k, j, i] = parts[k] / (2.0 * pi)
