"""Multiplication by a real even function in Fourier space.

This module has the transforms. The products u = A p with the influence matrix A are subclasses of `EvenMultiplier`, in
`app.halfspace.product`.

Fields are padded with zeros to the periods ``Ny x Nx``. The transform convention is numpy's (forward
``exp(-2 pi i k x)``, unscaled). The factor ``1 / (Nx Ny)`` of the inverse is included in the spectrum.

- *Pruned*: in x only nonzero rows are transformed, and only the requested rows are transformed back. Two real rows are
  transformed as one complex row.
- *Blocked*: a few columns at a time are transformed, scaled and transformed back, inside the processor's cache.
  Transformed rows are stored as strips of a few columns (`strips`), so that rows and columns are accessed in order.
- *Real even spectrum*: the kernel K is even in both directions, so its spectrum is real and even. The spectrum needs
  (Nx/2+1)(Ny/2+1) doubles, about one per cell if the periods are twice the sides of the field. The rows transformed in
  x need two more doubles per cell, so a product needs three doubles per cell.
- *Distributed*: each rank has a slab of rows. One all-to-all deals the columns to the ranks, and another one sends them
  back (`transpose`). Ranks that share memory send nothing. Large transfers are split into groups of columns, so the
  receive buffer is smaller than a field.
"""

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.fft import dct, rfft

from app.base.numba_cache import as_writable
from app.halfspace import events
from app.halfspace.fft.fftw import FFTW, aligned
from app.halfspace.fft.strips import (
    ROWS,
    STRIP,
    convolve_columns,
    rows_to_strips,
    store_rows,
    strips_to_rows,
)
from app.halfspace.fft.transpose import ColumnGroup, Exchange, deal_columns
from app.parallel.reductions import sum_over
from app.parallel.shared_memory import Storage
from app.parallel.slabs import Slabs, none_if_single

_SPECTRUM_COLUMNS = 128  # computed in one call of a symbol, which shares work between them
_CACHE_LINE = 64  # bytes
_NO_MASK, _NO_ROWS = np.zeros((0, 0), bool), np.zeros(0, bool)


class _Sequences:
    """Work arrays for complex sequences and transforms, with plans.

    The starts of neighbouring sequences are an odd number of cache lines apart, so that they do not compete for the
    same places of the cache.
    """

    def __init__(self, length, dtype, count):
        line = _CACHE_LINE // np.dtype(dtype).itemsize
        stride = line * (-(-length // line) | 1)
        # Out of place, because estimated plans are faster so (0.7 to 0.95 of the time). Measured plans would be faster
        # still, but differ from day to day, and so would the last digits of a solution.
        self.data, self.transforms = _scratch((2, count, stride), dtype)
        self.length, self._count, self._plans = length, count, {}
        self._fftw = FFTW(np.dtype(self.data.real.dtype))
        self.execute = self._fftw.execute

    def plans(self, few):
        """Return plans, forward and back, for all and for `few` sequences."""
        for count in (self._count, few or self._count):
            if count not in self._plans:
                arrays = self.data[:count], self.transforms[:count]
                self._plans[count] = self._fftw.plans(*arrays, self.length)
        return self._plans[self._count] + self._plans[few or self._count]


def _in_strip(count):
    return max(1, min(STRIP, count))  # sequences that are transformed together


# Rows and columns of all grids share the work arrays of a length.
_sequences = lru_cache(maxsize=128)(_Sequences)
_scratch = lru_cache(maxsize=64)(aligned)


class SpectrumCache(dict):
    """Cache of the spectra of an operator.

    `before` is the cache of the operator that was used before this one, in a window at another place. Both operators
    have the same periods, and so the same spectra. The contents depend only on the operators made before, so they are
    the same on all ranks of a grid.
    """

    def __init__(self, before=None):
        super().__init__()
        self._before = dict(before or {})

    def lookup(self, key):
        """Return the spectrum stored with a key, or None."""
        return self.get(key, self._before.pop(key, None))

    def drop_unused(self):
        """Free the previous operator's spectra that this operator has not used."""
        self._before.clear()


class Layout(NamedTuple):
    """Distribution, precision and storage that the multipliers of one operator share.

    The default is a single rank and double precision. Products in `float32` take half the time and memory.
    """

    slabs: object = None  # Slabs; None: this rank has all rows.
    comm: object = None  # Ranks that share the grid; the ranks of a `Communicator` may also share memory.
    dtype: object = np.float64
    workspace: object = None  # Multiplier that lends its working storage, if its own part is large enough.
    spectra: object = None  # SpectrumCache


SERIAL = Layout()


class EvenMultiplier:
    """Multiplication by a real even function in Fourier space.

    A product is the convolution of a field with an even kernel. Fields have the `shape` (ny, nx) and are padded with
    zeros to the `periods` (Ny, Nx). The attribute `count` is the number of products computed. Collective over the
    layout's ranks.
    """

    image_correction = None  # ImageCorrection of `app.halfspace.images`, added to the product

    def __init__(self, shape, periods, layout=SERIAL):
        self.shape, self.periods = shape, periods
        self.slabs = layout.slabs or Slabs(shape[0])
        self.comm = none_if_single(layout.comm)
        self.dtype, self._spectra = np.dtype(layout.dtype), layout.spectra
        complex_type = np.result_type(self.dtype, np.complex64)
        self.count = 0
        ny_fft, nx_fft = periods
        columns = nx_fft // 2 + 1
        self._groups = deal_columns(columns, self.slabs.counts, self.comm)
        self._spectrum = None
        self._inverse_scale = 1.0 / (float(periods[0]) * periods[1]) ** 2

        self._sizes = sizes = [columns * rows * complex_type.itemsize for rows in self.slabs.counts]
        lender = layout.workspace
        suits = lender is not None and lender._lends(sizes)
        self._storage = lender._storage if suits else Storage(sizes, self.slabs.rank, self.comm)
        self._transformed = np.ndarray(columns * self.slabs.local, complex_type, self._storage.own)
        self._edges = np.array([0, *(edge for group in self._groups for edge in group.edges[1:])])
        self._exchange = Exchange(self._groups, self._transformed, self.comm, self._storage)

        pairs = -(-self.slabs.local // 2)
        self._in_x = _sequences(nx_fft, complex_type, _in_strip(pairs))
        self._in_y = in_y = _sequences(ny_fft, complex_type, _in_strip(max(g.count for g in self._groups)))
        self._row_plans = self._in_x.plans(pairs % STRIP)
        self._column_plans = [in_y.plans(group.count % STRIP) for group in self._groups]
        self._column_work = in_y.length, in_y.data, in_y.transforms, in_y.transforms.view(self.dtype)
        self._scratch = _scratch((2 * _in_strip(pairs) * columns,), complex_type)

    def _lends(self, sizes):
        """Return whether this multiplier's own part of the storage has enough bytes for each rank."""
        return len(sizes) <= len(self._sizes) and all(map(int.__le__, sizes, self._sizes))

    def load_or_make(self, key, make):
        """Take the spectrum from the operator's cache, or compute it. Collective.

        `key` distinguishes the spectra of multipliers with the same type, periods and layout. The function `make` calls
        `set_kernel` or `set_spectrum`.
        """
        key = type(self), key, self.periods, self.dtype.name, tuple(self._edges)
        self._spectrum = None if self._spectra is None else self._spectra.lookup(key)
        if self._spectrum is None:
            with events.spectra:
                make()
        if self._spectra is not None:
            self._spectra[key] = self._spectrum

    def set_kernel(self, kernel_rows, rows, columns):
        """Transform an even kernel to the spectrum. Collective.

        The function ``kernel_rows(slice)`` returns rows of the kernel at non-negative offsets. The kernel is zero at
        offsets of `rows` and more in y, and of `columns` and more in x. Both numbers are at most half a period plus
        one.
        """
        ny_fft, nx_fft = self.periods
        half_x, half_y = nx_fft // 2, ny_fft // 2
        slabs = Slabs.over(self.comm, rows)  # rows of the kernel, not of the fields
        ranks = slabs.size, slabs.rank, slabs.counts
        groups = [ColumnGroup(group.edges[0], group.edges[-1], *ranks) for group in self._groups]
        in_x = self._transformed.view(self.dtype)
        if in_x.size < slabs.local * (half_x + 1):
            in_x = np.zeros(slabs.local * (half_x + 1), self.dtype)
        pieces = [piece for group in groups for piece in group.pieces(in_x)]
        for start in range(slabs.rows.start, slabs.rows.stop, ROWS):
            stop = min(start + ROWS, slabs.rows.stop)
            block = np.zeros((stop - start, half_x + 1), self.dtype)
            block[:, :columns] = kernel_rows(slice(start, stop))[:, :columns]
            block = transform_even(block, nx_fft)
            for first, last, strips in pieces:
                store_rows(block[:, first:last].copy(), strips, slabs.local, start - slabs.rows.start)
        spectrum = np.empty((sum(group.count for group in groups), half_y + 1), self.dtype)
        done = 0
        for group in groups:
            dealt = group.deal(self.comm, group.part(in_x), np.empty(group.to_receive, self.dtype))
            for first in range(0, group.count, STRIP):
                last = min(first + STRIP, group.count)
                column = np.zeros((last - first, half_y + 1), self.dtype)
                for strips, (a, b) in zip(dealt, group.row_ranges, strict=True):
                    column[:, a:b] = strips[(b - a) * first : (b - a) * last].reshape(b - a, last - first).T
                spectrum[done + first : done + last] = transform_even(column, ny_fft)
            done += group.count
        self._set_scaled(spectrum)

    def set_spectrum(self, symbol):
        """Set the spectrum to a function of the frequencies.

        The function ``symbol(columns, rows)`` returns the spectrum at the frequencies `columns` in x and `rows` in y.
        Each call of `symbol` is for a few frequencies in x, and for all frequencies in y up to half the period.
        """
        columns, rows = self._frequencies()
        spectrum = np.empty((columns.size, rows.size), self.dtype)
        for start in range(0, columns.size, _SPECTRUM_COLUMNS):
            block = slice(start, start + _SPECTRUM_COLUMNS)
            spectrum[block] = symbol(columns[block], rows)
        self._set_scaled(spectrum)

    def _frequencies(self):
        columns = [np.arange(group.columns.start, group.columns.stop) for group in self._groups]
        return np.concatenate(columns), np.arange(self.periods[0] // 2 + 1)

    def _set_scaled(self, spectrum):
        spectrum *= 1.0 / (self.periods[0] * self.periods[1])  # scale of the inverse transform
        self._spectrum = spectrum

    @cached_property
    def centre(self):
        """The 3 x 3 centre of the kernel. Collective on first use."""
        ny_fft, nx_fft = self.periods
        columns, rows = self._frequencies()

        def weights(index, period):  # cosines at offsets 0 and 1
            multiplicity = np.where((index > 0) & (2 * index < period), 2.0, 1.0)
            return multiplicity * np.cos(2 * np.pi * index * np.arange(2)[:, None] / period)

        in_y = self._spectrum @ weights(rows, ny_fft).T
        quarter = np.reshape(sum_over(self.comm, np.ravel(weights(columns, nx_fft) @ in_y)), (2, 2))  # [x, y]
        offsets = np.abs(np.arange(-1, 2))
        return quarter.T[np.ix_(offsets, offsets)]

    def in_precision(self, dtype, kind=None):
        """Return a copy of this multiplier in another precision.

        Both share the work array. `kind` is the class of the copy, by default the same class.
        """
        other = EvenMultiplier.__new__(kind or type(self))
        EvenMultiplier.__init__(other, self.shape, self.periods, Layout(self.slabs, self.comm, dtype, self))
        other._spectrum = self._spectrum.astype(dtype)
        return other

    @property
    def points(self):
        """Number of points of all products so far: Ny Nx for each."""
        return self.count * self.periods[0] * self.periods[1]

    @property
    def working_storage(self):
        """Work array of products, as bytes; unused between products."""
        return self._transformed.view(np.uint8)

    @cached_property
    def flops(self):
        """Floating point operations of a product on this rank."""
        ny_fft, nx_fft = self.periods
        columns = len(self._spectrum)
        in_x, in_y = (5 * n * np.log2(max(n, 2)) for n in (nx_fft, ny_fft))
        return self.slabs.local * in_x + 2 * columns * (in_y + ny_fft)

    def apply_inverse(self, p, out):
        """Multiply p, padded with zeros, by the inverse periodic operator. Collective."""
        self.apply(p, out, scale=self._inverse_scale)

    def apply(self, p, out, mask=None, rows=None, scale=0.0):
        """Multiply by A, or by C A C. Collective.

        A is the convolution of this multiplier, and C the restriction to the mask.

        Parameters
        ----------
        p, out : ndarray, shape (local rows, nx)
            Field and its product; both may be the same array.
        mask : ndarray of bool, shape (local rows, nx), optional
            Cells of the contact set C. Rows without contact are not transformed.
        rows : ndarray of bool, shape (local rows,), optional
            True in rows in which `out` is computed. In all other rows p must be zero, and `out` is undefined.
        scale : float, optional
            If not 0, divide by the spectrum instead of multiplying by it, and multiply by this number.
        """
        self.count += 1
        if not p.flags.writeable:
            p = as_writable(p)
        mask, rows = _NO_MASK if mask is None else mask, _NO_ROWS if rows is None else rows
        if self.image_correction is not None:
            self.image_correction.multiply(p, mask)
        scale, done = self.dtype.type(scale), 0
        in_x = self._in_x
        strips = (
            in_x.length, in_x.data, in_x.transforms, self._scratch, self._transformed, self._edges, in_x.execute,
        )  # fmt: skip
        rows_to_strips(p, mask, rows, *strips, *self._row_plans[::2])
        groups = zip(self._exchange.each(), self._column_plans, self._groups, strict=True)
        for columns, plans, group in groups:
            spectrum = self._spectrum[done : done + group.count]
            convolve_columns(*columns, *self._column_work, spectrum, scale, self._in_y.execute, *plans)
            done += group.count
        strips_to_rows(out, mask, rows, *strips, *self._row_plans[1::2])
        if self.image_correction is not None:
            self.image_correction.add(out, mask)


def transform_even(samples, period):
    """Return the Fourier transforms of real even periodic sequences.

    `samples` has a sequence in each row: its first ``period // 2 + 1`` entries, which are enough because the sequence
    is even. A transform is real and even, too, and is returned in the same form. Two transforms, one after the other,
    multiply a sequence by ``period``.
    """
    if period == 1:
        return samples
    if period % 2 == 0:
        return dct(samples, type=1, axis=1, overwrite_x=True)
    return rfft(np.concatenate([samples, samples[:, :0:-1]], axis=1), axis=1).real
