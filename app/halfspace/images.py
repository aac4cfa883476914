"""Influence of the periodic images of a patch, interpolated from few nodes.

A product by FFT in a periodic box slightly larger than the patch also contains the influence of the patch's images. Let
K be the influence coefficients of a cell, and G the influence coefficients of the cell and all its periodic images,
minus the mean over the box. The matrix of the free patch is ``A = G + S``, where S is minus the influence of the
images. The product with G is an FFT on the box, with a third of the points of a zero-padded FFT. The images are at some
distance, so S is a smooth function of the offset between two cells: ``S = P S' P^T``. P^T collects pressures at nodes
many cells apart, S' is S between nodes, and P interpolates displacements from the nodes.

Let F be the influence of all images without the cell itself, minus the mean, so ``G = K + F``. F is a lattice sum
(Ewald), computed at few points and interpolated by polynomials. F is used for offsets up to half the box only: there
``S = -F``. At larger offsets ``S = K - G``, because G is periodic, and so known there.

If the patch repeats in one direction, the box has the same period in this direction, and K is the influence of a cell
and its copies there. G is the same as on a free patch. Then ``S = K - G`` is minus the influence of the images in the
free direction, and is computed as this difference at all offsets.
"""

from functools import lru_cache, partial

import numpy as np
import scipy.fft
from numpy.polynomial import legendre
from scipy.special import erf, erfc

from app.base.mpi import MPI
from app.base.numba_cache import njit
from app.halfspace.chebyshev import chebyshev_nodes, even_chebyshev, fit_even_chebyshev, lagrange_weights
from app.parallel.reductions import add_masked, add_row, add_two_rows, any_nonzero, copy_row

_ERFC_RANGE = 6.2  # erfc(6.2) is below rounding.
_TERMS = 16  # even Chebyshev polynomials per direction for a square box
_GAUSS = legendre.leggauss(4)
# Half of the interval of the polynomials, in periods. The margin above 1/2 is more than half a cell.
_HALF_WIDTH = 0.52
# Cutoff of the images of layers: width in periods, and radius in widths.
_CUTOFF_WIDTH, _CUTOFF_RADIUS = 1.6, 4.0


class Box:
    """Periodic box of `periods` (y, x) cells around a patch, with images."""

    def __init__(self, grid, periods, kernel):
        self.grid, self.periods = grid, periods
        self._patch_influence = partial(kernel.unit_coefficients, grid)
        kernel = kernel.base
        self.influence = partial(kernel.unit_coefficients, grid)
        ny, nx = periods
        terms = _lattice_sum(ny * grid.dy / (nx * grid.dx))
        if kernel.layers:
            terms = terms + _layer_lattice_sum((ny * grid.dy, nx * grid.dx), kernel)
        in_y, in_x = (_cell_means(n, count) for n, count in zip(periods, terms.shape, strict=True))
        self._in_y, self._in_x, self._constant = in_y @ terms * (grid.dy / nx), in_x, 0.0
        if kernel.layers:
            # For layers the means of G and S nearly cancel. The constant makes S zero at the cell itself, so single
            # precision loses no digits.
            cell = np.zeros(1, int)
            self._constant = float((self._patch_influence(cell, cell) - self.kernel(cell, cell))[0, 0])

    def kernel(self, rows, columns):
        """Return the influence of a cell and its periodic images.

        `rows` and `columns` are arrays of offsets in y and x, up to half a period. The result is for unit compliance,
        and has the shape (rows, columns).
        """
        return self.influence(rows, columns) + self._images(rows, columns)

    def _images(self, rows, columns):
        """Return the influence of a cell's periodic images, without the cell."""
        return self._in_y[rows] @ self._in_x[columns].T + self._constant

    def correction(self, steps, counts):
        """Return minus the influence of the images between nodes.

        Nodes are `steps` cells apart in y and x. The offsets are 0 to ``counts - 1`` nodes. The result is for unit
        compliance.
        """
        offsets = [step * np.arange(count) for step, count in zip(steps, counts, strict=True)]
        back = [np.minimum(d % n, n - d % n) for d, n in zip(offsets, self.periods, strict=True)]
        return self._patch_influence(*offsets) - self.kernel(*back)


@lru_cache(maxsize=64)
def _lattice_sum(aspect):
    """Return Chebyshev coefficients [y, x] of a lattice sum.

    The sum is a function of the position: 1/rho summed over all lattice points except the origin, minus the mean of
    this sum. Here rho is the distance of the position from the lattice point. The lattice has the steps 1 in x and
    `aspect` in y.
    """
    in_y, in_x, y, x = _sample_points(aspect)
    alpha = np.sqrt(np.pi / aspect)
    total = np.full(x.shape, -2 * np.sqrt(np.pi) / (alpha * aspect))
    for j, i in _within(_ERFC_RANGE / alpha, aspect, 1.0, _HALF_WIDTH):
        for sign_y in (-1, 1) if j else (1,):
            for sign_x in (-1, 1) if i else (1,):
                rho = np.hypot(x + sign_x * i, y + sign_y * aspect * j)
                total += erfc(alpha * rho) / rho if i or j else -erf(alpha * rho) / rho
    for j, i in _within(2 * alpha * _ERFC_RANGE, 2 * np.pi / aspect, 2 * np.pi):
        if i or j:
            q, half = 2 * np.pi * np.hypot(i, j / aspect), 2 * np.pi * _HALF_WIDTH
            cosines = np.cos(half * i * in_x) * np.cos(half * j * in_y)[:, None]
            multiplicity = (2 if i else 1) * (2 if j else 1)
            total += multiplicity * 2 * np.pi / aspect * erfc(q / (2 * alpha)) / q * cosines
    return fit_even_chebyshev(total)


def _layer_lattice_sum(sides, kernel):
    """Return Chebyshev coefficients [y, x] of a lattice sum for layers.

    Instead of 1/rho as in `_lattice_sum`, the part that layers add to 1/rho is summed, plus a constant. The sum
    converges exponentially, because its terms end by a smooth cutoff: a smooth function, summed over the lattice, is
    constant. So the origin also has a term, with the cutoff minus 1. `sides` are the sides of the box in y and x.
    """
    height, length = sides
    aspect, width = height / length, _CUTOFF_WIDTH * max(1.0, height / length)
    *_, y, x = _sample_points(aspect)
    count_y, count_x = (int(np.ceil((_CUTOFF_RADIUS + 4) * width / d + 1)) for d in (aspect, 1.0))
    total = np.zeros(x.shape)
    for j in range(-count_y, count_y + 1):
        rho = np.hypot(x + np.arange(-count_x, count_x + 1)[:, None, None], y + aspect * j)
        weights = erfc(rho / width - _CUTOFF_RADIUS) / 2
        weights[count_x] -= j == 0
        total += length * (kernel.layer_influence(length * rho) * weights).sum(axis=0)
    return fit_even_chebyshev(total)


def _sample_points(aspect):
    """Return nodes in y and x, and all nodes' positions (y, x)."""
    counts = [int(np.ceil(_TERMS * max(1.0, ratio))) for ratio in (aspect, 1 / aspect)]
    in_y, in_x = map(chebyshev_nodes, counts)
    return in_y, in_x, *np.meshgrid(aspect * _HALF_WIDTH * in_y, _HALF_WIDTH * in_x, indexing="ij")


def _within(radius, step_y, step_x, reach=0.0):
    """Yield the indices (j, i) of the lattice points near the origin.

    The lattice point (j, i) has the coordinates y = j `step_y` and x = i `step_x`. Only indices from 0 are returned.
    Without `reach`, the points have a distance of at most `radius` from the origin. With `reach`, the distance is
    measured from the rectangle |y| <= `reach` `step_y`, |x| <= `reach` `step_x`.
    """
    for j in range(int(radius / step_y + reach) + 1):
        for i in range(int(radius / step_x + reach) + 1):
            if np.hypot(step_y * max(0.0, j - reach), step_x * max(0.0, i - reach)) <= radius:
                yield j, i


def _cell_means(period, count):
    """Return each cell's means of even Chebyshev polynomials.

    The cells lie up to half a period from the origin. There are `count` polynomials; the shape is (cells, count).
    """
    at = (np.arange(period // 2 + 1)[:, None] + _GAUSS[0] / 2) / (_HALF_WIDTH * period)
    return np.einsum("jgt,g->jt", even_chebyshev(at, count), _GAUSS[1] / 2)


@njit()
def _collect(p, mask, first, weights, nodes, rows):
    """Add the pressures of cells to nodes in y, by interpolation weights.

    Two rows between the same nodes are added together, which halves the memory traffic. `rows` are two work rows.
    """
    (step, width), j = weights.shape, 0
    while j < p.shape[0]:
        node, place = divmod(first + j, step)
        count = min(2, step - place, p.shape[0] - j)
        if any_nonzero(mask[j : j + count]) if mask.size else any_nonzero(p[j : j + count]):
            rows[:] = 0
            for l in range(count):
                if mask.size:
                    add_masked(p[j + l], mask[j + l], rows[l])
                else:
                    copy_row(p[j + l], rows[l])
            for k in range(width):
                other = weights[place + count - 1, k]
                add_two_rows(nodes[node + k, : p.shape[1]], weights[place, k], rows[0], other, rows[1])
        j += count


@njit()
def _interpolate(nodes, first, weights, mask, out, row):
    """Interpolate displacements from nodes in y; add the result to `out`.

    The number of `weights` of a cell is even.
    """
    step, width = weights.shape
    for j in range(out.shape[0]):
        row[:] = 0
        node, place = divmod(first + j, step)
        for k in range(0, width, 2):
            one, other = nodes[node + k, : row.size], nodes[node + k + 1, : row.size]
            add_two_rows(row, weights[place, k], one, weights[place, k + 1], other)
        if mask.size:
            add_masked(row, mask[j], out[j])
        else:
            add_row(out[j], row.dtype.type(1), row)


class ImageCorrection:
    """Product with minus the influence of the images. Collective over `comm`.

    Nodes are `steps` cells apart in y and x. The value of a cell is interpolated from `width` nodes in each direction;
    `width` is even. A product is computed in two steps: `multiply` computes it at the nodes, and `add` interpolates it
    to the cells.
    """

    def __init__(self, box, compliance, steps, width, slabs, comm, dtype):
        self._comm = comm
        ny, nx = box.grid.shape
        self._counts = tuple((n - 1) // step + width for n, step in zip((ny, nx), steps, strict=True))
        self._cells = self._counts[1] - width + 1
        around = np.arange(width) - (width // 2 - 1.0)
        weights = (lagrange_weights(np.arange(step) / step, around) for step in steps)
        self._in_y, self._in_x = (each.astype(dtype) for each in weights)
        kernel = compliance * box.correction(steps, self._counts)
        self._lengths = [scipy.fft.next_fast_len(2 * count - 1, real=True) for count in self._counts]
        offsets = [np.minimum(np.arange(n), n - np.arange(n)) for n in self._lengths]
        inside = np.ix_(*(np.minimum(d, count - 1) for d, count in zip(offsets, self._counts, strict=True)))
        self._spectrum = scipy.fft.rfft2(kernel[inside]).real.astype(dtype)
        first, last = (slabs.rows.start, slabs.rows.stop) if slabs.local else (0, 0)
        self._first = first // steps[0]
        rows = (last - 1) // steps[0] + width - self._first if slabs.local else 0
        self._offset = first - self._first * steps[0]  # offset of the first row from the first node
        self._nodes = np.zeros((rows, self._cells * steps[1]), dtype)  # A whole number of steps in x.
        self._rows = np.empty((2, nx), dtype)

    def multiply(self, p, mask):
        """Compute the product with p at the nodes. Collective.

        With a mask, p counts as zero outside of it. A mask of size 0 means no mask.
        """
        rows, (step, width) = slice(self._first, self._first + len(self._nodes)), self._in_x.shape
        self._nodes[...] = 0
        _collect(p, mask, self._offset, self._in_y, self._nodes, self._rows)
        by_node = self._nodes.reshape(-1, self._cells, step)
        nodes, parts = np.zeros(self._counts, self._nodes.dtype), by_node @ self._in_x
        for k in range(width):
            nodes[rows, k : k + self._cells] += parts[:, :, k]
        if self._comm is not None:
            self._comm.Allreduce(MPI.IN_PLACE, nodes)
        waves = scipy.fft.rfft2(nodes, self._lengths)
        with np.errstate(invalid="ignore", over="ignore"):  # The iteration reports divergence.
            waves *= self._spectrum
        nodes = scipy.fft.irfft2(waves, self._lengths)[rows, : self._counts[1]]
        around = np.lib.stride_tricks.sliding_window_view(nodes, width, axis=1)
        np.matmul(np.ascontiguousarray(around), self._in_x.T, out=by_node)

    def add(self, out, mask):
        """Interpolate the result of `multiply` to cells; add the values to `out`.

        With a mask, only cells inside the mask are changed. A mask of size 0 means no mask.
        """
        _interpolate(self._nodes, self._offset, self._in_y, mask, out, self._rows[0])
