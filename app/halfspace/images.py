"""What the images of a patch add to its product, if it is continued periodically: smooth, so known from few cells.

A patch in a periodic box that is a little larger feels its images, too. With G the influence coefficients of the box,
those of a cell and all its images less their mean, the matrix of the free patch is ``A = G + S``, and G is a product by
FFT on the box, which has a third of the points of a zero-padded one. S is minus the influence of the images, which are
no nearer than the box is larger: a polynomial between two cells says it. So ``S = P S' P^T``: pressures are collected
in nodes many cells apart (P^T), so that interpolation (P) from the nodes finds for each cell what they displace it by.

``F``, the influence of all images but the cell itself, less the mean, is a sum over a lattice (Ewald) in few points,
and a polynomial between them. Then ``G = K + F`` and ``S = -F`` up to half the box, and beyond ``S = K - G`` by
what G repeats.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import scipy.fft
from numpy.polynomial import legendre
from scipy.special import erf, erfc

from app.base.mpi import MPI
from app.base.numba_cache import njit
from app.halfspace.chebyshev import chebyshev_nodes, even_chebyshev, fit_even_chebyshev, lagrange_weights
from app.parallel.reductions import add_masked, add_row, njit_reassoc

_RANGE = 6.2  # erfc(6.2) is nothing
_TERMS = 16  # even Chebyshev polynomials for a square
_GAUSS = legendre.leggauss(4)
_REACH = 0.52  # of a period, to either side: half a cell more than half of it


class Box:
    """The periodic box of a patch.

    Parameters
    ----------
    grid : Grid
        The patch.
    periods : (int, int)
        Of the box in y and x, in cells.
    influence : callable
        ``influence(rows, columns)``: coefficients K at offsets that are arrays of numbers of cells, for unit
        compliance.
    """

    def __init__(self, grid, periods, influence):
        self.grid, self.periods, self.influence = grid, periods, influence
        ny, nx = periods
        terms = _lattice_sum(ny * grid.dy / (nx * grid.dx))
        in_y, in_x = (_cell_means(n, count) for n, count in zip(periods, terms.shape, strict=True))
        self._in_y, self._in_x = in_y @ terms * (grid.dy / nx), in_x

    def kernel(self, rows, columns):
        """G at offsets of up to half a period, shape (rows, columns), for unit compliance. Not collective."""
        return self.influence(rows, columns) + self._images(rows, columns)

    def _images(self, rows, columns):
        """F, likewise."""
        return self._in_y[rows] @ self._in_x[columns].T

    def correction(self, steps, counts):
        """S at `counts` multiples of `steps` cells in y and x, for unit compliance. Not collective."""
        offsets = [step * np.arange(count) for step, count in zip(steps, counts, strict=True)]
        back = [np.minimum(d, n - d) for d, n in zip(offsets, self.periods, strict=True)]
        return self.influence(*offsets) - self.influence(*back) - self._images(*back)


@lru_cache(maxsize=64)
def _lattice_sum(aspect):
    """Coefficients [y, x] of even Chebyshev polynomials for the sum of 1/rho over a lattice, less origin and mean.

    The lattice has steps 1 in x and `aspect` in y; the polynomials are for `_REACH` of these.
    """
    counts = [int(np.ceil(_TERMS * max(1.0, ratio))) for ratio in (aspect, 1 / aspect)]
    in_y, in_x = map(chebyshev_nodes, counts)
    y, x = np.meshgrid(aspect * _REACH * in_y, _REACH * in_x, indexing="ij")
    alpha = np.sqrt(np.pi / aspect)
    total = np.full(x.shape, -2 * np.sqrt(np.pi) / (alpha * aspect))
    for j, i in _within(_RANGE / alpha, aspect, 1.0, _REACH):
        for sign_y in (-1, 1) if j else (1,):
            for sign_x in (-1, 1) if i else (1,):
                rho = np.hypot(x + sign_x * i, y + sign_y * aspect * j)
                total += erfc(alpha * rho) / rho if i or j else -erf(alpha * rho) / rho
    for j, i in _within(2 * alpha * _RANGE, 2 * np.pi / aspect, 2 * np.pi):
        if i or j:
            q = 2 * np.pi * np.hypot(i, j / aspect)
            cosines = np.cos(2 * np.pi * i * in_x * _REACH) * np.cos(2 * np.pi * j * in_y * _REACH)[:, None]
            alike = (2 if i else 1) * (2 if j else 1)
            total += alike * 2 * np.pi / aspect * erfc(q / (2 * alpha)) / q * cosines
    return fit_even_chebyshev(total)


def _within(radius, step_y, step_x, reach=0.0):
    """Numbers (j, i), 0 and more, of lattice points that come within a radius, as others go `reach` steps their way."""
    for j in range(int(radius / step_y + reach) + 1):
        for i in range(int(radius / step_x + reach) + 1):
            if np.hypot(step_y * max(0.0, j - reach), step_x * max(0.0, i - reach)) <= radius:
                yield j, i


def _cell_means(period, count):
    """Means of the even Chebyshev polynomials over cells at offsets up to half a period."""
    at = (np.arange(period // 2 + 1)[:, None] + _GAUSS[0] / 2) / (_REACH * period)
    return np.einsum("jgt,g->jt", even_chebyshev(at, count), _GAUSS[1] / 2)


# ------------------------------------------------------------------------------------------- S on few cells


@njit_reassoc
def _copy_row(a, out):
    some = False
    for i in range(a.size):
        out[i] = a[i]
        some |= a[i] != 0
    return some


@njit_reassoc
def _copy_inside(a, inside, out):
    some = False
    for i in range(a.size):
        out[i] = a[i] if inside[i] else 0
        some |= inside[i]
    return some


@njit()
def _collect(p, mask, first, weights, nodes, row):
    """nodes += P^T p in y, for rows from `first` on; on C if there is a mask. `row`: room for one."""
    step, width = weights.shape
    for j in range(p.shape[0]):
        some = _copy_inside(p[j], mask[j], row) if mask.size else _copy_row(p[j], row)
        if not some:
            continue
        cell, place = divmod(first + j, step)
        for k in range(width):
            add_row(nodes[cell + k, : row.size], weights[place, k], row)


@njit()
def _spread(nodes, first, weights, mask, out, row):
    """out += P nodes in y, for rows from `first` on; on C if there is a mask. `row`: room for one."""
    step, width = weights.shape
    for j in range(out.shape[0]):
        row[:] = 0
        cell, place = divmod(first + j, step)
        for k in range(width):
            add_row(row, weights[place, k], nodes[cell + k, : row.size])
        if mask.size:
            add_masked(row, mask[j], out[j])
        else:
            add_row(out[j], row.dtype.type(1), row)


def _weights(step, width, dtype):
    """Of the `width` nodes around a cell, for the cells between two of them, shape (step, width)."""
    return lagrange_weights(np.arange(step) / step, np.arange(width) - (width // 2 - 1.0)).astype(dtype)


class ImageCorrection:
    """S on the rows of a rank. Collective over `comm`.

    Parameters
    ----------
    box : Box
    compliance : float
        [mm2/N].
    steps : (int, int)
        Cells from node to node, in y and x.
    width : int
        Nodes, in each direction, between which a cell is interpolated.
    slabs, comm, dtype
        See `Layout`.
    """

    def __init__(self, box, compliance, steps, width, slabs, comm, dtype):
        self._comm = comm
        ny, nx = box.grid.shape
        self._counts = tuple((n - 1) // step + width for n, step in zip((ny, nx), steps, strict=True))
        self._cells = self._counts[1] - width + 1
        self._in_y, self._in_x = (_weights(step, width, dtype) for step in steps)
        kernel = compliance * box.correction(steps, self._counts)
        self._lengths = [scipy.fft.next_fast_len(2 * count - 1, real=True) for count in self._counts]
        offsets = [np.minimum(np.arange(n), n - np.arange(n)) for n in self._lengths]
        inside = np.ix_(*(np.minimum(d, count - 1) for d, count in zip(offsets, self._counts, strict=True)))
        self._spectrum = scipy.fft.rfft2(kernel[inside]).real.astype(dtype)
        first, last = (slabs.rows.start, slabs.rows.stop) if slabs.local else (0, 0)
        self._first = first // steps[0]
        rows = (last - 1) // steps[0] + width - self._first if slabs.local else 0
        self._origin = first - self._first * steps[0]  # of the rows, from the first of the nodes' cells on
        self._nodes = np.zeros((rows, self._cells * steps[1]), dtype)  # whole cells of nodes in x
        self._row = np.empty(nx, dtype)
        warm_up(np.dtype(dtype))

    @property
    def memory(self):
        """Bytes held on this rank."""
        return self._nodes.nbytes + self._spectrum.nbytes

    def multiply(self, p, mask):
        """Compute S p, of p on C if there is a mask (without: of size 0), for `add`. Collective."""
        nodes, rows, (step, width) = self._collected(p, mask), len(self._nodes), self._in_x.shape
        if self._comm is not None:
            self._comm.Allreduce(MPI.IN_PLACE, nodes)
        waves = scipy.fft.rfft2(nodes, self._lengths)
        with np.errstate(invalid="ignore", over="ignore"):  # who diverges is told by others
            waves *= self._spectrum
        nodes = scipy.fft.irfft2(waves, self._lengths)[self._first : self._first + rows, : self._counts[1]]
        around = np.lib.stride_tricks.sliding_window_view(nodes, width, axis=1)
        by_cells = self._nodes.reshape(rows, self._cells, step)
        np.matmul(np.ascontiguousarray(around), self._in_x.T, out=by_cells)

    def _collected(self, p, mask):
        """P^T p of these rows, shape (nodes in y, nodes in x)."""
        rows, (step, width) = len(self._nodes), self._in_x.shape
        self._nodes[...] = 0
        _collect(p, mask, self._origin, self._in_y, self._nodes, self._row)
        of_cells = self._nodes.reshape(rows, self._cells, step) @ self._in_x
        nodes = np.zeros(self._counts, self._nodes.dtype)
        mine = nodes[self._first : self._first + rows]
        for k in range(width):
            mine[:, k : k + self._cells] += of_cells[:, :, k]
        return nodes

    def add(self, out, mask):
        """Add it to a field, on C if there is a mask. Not collective."""
        _spread(self._nodes, self._origin, self._in_y, mask, out, self._row)


@cache
def warm_up(dtype):
    """Compile the loops, or read them from the cache, now and not in the first product. Not collective."""
    weights, nodes, row = np.zeros((1, 1), dtype), np.zeros((0, 1), dtype), np.zeros(1, dtype)
    double, mask = np.zeros((0, 1)), np.zeros((0, 1), bool)
    for field in {double.dtype: double, dtype: nodes}.values():
        _collect(field, mask, 0, weights, nodes, row)
        _spread(nodes, 0, weights, mask, field, row)
    double.flags.writeable = False  # as arrays of Vecs may be
    _collect(double, mask, 0, weights, nodes, row)
