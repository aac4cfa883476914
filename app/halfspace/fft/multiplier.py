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
- *Distributed*: rows live in slabs, columns are dealt to the ranks (`transpose`); one all-to-all each way, in which
  ranks that share memory send nothing. Large transfers go in several column groups, so that the receive buffer stays a
  fraction of n.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from mpi4py_fft import fftw
from scipy.fft import dct, rfft

from app.halfspace import events
from app.halfspace.fft.fftw import FFTW
from app.halfspace.fft.strips import (
    ROWS,
    STRIP,
    convolve_columns,
    put_rows,
    rows_to_strips,
    strip_view,
    strips_to_rows,
)
from app.halfspace.fft.transpose import ColumnGroup, Exchange, SentExchange, SharedExchange, deal_columns
from app.parallel.reductions import sum_over
from app.parallel.shared_memory import Storage
from app.parallel.slabs import Slabs, none_if_single

_COLUMNS = 128  # of a spectrum that are computed together: what they share is computed anew for the next ones
_LINE = 64  # bytes of the cache
_NO_MASK, _NO_ROWS = np.zeros((0, 0), bool), np.zeros(0, bool)


class _Sequences:
    """Some complex sequences, and a place for their transforms, planned when first asked for.

    They are an odd number of cache lines apart: what is at one place in all of them would else be in the same few
    places of the cache, for lengths are multiples of large powers of two.
    """

    def __init__(self, length, dtype, count):
        line = _LINE // np.dtype(dtype).itemsize
        apart = line * (-(-length // line) | 1)
        # Not in place: estimated plans take 0.7 to 0.95 of the time then. Measured ones take less yet, but are others
        # on another day: the last digits of a solution would be, too.
        self.data, self.transforms = _scratch((2, count, apart), dtype)
        self.length, self._count, self._plans, self._fftw = (
            length,
            count,
            {},
            FFTW(np.dtype(self.data.real.dtype)),
        )
        self.execute = self._fftw.execute

    def plans(self, few):
        """Addresses of the plans for all of them, there and back, and for the `few` that a last batch may have."""
        for count in (self._count, few or self._count):
            if count not in self._plans:
                part = self.data[:count], self.transforms[:count]
                self._plans[count] = self._fftw.plans(*part, self.length)
        return self._plans[self._count] + self._plans[few or self._count]


def _in_strip(count):
    """Limit a number of sequences to those that are transformed together, 1 at least."""
    return max(1, min(STRIP, count))


# Scratch of one transform after the other: rows and columns of all grids share what has the same length.
_sequences = lru_cache(maxsize=128)(_Sequences)


@lru_cache(maxsize=64)
def _scratch(shape, dtype):
    data = fftw.aligned(shape, dtype=dtype)
    data[...] = 0
    return data


class SpectrumCache(dict):
    """Cache of the spectra of an operator, and of those of the one before it (a window moves, its periods stay).

    Not collective. What is known depends on the operators that there were alone, so all ranks of a grid know the same.
    """

    def __init__(self, before=None):
        super().__init__()
        self._before = dict(before or {})

    def known(self, key):
        """Return the spectrum with a key, or None."""
        return self.get(key, self._before.pop(key, None))

    def forget(self):
        """Free what nobody asked for again."""
        self._before.clear()


class Layout(NamedTuple):
    """Where multipliers work, and how: what those of one operator have in common.

    Attributes
    ----------
    slabs : Slabs or None
        Distribution of the rows; None: all here.
    comm : mpi4py communicator or None
        Ranks that share the grid; None: this one alone. Those of a `Communicator` may share memory, too.
    dtype : numpy real type
        float64, or float32 for half the time and memory at single precision.
    workspace : EvenMultiplier or None
        One whose working storage is shared, as far as it is large enough; it must be at rest meanwhile.
    spectra : SpectrumCache or None
        Where spectra are looked for, and kept.
    """

    slabs: object = None
    comm: object = None
    dtype: object = np.float64
    workspace: object = None
    spectra: object = None


SERIAL = Layout()


class EvenMultiplier:
    """Multiply by a real even function in Fourier space: a convolution with an even kernel.

    Collective over the ranks of the layout.

    Parameters
    ----------
    shape : (int, int)
        ``(ny, nx)`` of the fields.
    periods : (int, int)
        ``(Ny, Nx)``, at least `shape`; fields are padded with zeros.
    layout : Layout

    Attributes
    ----------
    count : int
        Products computed so far.
    """

    image_correction = None  # what is added to the multiplication, if anything: `app.halfspace.images`

    def __init__(self, shape, periods, layout=SERIAL):
        self.shape, self.periods = shape, periods
        self.slabs = layout.slabs or Slabs(shape[0])
        self.comm = none_if_single(layout.comm)
        self.dtype = np.dtype(layout.dtype)
        complex_type = np.result_type(self.dtype, np.complex64)
        self.count = 0
        ny_fft, nx_fft = periods
        columns = nx_fft // 2 + 1
        self._groups = deal_columns(columns, self.slabs.counts, self.comm)
        self._spectrum = None
        self._inverse_scale = 1.0 / (float(periods[0]) * periods[1]) ** 2

        sizes = [columns * rows * complex_type.itemsize for rows in self.slabs.counts]
        lent = layout.workspace and layout.workspace._storage
        suits = lent is not None and lent.suits(sizes)
        self._storage = lent if suits else Storage(sizes, self.slabs.rank, self.comm)
        size = columns * self.slabs.local
        self._transformed = np.ndarray(size, complex_type, self._storage.own)
        self._edges = np.array([0, *(edge for group in self._groups for edge in group.edges[1:])])
        self._exchange = self._make_exchange()

        pairs, mine = (
            -(-self.slabs.local // 2),
            [group.mine.stop - group.mine.start for group in self._groups],
        )
        self._in_x = _sequences(nx_fft, complex_type, _in_strip(pairs))
        self._in_y = _sequences(ny_fft, complex_type, _in_strip(max(mine)))
        self._row_plans = self._in_x.plans(pairs % STRIP)
        self._column_plans = [self._in_y.plans(count % STRIP) for count in mine]
        in_y = self._in_y
        self._column_room = in_y.length, in_y.data, in_y.transforms, in_y.transforms.view(self.dtype)
        self._scratch = _scratch((2 * _in_strip(pairs) * columns,), complex_type)

    def _make_exchange(self):
        if self.comm is None:
            return Exchange(self._groups, self._transformed)
        if self._storage.all is None:
            return SentExchange(self._groups, self._transformed, self.comm)
        return SharedExchange(self._groups, self._transformed, self.comm, self._storage)

    def use(self, spectra, key, make):
        """Take a spectrum from those that are known, or ``make()`` and keep it. Collective if that is.

        Parameters
        ----------
        spectra : SpectrumCache or None
        key : hashable
            What tells it from others of this type, periods and layout.
        make : callable
            Calls `set_kernel` or `set_spectrum`.
        """
        key = type(self), key, self.periods, self.dtype.name, tuple(self._edges)
        self._spectrum = None if spectra is None else spectra.known(key)
        if self._spectrum is None:
            with events.spectra:
                make()
        if spectra is not None:
            spectra[key] = self._spectrum

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
        in_x = self._transformed.view(self.dtype)
        if in_x.size < mine.local * (half_x + 1):
            in_x = np.zeros(mine.local * (half_x + 1), self.dtype)
        pieces = [piece for group in groups for piece in group.pieces(in_x)]
        for start in range(mine.rows.start, mine.rows.stop, ROWS):
            stop = min(start + ROWS, mine.rows.stop)
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
            for first in range(0, count, STRIP):
                last = min(first + STRIP, count)
                column = np.zeros((last - first, half_y + 1), self.dtype)
                for strips, (a, b) in zip(dealt, group.row_ranges, strict=True):
                    column[:, a:b] = strip_view(strips, b - a, first, last).T
                spectrum[done + first : done + last] = transform_even(column, ny_fft)
            done += count
        self._take(spectrum)

    def set_spectrum(self, symbol):
        """Set the spectrum to a given function. Not collective.

        Parameters
        ----------
        symbol : callable
            ``symbol(columns, rows) -> ndarray (columns, rows)`` for arrays of frequencies in x, up to half the period,
            and in y, all up to half the period.
        """
        mine = self._columns()
        rows = np.arange(self.periods[0] // 2 + 1)
        spectrum = np.empty((mine.size, rows.size), self.dtype)
        for start in range(0, mine.size, _COLUMNS):
            spectrum[start : start + _COLUMNS] = symbol(mine[start : start + _COLUMNS], rows)
        self._take(spectrum)

    def _columns(self):
        """Numbers of those of this rank."""
        return np.concatenate([np.arange(group.mine.start, group.mine.stop) for group in self._groups])

    def _take(self, spectrum):
        """Fold in the scale of the inverse transform."""
        spectrum *= 1.0 / (self.periods[0] * self.periods[1])
        self._spectrum = spectrum

    @cached_property
    def centre(self):
        """Entries of the operator between a cell and its eight neighbours, shape (3, 3). Collective when first used."""
        ny_fft, nx_fft = self.periods
        columns = self._columns()
        rows = np.arange(ny_fft // 2 + 1)

        def weights(index, period):
            """Cosines at offsets 0 and 1; all but the constant and the highest frequency stand for two."""
            twice = np.where((index > 0) & (2 * index < period), 2.0, 1.0)
            return twice * np.cos(2 * np.pi * index * np.arange(2)[:, None] / period)

        in_y = self._spectrum @ weights(rows, ny_fft).T
        quarter = np.reshape(sum_over(self.comm, np.ravel(weights(columns, nx_fft) @ in_y)), (2, 2))  # [x, y]
        offsets = np.abs(np.arange(-1, 2))
        return quarter.T[np.ix_(offsets, offsets)]

    def in_precision(self, dtype, kind=None):
        """Return the same in another precision, or of another kind, with the same storage. Not collective."""
        other = EvenMultiplier.__new__(kind or type(self))
        EvenMultiplier.__init__(other, self.shape, self.periods, Layout(self.slabs, self.comm, dtype, self))
        other._spectrum = self._spectrum.astype(dtype)
        return other

    @property
    def points(self):
        """Points transformed so far, there and back."""
        return self.count * self.periods[0] * self.periods[1]

    @property
    def working_storage(self):
        """What a product works on, as bytes: for others while it is at rest."""
        return self._transformed.view(np.uint8)

    @property
    def memory(self):
        """Bytes held on this rank."""
        arrays = (
            self._spectrum,
            self._transformed,
            *(array for each in {self._in_x, self._in_y} for array in (each.data, each.transforms)),
            self._scratch,
        )
        return self._exchange.memory + sum(a.nbytes for a in arrays if a is not None)

    @cached_property
    def flops(self):
        """Floating point operations of a product on this rank, by the usual count for its transforms."""
        ny_fft, nx_fft = self.periods
        columns = len(self._spectrum)
        in_x, in_y = (5 * n * np.log2(max(n, 2)) for n in (nx_fft, ny_fft))
        return self.slabs.local * in_x + 2 * columns * (in_y + ny_fft)

    def apply_inverse(self, p, out):
        """Multiply p, continued by zeros, by the inverse of the periodic operator. Collective."""
        self.apply(p, out, scale=self._inverse_scale)

    def apply(self, p, out, mask=None, rows=None, scale=0.0):
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
        scale : float, optional
            If not 0, divide by the spectrum instead, and multiply by this.
        """
        self.count += 1
        inside, rows = _NO_MASK if mask is None else mask, _NO_ROWS if rows is None else rows
        if self.image_correction is not None:
            self.image_correction.multiply(p, inside)
        scale, done = self.dtype.type(scale), 0
        in_x = self._in_x
        strips = (
            in_x.length, in_x.data, in_x.transforms, self._scratch, self._transformed, self._edges, in_x.execute,
        )  # fmt: skip
        rows_to_strips(p, inside, rows, *strips, *self._row_plans[::2])
        for columns, plans, group in zip(
            self._exchange.each(), self._column_plans, self._groups, strict=True
        ):
            count = group.mine.stop - group.mine.start
            convolve_columns(
                *columns, *self._column_room, self._spectrum[done : done + count], scale,
                self._in_y.execute, *plans,
            )  # fmt: skip
            done += count
        strips_to_rows(out, inside, rows, *strips, *self._row_plans[1::2])
        if self.image_correction is not None:
            self.image_correction.add(out, inside)


def transform_even(samples, period):
    """Transform along axis 1 the even `period`-periodic sequences whose first ``period // 2 + 1`` samples are given.

    Not collective. Twice it is ``period`` times the identity.
    """
    if period == 1:
        return samples
    if period % 2 == 0:
        return dct(samples, type=1, axis=1, overwrite_x=True)
    return rfft(np.concatenate([samples, samples[:, :0:-1]], axis=1), axis=1).real
