"""Products with the influence matrix: a distributed, pruned, cache-blocked FFT convolution.

``u[j, i] = sum_{j', i'} K[|j - j'|, |i - i'|] p[j', i']`` on an ny x nx grid is a periodic convolution on an
``Ny x Nx`` grid, ``N >= 2 n - 1``, of p padded with zeros. The transform convention is numpy's (forward
``exp(-2 pi i k x)``, unscaled); the factor ``1 / (Nx Ny)`` of the inverse is folded into the spectrum.

- *Pruned*: in x only rows that hold data are transformed, and only rows that are wanted come back. Two real rows are
  transformed as one complex row, which costs half of two real transforms by FFTW.
- *Blocked*: columns go through transform, scaling and inverse transform a few at a time, inside the cache. Between the
  transforms the data lie in strips of as many columns, which rows fill and columns are picked from in order.
- *Real even spectrum*: K is even in both directions, so its spectrum is real and even: (Nx/2+1)(Ny/2+1)
  doubles, about n. With the x-transformed rows (2 n) a product needs 3 n doubles and nothing else of size n.
- *Distributed*: rows live in slabs, columns are dealt to the ranks; one all-to-all each way. Large transfers
  go in several column groups, so that the receive buffer stays a fraction of n.
"""

from __future__ import annotations

import itertools
from functools import cache, lru_cache

import numba
import numpy as np
from mpi4py import MPI
from mpi4py_fft import fftw
from scipy.fft import dct, next_fast_len, rfft

from app.halfspace.grid import Slabs

_AT_ONCE = 16  # sequences in a batch
_ROWS_AT_ONCE, _COLUMNS_AT_ONCE = 2 * _AT_ONCE, _AT_ONCE  # two real rows are a sequence
_GROUP_BYTES = 1 << 22
_FLAGS = (fftw.FFTW_ESTIMATE,)  # deterministic, and as fast as measured plans here


@lru_cache(maxsize=256)
def quick_length(n, even=False):
    """Length of at least n at which a transform and what goes with it take little time. Not collective.

    Per point FFTW needs (without measuring) half the time at powers of two, 0.8 of it at odd multiples of large
    ones; the rest of a product, as much again, does not care. Memory counts too, so that little is not bought dearly.
    """

    def cost(length):
        twos = length & -length
        relative = 1.0 if twos == length else 1.6 if twos >= 64 else 2.0
        return length**1.5 * (1 + relative)

    lengths, length = [], next_fast_len(n, real=True)
    while not lengths or length < 1.5 * n:
        if length % 2 == 0 or not even:
            lengths.append(length)
        length = next_fast_len(length + 1, real=True)
    return min(lengths, key=cost)


def transform_length(n):
    """Even length >= 2 n - 1 for a product on n cells. Not collective."""
    return quick_length(max(2 * n - 1, 2), even=True)


# Unsigned indices are not tested for being negative, complex numbers put together from real products not for NaN, and a
# loop over a row in a function of its own is not lost in others: only so do the loops below become vector instructions.


@numba.njit(cache=True)
def _scale_first_half(parts, factor):
    two, one = np.uint64(2), np.uint64(1)
    for k in range(np.uint64(factor.size)):
        parts[two * k] *= factor[k]
        parts[two * k + one] *= factor[k]


@numba.njit(cache=True)
def _scale_second_half(parts, factor):
    two, one, length = np.uint64(2), np.uint64(1), np.uint64(parts.size // 2)
    for k in range(one, length - np.uint64(factor.size) + one):
        i = two * (length - k)
        parts[i] *= factor[k]
        parts[i + one] *= factor[k]


@numba.njit(cache=True)
def _scale_by_even_spectrum(parts, spectrum, count):
    """columns[c, k] *= spectrum[c, min(k, N - k)] for the first `count` columns, given as real and imaginary parts."""
    for c in range(count):
        _scale_first_half(parts[c], spectrum[c])
        _scale_second_half(parts[c], spectrum[c])


@numba.njit(cache=True)
def _divide_by_even_spectrum(columns, spectrum, count, scale):
    """columns[c, k] *= scale / spectrum[c, min(k, N - k)] for the first `count` columns."""
    length, half = np.uint64(columns.shape[1]), np.uint64(spectrum.shape[1])
    for c in range(count):
        column = columns[c]
        for k in range(length):
            factor = scale / spectrum[c, k if k < half else length - k]
            column[k] = complex(column[k].real * factor, column[k].imag * factor)


@numba.njit(cache=True)
def any_nonzero(block):
    """Whether anything is not zero; stops at the first row with something."""
    for j in range(block.shape[0]):
        some = False
        for i in range(block.shape[1]):
            some |= block[j, i] != 0
        if some:
            return True
    return False


# Two real rows a, b are transformed as one complex row a + i b. An odd last row is paired with itself.


@numba.njit(cache=True)
def _pair(p, mask, pairs):
    """pairs[m, :nx] = p[2 m] + i p[2 m + 1], on C if there is a mask; zero beyond."""
    last = p.shape[0] - 1
    for m in range((last + 2) // 2):
        j, l = 2 * m, min(2 * m + 1, last)
        a, b, row = p[j], p[l], pairs[m]
        if mask is None:
            for k in range(p.shape[1]):
                row[k] = complex(a[k], b[k])
        else:
            for k in range(p.shape[1]):
                row[k] = complex(a[k] if mask[j, k] else 0, b[k] if mask[l, k] else 0)
        row[p.shape[1] :] = 0


@numba.njit(cache=True)
def _unpair(pairs, mask, out):
    """Undo `_pair`."""
    last = out.shape[0] - 1
    for m in range((last + 2) // 2):
        j, l = 2 * m, min(2 * m + 1, last)
        a, b, row = out[j], out[l], pairs[m]
        for k in range(out.shape[1]):
            a[k] = row[k].real
            b[k] = row[k].imag
        if mask is not None:
            a *= mask[j]
            b *= mask[l]


@numba.njit(cache=True)
def _split(pair, first, a, b):
    """Transforms a, b of two real rows from that of their pair, at frequency `first` and on."""
    length, start, half = np.uint64(pair.size), np.uint64(first), pair.real.dtype.type(0.5)
    for c in range(np.uint64(first == 0), np.uint64(a.size)):
        x, y = pair[start + c], pair[length - start - c]
        a[c] = complex(half * (x.real + y.real), half * (x.imag - y.imag))
        b[c] = complex(half * (x.imag + y.imag), half * (y.real - x.real))
    if first == 0 and a.size:
        x = pair[0]
        a[0], b[0] = x.real, x.imag


@numba.njit(cache=True)
def _unite(pair, first, a, b):
    """Undo `_split`."""
    length, start = np.uint64(pair.size), np.uint64(first)
    for c in range(np.uint64(a.size)):
        x, y = a[c], b[c]
        pair[start + c] = complex(x.real - y.imag, x.imag + y.real)
    for c in range(np.uint64(first == 0), np.uint64(a.size)):
        x, y = a[c], b[c]
        pair[length - start - c] = complex(x.real + y.imag, y.real - x.imag)


# Transformed rows are stored as *strips* of 16 columns: a row fills a part of every strip, columns are made of a whole
# one, and both ways memory is gone through in order. Strips that belong together are one flat array; the last
# may be narrower.
_STRIP = _COLUMNS_AT_ONCE


@numba.njit(cache=True)
def _copy_strip(source, i, target, k):
    for c in range(np.uint64(_STRIP)):
        target[k + c] = source[i + c]


@numba.njit(cache=True)
def _put_rows(rows, strips, height, start):
    """Make `rows` the rows of the strips, which are `height` rows high, from row `start` on."""
    whole = rows.shape[1] // _STRIP * _STRIP
    for strip in range(0, whole, _STRIP):
        at = height * strip + start * _STRIP
        for j in range(rows.shape[0]):
            _copy_strip(rows[j], np.uint64(strip), strips, np.uint64(at + j * _STRIP))
    width = rows.shape[1] - whole
    for j in range(rows.shape[0]):
        for c in range(width):
            strips[height * whole + (start + j) * width + c] = rows[j, whole + c]


@numba.njit(cache=True)
def _take_rows(strips, height, start, rows):
    """Undo `_put_rows`."""
    whole = rows.shape[1] // _STRIP * _STRIP
    for strip in range(0, whole, _STRIP):
        at = height * strip + start * _STRIP
        for j in range(rows.shape[0]):
            _copy_strip(strips, np.uint64(at + j * _STRIP), rows[j], np.uint64(strip))
    width = rows.shape[1] - whole
    for j in range(rows.shape[0]):
        for c in range(width):
            rows[j, whole + c] = strips[height * whole + (start + j) * width + c]


@numba.njit(cache=True)
def _store(pairs, first, count, scratch, strips, height, start):
    """Put the transforms of `count` real rows into the strips from row `start` on, from frequency `first` on."""
    if not height:
        return
    columns = strips.size // height
    rows = scratch[: count * columns].reshape(count, columns)
    for m in range((count + 1) // 2):
        _split(pairs[m], first, rows[2 * m], rows[min(2 * m + 1, count - 1)])
    _put_rows(rows, strips, height, start)


@numba.njit(cache=True)
def _load(pairs, first, count, scratch, strips, height, start):
    """Undo `_store`."""
    if not height:
        return
    columns = strips.size // height
    rows = scratch[: count * columns].reshape(count, columns)
    _take_rows(strips, height, start, rows)
    for m in range((count + 1) // 2):
        _unite(pairs[m], first, rows[2 * m], rows[min(2 * m + 1, count - 1)])


@numba.njit(cache=True)
def _clear_rows(strips, height, start, count):
    """Set rows `start`, ... of the strips to zero."""
    if not height:
        return
    columns = strips.size // height
    for strip in range(0, columns, _STRIP):
        width = min(_STRIP, columns - strip)
        strips[height * strip + start * width : height * strip + (start + count) * width] = 0


def _strip(strips, height, first, last):
    """Columns ``first <= c < last``, a whole strip, as a view (rows, columns)."""
    return strips[height * first : height * last].reshape(height, last - first)


_TILE = 8  # complex singles are a cache line


@numba.njit(cache=True)
def _gather(strip, columns, start):
    """columns[c, start + r] = strip[r, c], a tile at a time."""
    height, width = np.uint64(strip.shape[0]), np.uint64(strip.shape[1])
    tile, y = np.uint64(_TILE), np.uint64(start)
    for a in range(np.uint64(0), height, tile):
        for b in range(np.uint64(0), width, tile):
            if a + tile <= height and b + tile <= width:
                for c in range(tile):
                    for r in range(tile):
                        columns[b + c, y + a + r] = strip[a + r, b + c]
            else:
                for c in range(b, min(b + tile, width)):
                    for r in range(a, min(a + tile, height)):
                        columns[c, y + r] = strip[r, c]


@numba.njit(cache=True)
def _scatter(strip, columns, start):
    """Undo `_gather`."""
    height, width = np.uint64(strip.shape[0]), np.uint64(strip.shape[1])
    tile, y = np.uint64(_TILE), np.uint64(start)
    for a in range(np.uint64(0), height, tile):
        for b in range(np.uint64(0), width, tile):
            if a + tile <= height and b + tile <= width:
                for r in range(tile):
                    for c in range(tile):
                        strip[a + r, b + c] = columns[b + c, y + a + r]
            else:
                for r in range(a, min(a + tile, height)):
                    for c in range(b, min(b + tile, width)):
                        strip[r, c] = columns[c, y + r]


class _Batch:
    """Some complex sequences and their transforms in place."""

    def __init__(self, length, dtype):
        self.data = data = fftw.aligned((_AT_ONCE, length), dtype=dtype)
        self.forward = fftw.fftn(data, None, (1,), 1, _FLAGS, data)
        self.backward = fftw.ifftn(data, None, (1,), 1, _FLAGS, data)
        data[...] = 0


# Scratch of one transform after the other: rows and columns of all grids share what has the same length.
_batch = lru_cache(maxsize=64)(_Batch)
_scratch = lru_cache(maxsize=64)(np.empty)


@cache
def _load_loops(dtype):
    """Load the compiled loops now, not in the first product."""
    field, spectrum = np.zeros((0, 1)), np.zeros((0, 1), dtype)
    batch = np.zeros((1, 1), np.result_type(dtype, np.complex64))
    nothing, mask, fixed = batch[:0], field.astype(bool), field.view()
    fixed.flags.writeable = False
    for inside in (None, mask):
        for real in (field, spectrum, fixed):
            _pair(real, inside, batch)
        for real in (field, spectrum):
            _unpair(batch, inside, real)
    for data in (field, spectrum, fixed, mask):
        any_nonzero(data)
    strips = nothing.reshape(-1)
    _store(batch, 0, 0, strips, strips, 0, 0)
    _load(batch, 0, 0, strips, strips, 0, 0)
    _clear_rows(strips, 0, 0, 0)
    _put_rows(spectrum, spectrum.reshape(-1), 0, 0)
    _gather(nothing, batch, 0)
    _scatter(nothing, batch, 0)
    _scale_by_even_spectrum(batch.view(dtype), spectrum, 0)
    _divide_by_even_spectrum(batch, spectrum, 0, dtype.type(1))


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
        One whose working storage may be used, as far as it is large enough.

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

        size = columns * self.slabs.local
        self._transformed = _storage(size, complex_type, partner and partner._transformed)
        self._pieces = [piece for group in self._groups for piece in group.pieces(self._transformed)]
        self._received = None
        if self.comm is not None:
            largest = max(group.to_receive for group in self._groups)
            self._received = _storage(largest, complex_type, partner and partner._received)

        self._rows_plan, self._columns_plan = _batch(nx_fft, complex_type), _batch(ny_fft, complex_type)
        self._pairs, self._column = self._rows_plan.data, self._columns_plan.data
        self._column_parts = self._column.view(self.dtype)
        self._scratch = _scratch(_ROWS_AT_ONCE * columns, complex_type)
        _load_loops(self.dtype)

    def _deal_columns(self, columns):
        """Split the columns into groups, each dealt to all ranks; the same in all precisions."""
        if self.comm is None:
            return [_ColumnGroup(0, columns, 1, 0, self.slabs.counts)]
        column = max(self.slabs.counts) * np.dtype(complex).itemsize
        batches = self.comm.size * _COLUMNS_AT_ONCE  # all ranks busy, with no batch half empty
        width = max(1, _GROUP_BYTES // (column * batches)) * batches
        edges = [*range(0, columns, width), columns]
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
        mine = Slabs.over(self.comm, rows)  # the work of this transform; not the slabs of the fields
        groups = [
            _ColumnGroup(of_fields.edges[0], of_fields.edges[-1], mine.size, mine.rank, mine.counts)
            for of_fields in self._groups
        ]
        in_x = _storage(mine.local * (half_x + 1), self.dtype, self._transformed)
        pieces = [piece for group in groups for piece in group.pieces(in_x)]
        for start in range(mine.rows.start, mine.rows.stop, _ROWS_AT_ONCE):
            stop = min(start + _ROWS_AT_ONCE, mine.rows.stop)
            block = np.zeros((stop - start, half_x + 1), self.dtype)
            block[:, :columns] = kernel_rows(slice(start, stop))[:, :columns]
            block = _transform_even(block, nx_fft)
            for first, last, strips in pieces:
                _put_rows(block[:, first:last].copy(), strips, mine.local, start - mine.rows.start)
        spectrum = np.empty((sum(g.mine.stop - g.mine.start for g in self._groups), half_y + 1), self.dtype)
        done = 0
        for group in groups:
            count = group.mine.stop - group.mine.start
            dealt = group.deal(self.comm, group.part(in_x), np.empty(group.to_receive, self.dtype))
            for first in range(0, count, _COLUMNS_AT_ONCE):
                last = min(first + _COLUMNS_AT_ONCE, count)
                column = np.zeros((last - first, half_y + 1), self.dtype)
                for strips, (a, b) in zip(dealt, group.row_ranges, strict=True):
                    column[:, a:b] = _strip(strips, b - a, first, last).T
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

    @property
    def memory(self):
        """Bytes held on this rank."""
        arrays = (
            self._spectrum,
            self._transformed,
            self._received,
            self._pairs,
            self._column,
            self._scratch,
        )
        return sum(a.nbytes for a in arrays if a is not None)

    def apply_inverse(self, p, out):
        """Multiply p, continued by zeros, by the inverse of the periodic operator. Collective."""
        self._inverse = True
        try:
            self.apply(p, out)
        finally:
            self._inverse = False

    def apply(self, p, out, mask=None, rows=None):
        """Multiply p by the operator A of this object: out = A p, or out = C A C p.

        Collective.

        Parameters
        ----------
        p : ndarray, shape (local rows, nx)
        out : ndarray, shape (local rows, nx)
            May be `p` itself.
        mask : ndarray of bool, shape (local rows, nx), optional
            The cells of C. Rows without any are not transformed.
        rows : ndarray of bool, shape (local rows,), optional
            The rows that are not zero in p and wanted in `out`; the others may hold anything afterwards.
        """
        self.count += 1
        self._rows_forward(p, mask, rows)
        done = 0
        for group in self._groups:
            done = self._columns_of(group, done)
        self._rows_backward(out, mask, rows)

    def _rows_forward(self, p, mask, rows):
        for i in range(0, len(p), _ROWS_AT_ONCE):
            block = p[i : i + _ROWS_AT_ONCE]
            inside = None if mask is None else mask[i : i + _ROWS_AT_ONCE]
            here = slice(i, i + len(block))
            data = rows[None, here] if rows is not None else block if mask is None else inside
            if not any_nonzero(data):
                for _, _, strips in self._pieces:
                    _clear_rows(strips, len(p), i, len(block))
                continue
            _pair(block, inside, self._pairs)
            self._rows_plan.forward()
            for first, _, strips in self._pieces:
                _store(self._pairs, first, len(block), self._scratch, strips, len(p), i)

    def _columns_of(self, group, done):
        """Convolve the columns of a group in y; `done` columns of the spectrum belong to earlier groups."""
        part = group.part(self._transformed)
        count = group.mine.stop - group.mine.start
        dealt = group.deal(self.comm, part, self._received)
        column, ny = self._column, self.shape[0]
        for first in range(0, count, _COLUMNS_AT_ONCE):
            last = min(first + _COLUMNS_AT_ONCE, count)
            w = last - first
            pieces = [
                (_strip(strips, stop - start, first, last), start)
                for strips, (start, stop) in zip(dealt, group.row_ranges, strict=True)
            ]
            for strip, start in pieces:
                _gather(strip, column, start)
            column[:, ny:] = 0
            self._columns_plan.forward()
            spectrum = self._spectrum[done + first : done + last]
            if self._inverse:
                _divide_by_even_spectrum(column, spectrum, w, self._spectrum.dtype.type(self._inverse_scale))
            else:
                _scale_by_even_spectrum(self._column_parts, spectrum, w)
            self._columns_plan.backward()
            for strip, start in pieces:
                _scatter(strip, column, start)
        group.give_back(self.comm, part, self._received)
        return done + count

    def _rows_backward(self, out, mask, rows):
        for i in range(0, len(out), _ROWS_AT_ONCE):
            block = out[i : i + _ROWS_AT_ONCE]
            inside = None if mask is None else mask[i : i + _ROWS_AT_ONCE]
            if inside is not None and not any_nonzero(inside):
                block[...] = 0
                continue
            if rows is not None and not any_nonzero(rows[None, i : i + len(block)]):
                continue
            for first, _, strips in self._pieces:
                _load(self._pairs, first, len(block), self._scratch, strips, len(out), i)
            self._rows_plan.backward()
            _unpair(self._pairs, inside, block)


class Convolution(EvenMultiplier):
    """u = A p for the influence matrix of a grid, by FFT on a grid of twice the size.

    Collective over `comm`.

    Parameters
    ----------
    quadrant_rows : callable
        ``quadrant_rows(slice) -> ndarray (rows, nx)``: influence coefficients, a few rows at a time.
    shape, slabs, comm, dtype, partner
        See `EvenMultiplier`.
    """

    def __init__(self, quadrant_rows, shape, slabs=None, comm=None, dtype=np.float64, partner=None):
        ny, nx = shape
        super().__init__(shape, (transform_length(ny), transform_length(nx)), slabs, comm, dtype, partner)
        self.set_kernel(quadrant_rows, ny, nx)
        self.scale_spectrum(lambda spectrum: spectrum)

    def in_precision(self, dtype):
        """Return the same product in another precision, with the same working storage. Not collective."""
        other = Convolution.__new__(Convolution)
        EvenMultiplier.__init__(other, self.shape, self.periods, self.slabs, self.comm, dtype, self)
        other._spectrum = self._spectrum.astype(dtype)
        return other


def _storage(size, dtype, of_partner=None):
    """Numbers, in the storage of another array if that is large enough."""
    if of_partner is not None and of_partner.nbytes >= size * np.dtype(dtype).itemsize:
        return np.ndarray(size, dtype, of_partner.data)
    return np.zeros(size, dtype)


def _transform_even(samples, period):
    """Fourier transform of the even `period`-periodic sequences whose first ``period // 2 + 1`` samples are given."""
    if period == 1:
        return samples
    if period % 2 == 0:
        return dct(samples, type=1, axis=1, overwrite_x=True)
    return rfft(np.concatenate([samples, samples[:, :0:-1]], axis=1), axis=1).real


class _ColumnGroup:
    """Columns [start, stop) dealt to `size` ranks, and the all-to-all that deals them.

    On either side lie the strips of one rank after those of the other. What a rank would send to itself stays there.
    """

    def __init__(self, start, stop, size, rank, row_counts):
        per_rank = [(stop - start) // size + (r < (stop - start) % size) for r in range(size)]
        self.edges = [int(edge) for edge in start + np.concatenate([[0], np.cumsum(per_rank)])]
        self.mine = slice(self.edges[rank], self.edges[rank + 1])
        row_edges = np.concatenate([[0], np.cumsum(row_counts)])
        self.row_ranges = [(int(a), int(b)) for a, b in itertools.pairwise(row_edges)]
        self._columns, self._rows, self._rank = per_rank[rank], row_counts[rank], rank
        starts = self._rows * (np.array(self.edges[:-1]) - start)
        sent = np.array(per_rank) * self._rows
        got = np.array(row_counts) * self._columns
        sent[rank] = got[rank] = 0
        self._by_column = sent, starts
        self._by_row = got, np.concatenate([[0], np.cumsum(got)[:-1]])
        self.to_receive = int(got.sum())

    def part(self, transformed):
        """What is dealt, in the array of all groups."""
        return transformed[self._rows * self.edges[0] : self._rows * self.edges[-1]]

    def pieces(self, transformed):
        """First and last but one column of each rank, and the strips that are sent to it."""
        return [
            (a, b, transformed[self._rows * a : self._rows * b]) for a, b in itertools.pairwise(self.edges)
        ]

    def deal(self, comm, part, received):
        """Get the columns of this rank: the strips with the rows of rank q, for each rank q. Collective."""
        first = self._rows * (self.mine.start - self.edges[0])
        own = part[first : first + self._rows * self._columns]
        if comm is None:
            return [own]
        comm.Alltoallv([part, self._by_column], [received, self._by_row])
        spans = zip(*self._by_row, strict=True)
        return [
            own if rank == self._rank else received[start : start + count]
            for rank, (count, start) in enumerate(spans)
        ]

    def give_back(self, comm, part, received):
        """Send back what `deal` got. Collective."""
        if comm is not None:
            comm.Alltoallv([received, self._by_row], [part, self._by_column])


class DenseProduct:
    """The same product by a stored matrix: quicker than an FFT on the smallest grids (n <= 256)."""

    largest = 256

    def __init__(self, matrix, shape):
        self.matrix, self.shape, self.dtype = matrix, shape, matrix.dtype
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
