"""Multiplication by a real even function in Fourier space: a distributed, pruned, cache-blocked FFT convolution.

Fields are padded with zeros to the periods ``Ny x Nx``. The transform convention is numpy's (forward
``exp(-2 pi i k x)``, unscaled); the factor ``1 / (Nx Ny)`` of the inverse is folded into the spectrum.

- *Pruned*: in x only rows that hold data are transformed, and only rows that are wanted come back. Two real rows are
  transformed as one complex row.
- *Blocked*: columns go through transform, scaling and inverse transform a few at a time, inside the cache. Between the
  transforms the data lie in strips of as many columns (`strips`), which rows fill and columns are picked from in order.
- *Real even spectrum*: the kernel K is even in both directions, so its spectrum is real and even: (Nx/2+1)(Ny/2+1)
  doubles, about n for periods of twice the field. With the x-transformed rows (2 n) a product needs 3 n doubles and
  nothing else of size n.
- *Distributed*: rows live in slabs, columns are dealt to the ranks (`transpose`); one all-to-all each way. Large
  transfers go in several column groups, so that the receive buffer stays a fraction of n.
"""

from __future__ import annotations

from functools import cache, cached_property, lru_cache

import numpy as np
from mpi4py_fft import fftw
from scipy.fft import dct, rfft

from app.compiled import njit
from app.halfspace.fft.strips import (
    STRIP,
    clear_rows,
    fetch_pairs,
    gather_columns,
    pair,
    put_rows,
    scatter_columns,
    store_pairs,
    strip_view,
    unpair,
)
from app.halfspace.fft.transpose import ColumnGroup, deal_columns
from app.halfspace.grid import Slabs
from app.halfspace.reductions import any_nonzero, sum_over

_ROWS_AT_ONCE, _COLUMNS_AT_ONCE = 2 * STRIP, STRIP  # two real rows are a sequence
_FLAGS = (fftw.FFTW_ESTIMATE,)  # deterministic, and as fast as measured plans here


@njit()
def _scale_first_half(parts, factor):
    two, one = np.uint64(2), np.uint64(1)
    for k in range(np.uint64(factor.size)):
        parts[two * k] *= factor[k]
        parts[two * k + one] *= factor[k]


@njit()
def _scale_second_half(parts, factor):
    two, one, length = np.uint64(2), np.uint64(1), np.uint64(parts.size // 2)
    for k in range(one, length - np.uint64(factor.size) + one):
        i = two * (length - k)
        parts[i] *= factor[k]
        parts[i + one] *= factor[k]


@njit()
def _scale_by_even_spectrum(parts, spectrum, count):
    """columns[c, k] *= spectrum[c, min(k, N - k)] for the first `count` columns, given as real and imaginary parts."""
    for c in range(count):
        _scale_first_half(parts[c], spectrum[c])
        _scale_second_half(parts[c], spectrum[c])


@njit()
def _divide_by_even_spectrum(columns, spectrum, count, scale):
    """columns[c, k] *= scale / spectrum[c, min(k, N - k)] for the first `count` columns."""
    length, half = np.uint64(columns.shape[1]), np.uint64(spectrum.shape[1])
    for c in range(count):
        column = columns[c]
        for k in range(length):
            factor = scale / spectrum[c, k if k < half else length - k]
            column[k] = complex(column[k].real * factor, column[k].imag * factor)


class _Batch:
    """Some complex sequences and their transforms in place."""

    def __init__(self, length, dtype):
        self.data = data = fftw.aligned((STRIP, length), dtype=dtype)
        self.forward = fftw.fftn(data, None, (1,), 1, _FLAGS, data)
        self.backward = fftw.ifftn(data, None, (1,), 1, _FLAGS, data)
        data[...] = 0


# Scratch of one transform after the other: rows and columns of all grids share what has the same length.
_batch = lru_cache(maxsize=64)(_Batch)
_scratch = lru_cache(maxsize=64)(np.empty)


@cache
def _warm_up(dtype):
    """Compile the loops, or read them from the cache, now and not in the first product."""
    field, spectrum = np.zeros((0, 1)), np.zeros((0, 1), dtype)
    batch = np.zeros((1, 1), np.result_type(dtype, np.complex64))
    nothing, mask, fixed = batch[:0], field.astype(bool), field.view()
    fixed.flags.writeable = False
    for inside in (None, mask):
        for real in (field, spectrum, fixed):
            pair(real, inside, batch)
        for real in (field, spectrum):
            unpair(batch, inside, real)
    for data in (field, spectrum, fixed, mask):
        any_nonzero(data)
    strips = nothing.reshape(-1)
    store_pairs(batch, 0, 0, strips, strips, 0, 0)
    fetch_pairs(batch, 0, 0, strips, strips, 0, 0)
    clear_rows(strips, 0, 0, 0)
    put_rows(spectrum, spectrum.reshape(-1), 0, 0)
    gather_columns(nothing, batch, 0)
    scatter_columns(nothing, batch, 0)
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
    workspace : EvenMultiplier, optional
        One whose working storage is shared, as far as it is large enough; it must be at rest meanwhile.

    Attributes
    ----------
    count : int
        Products computed so far.
    """

    _rest = None  # what is added to the multiplication, if anything: `app.halfspace.images.Rest`

    def __init__(self, shape, periods, slabs=None, comm=None, dtype=np.float64, workspace=None):
        self.shape, self.periods = shape, periods
        self.slabs = slabs or Slabs(shape[0])
        self.comm = comm if comm is not None and comm.size > 1 else None
        self.dtype = np.dtype(dtype)
        complex_type = np.result_type(self.dtype, np.complex64)
        self.count = 0
        ny_fft, nx_fft = periods
        self._columns = columns = nx_fft // 2 + 1
        self._groups = deal_columns(columns, self.slabs.counts, self.comm)
        self._spectrum = None
        self._inverse = False
        self._inverse_scale = 1.0 / (float(periods[0]) * periods[1]) ** 2

        size = columns * self.slabs.local
        self._transformed = _storage(size, complex_type, workspace and workspace._transformed)
        self._pieces = [piece for group in self._groups for piece in group.pieces(self._transformed)]
        self._received = None
        if self.comm is not None:
            largest = max(group.to_receive for group in self._groups)
            self._received = _storage(largest, complex_type, workspace and workspace._received)

        self._rows_plan, self._columns_plan = _batch(nx_fft, complex_type), _batch(ny_fft, complex_type)
        self._pairs, self._column = self._rows_plan.data, self._columns_plan.data
        self._column_parts = self._column.view(self.dtype)
        self._scratch = _scratch(_ROWS_AT_ONCE * columns, complex_type)
        _warm_up(self.dtype)

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
            ColumnGroup(of_fields.edges[0], of_fields.edges[-1], mine.size, mine.rank, mine.counts)
            for of_fields in self._groups
        ]
        in_x = _storage(mine.local * (half_x + 1), self.dtype, self._transformed)
        pieces = [piece for group in groups for piece in group.pieces(in_x)]
        for start in range(mine.rows.start, mine.rows.stop, _ROWS_AT_ONCE):
            stop = min(start + _ROWS_AT_ONCE, mine.rows.stop)
            block = np.zeros((stop - start, half_x + 1), self.dtype)
            block[:, :columns] = kernel_rows(slice(start, stop))[:, :columns]
            block = transform_even(block, nx_fft)
            for first, last, strips in pieces:
                put_rows(block[:, first:last].copy(), strips, mine.local, start - mine.rows.start)
        spectrum = np.empty((sum(g.mine.stop - g.mine.start for g in self._groups), half_y + 1), self.dtype)
        done = 0
        for group in groups:
            count = group.mine.stop - group.mine.start
            dealt = group.deal(self.comm, group.part(in_x), np.empty(group.to_receive, self.dtype))
            for first in range(0, count, _COLUMNS_AT_ONCE):
                last = min(first + _COLUMNS_AT_ONCE, count)
                column = np.zeros((last - first, half_y + 1), self.dtype)
                for strips, (a, b) in zip(dealt, group.row_ranges, strict=True):
                    column[:, a:b] = strip_view(strips, b - a, first, last).T
                spectrum[done + first : done + last] = transform_even(column, ny_fft)
            done += count
        self._spectrum = spectrum

    def set_spectrum(self, symbol):
        """Set the spectrum to a given function. Collective.

        Parameters
        ----------
        symbol : callable
            ``symbol(columns, rows) -> ndarray (columns, rows)`` for arrays of frequencies in x, up to half the period,
            and in y, all up to half the period.
        """
        mine = np.concatenate([np.arange(g.mine.start, g.mine.stop) for g in self._groups])
        rows = np.arange(self.periods[0] // 2 + 1)
        spectrum = np.empty((mine.size, rows.size), self.dtype)
        for start in range(0, mine.size, _ROWS_AT_ONCE):
            spectrum[start : start + _ROWS_AT_ONCE] = symbol(mine[start : start + _ROWS_AT_ONCE], rows)
        self._spectrum = spectrum

    def centre(self):
        """Entries of the operator between a cell and its eight neighbours, shape (3, 3). Collective when first used."""
        return self._surveyed[0]

    def all_positive(self):
        """Whether all values of the spectrum are positive and finite. Collective when first used."""
        return self._surveyed[1]

    @cached_property
    def _surveyed(self):
        """These two, by one reduction."""
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
        extremes = self._spectrum.min(initial=1.0), self._spectrum.max(initial=1.0)
        wrong = not (extremes[0] > 0 and np.isfinite(extremes[1]))
        *quarter, wrong = sum_over(self.comm, [*quarter.reshape(-1), wrong])
        offsets = np.abs(np.arange(-1, 2))
        return np.reshape(quarter, (2, 2)).T[np.ix_(offsets, offsets)], not wrong

    def scale_spectrum(self, function):
        """Replace the spectrum by ``function(spectrum)`` and fold in the scale of the inverse transform."""
        vars(self).pop("_surveyed", None)
        self._spectrum[...] = function(self._spectrum)
        self._spectrum *= 1.0 / (self.periods[0] * self.periods[1])

    def in_precision(self, dtype):
        """Return the same multiplication in another precision, with the same working storage. Not collective."""
        other = EvenMultiplier.__new__(type(self))
        EvenMultiplier.__init__(other, self.shape, self.periods, self.slabs, self.comm, dtype, self)
        other._spectrum = self._spectrum.astype(dtype)
        return other

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

    @property
    def flops(self):
        """Floating point operations of a product on this rank, by the usual count for its transforms."""
        ny_fft, nx_fft = self.periods
        columns = len(self._spectrum)
        in_x, in_y = (5 * n * np.log2(max(n, 2)) for n in (nx_fft, ny_fft))
        return self.slabs.local * in_x + 2 * columns * (in_y + ny_fft)

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
        if self._rest is not None:
            self._rest.multiply(p, mask)
        self._rows_forward(p, mask, rows)
        done = 0
        for group in self._groups:
            done = self._columns_of(group, done)
        self._rows_backward(out, mask, rows)
        if self._rest is not None:
            self._rest.add(out, mask)

    def _rows_forward(self, p, mask, rows):
        for i in range(0, len(p), _ROWS_AT_ONCE):
            block = p[i : i + _ROWS_AT_ONCE]
            inside = None if mask is None else mask[i : i + _ROWS_AT_ONCE]
            here = slice(i, i + len(block))
            data = rows[None, here] if rows is not None else block if mask is None else inside
            if not any_nonzero(data):
                for _, _, strips in self._pieces:
                    clear_rows(strips, len(p), i, len(block))
                continue
            pair(block, inside, self._pairs)
            self._rows_plan.forward()
            for first, _, strips in self._pieces:
                store_pairs(self._pairs, first, len(block), self._scratch, strips, len(p), i)

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
                (strip_view(strips, stop - start, first, last), start)
                for strips, (start, stop) in zip(dealt, group.row_ranges, strict=True)
            ]
            for strip, start in pieces:
                gather_columns(strip, column, start)
            column[:, ny:] = 0
            self._columns_plan.forward()
            spectrum = self._spectrum[done + first : done + last]
            if self._inverse:
                _divide_by_even_spectrum(column, spectrum, w, self._spectrum.dtype.type(self._inverse_scale))
            else:
                _scale_by_even_spectrum(self._column_parts, spectrum, w)
            self._columns_plan.backward()
            for strip, start in pieces:
                scatter_columns(strip, column, start)
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
                fetch_pairs(self._pairs, first, len(block), self._scratch, strips, len(out), i)
            self._rows_plan.backward()
            unpair(self._pairs, inside, block)


def _storage(size, dtype, shared=None):
    """Numbers, in the storage of another array if that is large enough."""
    if shared is not None and shared.nbytes >= size * np.dtype(dtype).itemsize:
        return np.ndarray(size, dtype, shared.data)
    return np.zeros(size, dtype)


def transform_even(samples, period):
    """Transform along axis 1 the even `period`-periodic sequences whose first ``period // 2 + 1`` samples are given.

    Not collective. Twice it is ``period`` times the identity.
    """
    if period == 1:
        return samples
    if period % 2 == 0:
        return dct(samples, type=1, axis=1, overwrite_x=True)
    return rfft(np.concatenate([samples, samples[:, :0:-1]], axis=1), axis=1).real
