"""Products with the influence matrix: a distributed, pruned, cache-blocked FFT convolution.

``u[j, i] = sum_{j', i'} K[|j - j'|, |i - i'|] p[j', i']`` on an ny x nx grid is a periodic convolution on an
``Ny x Nx`` grid, ``N >= 2 n - 1``, of p padded with zeros. The transform convention is numpy's (forward
``exp(-2 pi i k x)``, unscaled); the factor ``1 / (Nx Ny)`` of the inverse is folded into the spectrum.

- *Pruned*: in x only rows that hold data are transformed, and only rows that are wanted come back.
- *Blocked*: columns go through transform, scaling and inverse transform a few at a time, inside the cache.
- *Real even spectrum*: K is even in both directions, so its spectrum is real and even: (Nx/2+1)(Ny/2+1)
  doubles, about n. With the x-transformed rows (2 n) a product needs 3 n doubles and nothing else of size n.
- *Distributed*: rows live in slabs, columns are dealt to the ranks; one all-to-all each way. Large transfers
  go in several column groups, so that the receive buffer stays a fraction of n.
"""

from __future__ import annotations

import itertools

import numba
import numpy as np
from mpi4py import MPI
from mpi4py_fft import fftw
from scipy.fft import dct, next_fast_len, rfft

from app.halfspace.grid import Slabs

_ROWS_AT_ONCE = 32
_COLUMNS_AT_ONCE = 16
_GROUP_BYTES = 1 << 22
_FLAGS = (fftw.FFTW_ESTIMATE,)  # deterministic, and as fast as measured plans here


def transform_length(n):
    """Even length >= 2 n - 1 with small prime factors. Not collective."""
    length = next_fast_len(max(2 * n - 1, 2), real=True)
    while length % 2:
        length = next_fast_len(length + 1, real=True)
    return length


@numba.njit(cache=True)
def _scale_by_even_spectrum(columns, spectrum, count):
    """columns[c, k] *= spectrum[c, min(k, N - k)] for the first `count` columns."""
    length = columns.shape[1]
    half = spectrum.shape[1]
    for c in range(count):
        for k in range(half):
            columns[c, k] *= spectrum[c, k]
        for k in range(half, length):
            columns[c, k] *= spectrum[c, length - k]


@numba.njit(cache=True)
def _divide_by_even_spectrum(columns, spectrum, count, scale):
    """columns[c, k] *= scale / spectrum[c, min(k, N - k)] for the first `count` columns."""
    length = columns.shape[1]
    half = spectrum.shape[1]
    for c in range(count):
        for k in range(half):
            columns[c, k] *= scale / spectrum[c, k]
        for k in range(half, length):
            columns[c, k] *= scale / spectrum[c, length - k]


@numba.njit(cache=True)
def any_nonzero(block):
    """Whether anything is not zero; stops at the first."""
    for j in range(block.shape[0]):
        for i in range(block.shape[1]):
            if block[j, i]:
                return True
    return False


@numba.njit(cache=True)
def _store_rows(rows, count, transformed, first):
    """transformed[c, first + r] = rows[r, c] for the first `count` rows."""
    for c in range(transformed.shape[0]):
        for r in range(count):
            transformed[c, first + r] = rows[r, c]


@numba.njit(cache=True)
def _load_rows(rows, count, transformed, first):
    """rows[r, c] = transformed[c, first + r] for the first `count` rows."""
    for c in range(transformed.shape[0]):
        for r in range(count):
            rows[r, c] = transformed[c, first + r]


class EvenMultiplier:
    """Multiply by a real even function in Fourier space: a convolution with an even kernel.

    Collective over `comm`.

    Parameters
    ----------
    shape : (int, int)
        ``(ny, nx)`` of the fields.
    periods : (int, int)
        ``(Ny, Nx)``, at least `shape`; fields are padded with zeros.
    slabs : Slabs, optional
        Distribution of the rows; default: all here.
    comm : mpi4py communicator, optional
        Ranks that share the grid; default: this one alone.
    dtype : numpy real type
        float64, or float32 for half the time and memory at single precision.
    partner : EvenMultiplier, optional
        One of the same shape and periods whose working storage may be shared.

    Attributes
    ----------
    count : int
        Products computed so far.
    """

    def __init__(self, shape, periods, slabs=None, comm=None, dtype=np.float64, partner=None):
        self.shape, self.periods = shape, periods
        self.slabs = slabs or Slabs(shape[0])
        self.comm = comm if comm is not None and comm.size > 1 else None
        self.dtype = np.dtype(dtype)
        complex_type = np.result_type(self.dtype, np.complex64)
        self.count = 0
        ny_fft, nx_fft = periods
        self._columns = columns = nx_fft // 2 + 1
        self._groups = self._deal_columns(columns)
        self._spectrum = None
        self._inverse = False
        self._inverse_scale = 1.0 / (float(periods[0]) * periods[1]) ** 2

        store = (columns, self.slabs.local)
        if partner is None:
            self._transformed = np.zeros(store, complex_type)
        else:
            self._transformed = np.ndarray(store, complex_type, partner._transformed.data)
        self._received = None
        if self.comm is not None:
            largest = max(g.mine.stop - g.mine.start for g in self._groups) * shape[0]
            self._received = np.zeros(largest, complex_type)

        self._row_real = real = fftw.aligned((_ROWS_AT_ONCE, nx_fft), dtype=self.dtype)
        self._row_complex = cplx = fftw.aligned((_ROWS_AT_ONCE, columns), dtype=complex_type)
        self._column = column = fftw.aligned((_COLUMNS_AT_ONCE, ny_fft), dtype=complex_type)
        self._row_forward = fftw.rfftn(real, None, (1,), 1, _FLAGS, cplx)
        self._row_backward = fftw.irfftn(cplx, (nx_fft,), (1,), 1, _FLAGS, real)
        self._column_forward = fftw.fftn(column, None, (1,), 1, _FLAGS, column)
        self._column_backward = fftw.ifftn(column, None, (1,), 1, _FLAGS, column)
        for work in (real, cplx, column):
            work[...] = 0

    def _deal_columns(self, columns):
        """Split the columns into groups, each dealt to all ranks; the same in all precisions."""
        if self.comm is None:
            return [_ColumnGroup(0, columns, 1, 0, self.slabs.counts)]
        largest = max(self.slabs.counts) * columns * np.dtype(complex).itemsize
        groups = int(np.clip(largest // _GROUP_BYTES, 1, max(1, columns // self.comm.size)))
        edges = np.linspace(0, columns, groups + 1).astype(int)
        return [
            _ColumnGroup(a, b, self.comm.size, self.comm.rank, self.slabs.counts)
            for a, b in itertools.pairwise(edges)
        ]

    def set_kernel(self, kernel_rows, rows, columns):
        """Set the spectrum to the transform of an even kernel.

        Collective.

        Parameters
        ----------
        kernel_rows : callable
            ``kernel_rows(slice) -> ndarray (rows, >= columns)``: the kernel at non-negative offsets.
        rows, columns : int
            How many of these are not zero; at most half a period and one.
        """
        ny_fft, nx_fft = self.periods
        half_x, half_y = nx_fft // 2, ny_fft // 2
        size, rank = (1, 0) if self.comm is None else (self.comm.size, self.comm.rank)
        mine = Slabs(rows, size, rank)  # the work of this transform; not the slabs of the fields
        in_x = np.empty((half_x + 1, mine.local))
        for start in range(mine.rows.start, mine.rows.stop, _ROWS_AT_ONCE):
            stop = min(start + _ROWS_AT_ONCE, mine.rows.stop)
            block = np.zeros((stop - start, half_x + 1))
            block[:, :columns] = kernel_rows(slice(start, stop))[:, :columns]
            in_x[:, start - mine.rows.start : stop - mine.rows.start] = _transform_even(block, nx_fft).T
        spectrum = np.empty((sum(g.mine.stop - g.mine.start for g in self._groups), half_y + 1), self.dtype)
        done = 0
        for of_fields in self._groups:
            group = _ColumnGroup(of_fields.span.start, of_fields.span.stop, size, rank, mine.counts)
            count = group.mine.stop - group.mine.start
            blocks = [in_x[group.span]]
            if self.comm is not None:
                received = np.empty(count * rows)
                self.comm.Alltoallv([in_x[group.span], group.by_column], [received, group.by_row])
                blocks = group.blocks(received)
            for first in range(0, count, _COLUMNS_AT_ONCE):
                last = min(first + _COLUMNS_AT_ONCE, count)
                column = np.zeros((last - first, half_y + 1))
                for block, (a, b) in zip(blocks, group.row_ranges, strict=True):
                    column[:, a:b] = block[first:last]
                spectrum[done + first : done + last] = _transform_even(column, ny_fft)
            done += count
        self._spectrum = spectrum

    def smallest_eigenvalue(self):
        """Smallest value of the spectrum. Collective."""
        smallest = float(self._spectrum.min(initial=np.inf))
        return smallest if self.comm is None else self.comm.allreduce(smallest, MPI.MIN)

    def centre(self):
        """Entries of the operator between a cell and its eight neighbours, shape (3, 3). Collective."""
        ny_fft, nx_fft = self.periods
        columns = np.concatenate([np.arange(g.mine.start, g.mine.stop) for g in self._groups])
        rows = np.arange(ny_fft // 2 + 1)

        def weights(index, period):
            """Cosines at offsets 0 and 1; all but the constant and the highest frequency stand for two."""
            twice = np.where((index > 0) & (2 * index < period), 2.0, 1.0)
            return twice * np.cos(2 * np.pi * index * np.arange(2)[:, None] / period)

        quarter = weights(columns, nx_fft) @ (
            self._spectrum @ weights(rows, ny_fft).T
        )  # [x offset, y offset]
        if self.comm is not None:
            quarter = self.comm.allreduce(quarter)
        offsets = np.abs(np.arange(-1, 2))
        return quarter.T[np.ix_(offsets, offsets)]

    def scale_spectrum(self, function):
        """Replace the spectrum by ``function(spectrum)`` and fold in the scale of the inverse transform."""
        self._spectrum[...] = function(self._spectrum)
        self._spectrum *= 1.0 / (self.periods[0] * self.periods[1])
        # Load the compiled loops now, not in the first product.
        _store_rows(self._row_complex, 0, self._transformed, 0)
        _load_rows(self._row_complex, 0, self._transformed, 0)
        _scale_by_even_spectrum(self._column, self._spectrum[:0], 0)
        _divide_by_even_spectrum(self._column, self._spectrum[:0], 0, self.dtype.type(1))
        any_nonzero(np.zeros((0, 0)))
        any_nonzero(np.zeros((0, 0), bool))

    @property
    def memory(self):
        """Bytes held on this rank."""
        arrays = (
            self._spectrum,
            self._transformed,
            self._received,
            self._row_real,
            self._row_complex,
            self._column,
        )
        return sum(a.nbytes for a in arrays if a is not None)

    def apply_inverse(self, p, out):
        """Multiply p by the inverse of the periodic operator; only for fields as large as the periods. Collective."""
        self._inverse = True
        try:
            self.apply(p, out)
        finally:
            self._inverse = False

    def apply(self, p, out, mask=None):
        """Multiply p by the operator A of this object: out = A p, or out = C A C p.

        Collective.

        Parameters
        ----------
        p : ndarray, shape (local rows, nx)
        out : ndarray, shape (local rows, nx)
            May be `p` itself.
        mask : ndarray of bool, shape (local rows, nx), optional
            The cells of C. Rows without any are not transformed.
        """
        self.count += 1
        self._rows_forward(p, mask)
        done = 0
        for group in self._groups:
            done = self._columns_of(group, done)
        self._rows_backward(out, mask)

    def _rows_forward(self, p, mask):
        real, cplx, nx = self._row_real, self._row_complex, self.shape[1]
        real[:, nx:] = 0
        for i in range(0, len(p), _ROWS_AT_ONCE):
            block = p[i : i + _ROWS_AT_ONCE]
            inside = block if mask is None else mask[i : i + _ROWS_AT_ONCE]
            w = len(block)
            if not any_nonzero(inside):
                self._transformed[:, i : i + w] = 0
                continue
            if mask is None:
                real[:w, :nx] = block
            else:
                np.multiply(block, inside, out=real[:w, :nx])
            self._row_forward()
            _store_rows(cplx, w, self._transformed, i)

    def _columns_of(self, group, done):
        """Convolve the columns of a group in y; `done` columns of the spectrum belong to earlier groups."""
        part = self._transformed[group.span]
        count = group.mine.stop - group.mine.start
        if self.comm is None:
            blocks = [part]
        else:
            received = self._received[: count * self.shape[0]]
            self.comm.Alltoallv([part, group.by_column], [received, group.by_row])
            blocks = group.blocks(received)
        column, ny = self._column, self.shape[0]
        for first in range(0, count, _COLUMNS_AT_ONCE):
            last = min(first + _COLUMNS_AT_ONCE, count)
            w = last - first
            for block, (a, b) in zip(blocks, group.row_ranges, strict=True):
                column[:w, a:b] = block[first:last]
            column[:, ny:] = 0
            self._column_forward()
            spectrum = self._spectrum[done + first : done + last]
            if self._inverse:
                _divide_by_even_spectrum(column, spectrum, w, self._spectrum.dtype.type(self._inverse_scale))
            else:
                _scale_by_even_spectrum(column, spectrum, w)
            self._column_backward()
            for block, (a, b) in zip(blocks, group.row_ranges, strict=True):
                block[first:last] = column[:w, a:b]
        if self.comm is not None:
            self.comm.Alltoallv([received, group.by_row], [part, group.by_column])
        return done + count

    def _rows_backward(self, out, mask):
        real, cplx, nx = self._row_real, self._row_complex, self.shape[1]
        for i in range(0, len(out), _ROWS_AT_ONCE):
            w = min(_ROWS_AT_ONCE, len(out) - i)
            inside = None if mask is None else mask[i : i + w]
            if inside is not None and not any_nonzero(inside):
                out[i : i + w] = 0
                continue
            _load_rows(cplx, w, self._transformed, i)
            self._row_backward(normalize=False)
            if inside is None:
                out[i : i + w] = real[:w, :nx]
            else:
                np.multiply(real[:w, :nx], inside, out=out[i : i + w])


class Convolution(EvenMultiplier):
    """u = A p for the influence matrix of a grid, by FFT on a grid of twice the size.

    Collective over `comm`.

    Parameters
    ----------
    quadrant_rows : callable
        ``quadrant_rows(slice) -> ndarray (rows, nx)``: influence coefficients, a few rows at a time.
    shape, slabs, comm, dtype
        See `EvenMultiplier`.
    partner : Convolution, optional
        The same in another precision, whose working storage is shared.
    """

    def __init__(self, quadrant_rows, shape, slabs=None, comm=None, dtype=np.float64, partner=None):
        ny, nx = shape
        super().__init__(shape, (transform_length(ny), transform_length(nx)), slabs, comm, dtype, partner)
        if isinstance(partner, Convolution):
            self._spectrum = partner._spectrum.astype(self.dtype)
            return
        self.set_kernel(quadrant_rows, ny, nx)
        self.scale_spectrum(lambda spectrum: spectrum)

    def in_precision(self, dtype):
        """Return the same product in another precision, with the same working storage. Not collective."""
        return Convolution(None, self.shape, self.slabs, self.comm, dtype, self)


def _transform_even(samples, period):
    """Fourier transform of the even `period`-periodic sequences whose first ``period // 2 + 1`` samples are given."""
    if period == 1:
        return samples
    if period % 2 == 0:
        return dct(samples, type=1, axis=1, overwrite_x=True)
    return rfft(np.concatenate([samples, samples[:, :0:-1]], axis=1), axis=1).real


class _ColumnGroup:
    """Columns [start, stop) dealt to `size` ranks, and the counts of the all-to-all that deals them."""

    def __init__(self, start, stop, size, rank, row_counts):
        per_rank = [(stop - start) // size + (r < (stop - start) % size) for r in range(size)]
        edges = start + np.concatenate([[0], np.cumsum(per_rank)])
        self.span = slice(start, stop)
        self.mine = slice(int(edges[rank]), int(edges[rank + 1]))
        row_edges = np.concatenate([[0], np.cumsum(row_counts)])
        self.row_ranges = [(int(a), int(b)) for a, b in itertools.pairwise(row_edges)]
        columns = per_rank[rank]
        sent = np.array(per_rank) * row_counts[rank]
        got = np.array(row_counts) * columns
        self.by_column = (sent, np.concatenate([[0], np.cumsum(sent)[:-1]]))
        self.by_row = (got, np.concatenate([[0], np.cumsum(got)[:-1]]))
        self._columns = columns

    def blocks(self, received):
        """Views (columns here, rows of rank q) of the received data, one for each rank q."""
        return [
            received[self._columns * a : self._columns * b].reshape(self._columns, b - a)
            for a, b in self.row_ranges
        ]


class DenseProduct:
    """The same product by a stored matrix: quicker than an FFT on the smallest grids (n <= 256)."""

    largest = 256

    def __init__(self, matrix, shape):
        self.matrix, self.shape, self.dtype = matrix, shape, matrix.dtype
        self.periods = tuple(2 * n for n in shape)  # of the transform it stands for
        self.count = 0

    @property
    def memory(self):
        """Bytes held on this rank."""
        return self.matrix.nbytes

    def apply(self, p, out, mask=None):
        """Compute out = A p, or out = C A C p; see `Convolution.apply`. Not collective."""
        self.count += 1
        if mask is None:
            out[...] = (self.matrix @ p.reshape(-1)).reshape(self.shape)
        else:
            np.multiply((self.matrix @ (p * mask).reshape(-1)).reshape(self.shape), mask, out=out)
