"""Exact lexicographic Gauss-Seidel sweeps for C A C p = b, at the cost of a few products with A.

A damped sweep solves ``(D / omega + L_C) d = r`` on the contact set C: D the diagonal of A, L_C the strictly
lower part of C A C in row-major order, r the masked defect; then ``p += d``. Cell after cell this is O(n^2)
work. But L is Toeplitz: forward substitution is a convolution in which cell after cell becomes known
(a *causal* or on-line convolution), and it can be blocked:

- *Rows in x-Fourier space.* A solved row is transformed in x, padded with zeros to ``Nx >= 2 nx - 1``. Its
  effect on the rows after it is then, for each of the ``F = Nx/2 + 1`` frequencies, a convolution in y with
  a real number per lag. The transform back gives the right-hand side of the next row.
- *Leaves.* The rows are cut into leaves of some 32 rows. Inside a leaf rows act on rows directly.
- *Transfers.* After leaf m (counted from 1), let 2^k be the largest power of two that divides m: the last
  2^k leaves act on the next 2^k leaves by an FFT in y. Every pair of leaves is served exactly once, and in
  time: the recursion "first half, effect on the second half, second half" without recursion.
- *In a row* the coupling is a Toeplitz triangle with holes: four contact cells at a time take the scalar
  products with what is solved already; long rows are cut into segments with transfers as above.

The result is that of the scalar double loop up to round-off, for any mask. Work is O(n log^2 n); empty rows
and leaves cost nothing. A backward sweep is a forward sweep on arrays flipped in both directions, because
the kernel is even.

Memory: the rows of one half of the leaves (the second half re-uses the storage of the first, whose effect
has been transferred by then), n; the spectra of the kernel for all lengths of transfers, 2 n; the kernel
inside leaves, some 70 nx.

Distribution: frequencies are dealt to the ranks in chunks, so transfers run on all ranks at once; the rows
of a leaf are solved by the rank that owns them, which collects the leaf from all ranks and deals it back.
The iterates are those of one rank.
"""

from __future__ import annotations

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np
from mpi4py_fft import fftw
from scipy.fft import dct, rfft

from app.halfspace.fft.fftw import FFTW
from app.halfspace.fft.lengths import transform_length
from app.halfspace.grid import Slabs
from app.halfspace.sweeps.kernels import LANES, TILE, Rows, count_contact, solve_leaf, transfer

LEAF_ROWS = 48  # at most; with more an FFT is faster than direct coupling
SEGMENT_COLUMNS = 512  # at most
_ROWS_AT_ONCE = 32  # rows of the kernel
_BATCH = 1 << 12  # complex numbers per batch of transforms in y: stay in the cache


class _Leaf(NamedTuple):
    """Rows start <= j < stop, in the order of a sweep, and the rank that has them."""

    start: int
    stop: int
    owner: int


def _cut(starts):
    """Cut slabs into leaves of about equal size: at most a power of two of them, none across slabs."""
    counts = np.diff(starts)
    number = 1
    while number * LEAF_ROWS < starts[-1] or number < np.count_nonzero(counts):
        number *= 2
    rows = -(-starts[-1] // number)
    while np.sum(-(-counts // rows)) > number:
        rows += 1
    leaves = []
    for owner, (start, count) in enumerate(zip(starts, counts, strict=False)):
        parts = -(-count // rows)
        edges = [start + count * p // max(1, parts) for p in range(parts + 1)]
        leaves += [_Leaf(int(a), int(b), owner) for a, b in itertools.pairwise(edges)]
    return leaves, int(rows)


def _largest_power(n):
    """The largest power of two below n; 1 for n = 1."""
    return 1 << max(0, (n - 1).bit_length() - 1)


class GaussSeidel:
    """Exact lexicographic Gauss-Seidel sweeps for the influence matrix of a grid.

    Collective over `comm`.

    Parameters
    ----------
    quadrant_rows : callable
        ``quadrant_rows(first, last) -> ndarray (last - first, nx)``: rows of the kernel ``K[|dy|, |dx|]``,
        asked for a few at a time.
    grid_shape : (int, int)
        ``(ny, nx)``.
    slabs : Slabs, optional
        Distribution of the rows; default: all here.
    comm : mpi4py communicator, optional
        Ranks that share the grid; default: this one alone.
    dtype : numpy real type
        float64, or float32 for half the memory at single precision.

    Raises
    ------
    ValueError
        For any other `dtype`.
    """

    def __init__(self, quadrant_rows, grid_shape, slabs=None, comm=None, dtype=float):
        self.shape = ny, nx = grid_shape
        self.slabs = slabs or Slabs(ny)
        self.comm = comm if comm is not None and comm.size > 1 else None
        self.dtype = np.dtype(dtype)
        self._complex = np.result_type(self.dtype, np.complex64)
        self._length = transform_length(nx)
        self._frequencies = self._length // 2 + 1
        self._flops = self._sweeps = 0

        leaves, leaf_rows = _cut(self.slabs.starts)
        self._leaves = leaves, [_Leaf(ny - b, ny - a, owner) for a, b, owner in reversed(leaves)]
        chunks = -(-self._frequencies // LANES)
        size, rank = (1, 0) if self.comm is None else (comm.size, comm.rank)
        edges = [chunks * q // size for q in range(size + 1)]
        self._chunks = [b - a for a, b in itertools.pairwise(edges)]  # of each rank

        self._fftw = FFTW(self.dtype)
        first_rows = quadrant_rows(0, min(ny, leaf_rows + TILE))
        self._diagonal = float(first_rows[0, 0])
        self._rows = self._prepare_rows(first_rows)
        near = np.zeros((leaf_rows + TILE, chunks * LANES))
        near[: len(first_rows), : self._frequencies] = self._transform_in_x(first_rows)
        near = near.reshape(-1, chunks, LANES).transpose(1, 0, 2)
        self._near = np.repeat(near, 2, axis=2).astype(self.dtype, order="C")  # for Re and Im

        half = _largest_power(len(leaves))
        self._stored = np.zeros((self._chunks[rank], half * leaf_rows, LANES), self._complex)
        self._leaf = None if self.comm is None else np.empty(chunks * leaf_rows * LANES, self._complex)
        self._transfers = []
        if len(leaves) > 1:
            lengths = [transform_length(leaf_rows << level) for level in range(half.bit_length())]
            self._prepare_transfers(self._kernel_in_x(quadrant_rows, edges, rank), lengths)

    def _transform_in_x(self, rows):
        """Fourier transform in x of rows of K, even and padded, as needed here: ``-K^ / Nx``, real."""
        padded = np.zeros((len(rows), self._frequencies))
        padded[:, : rows.shape[1]] = rows
        return dct(padded, type=1, axis=1, overwrite_x=True) / -self._length

    def _with_spectrum(self, length):
        """Real array of this length and, in the same memory, its spectrum."""
        spectrum = fftw.aligned(length // 2 + 1, dtype=self._complex)
        spectrum[...] = 0
        return spectrum.view(self.dtype), spectrum

    def _prepare_rows(self, kernel):
        """Plans, kernel and work space for single rows."""
        nx = self.shape[1]
        cells, _ = self._with_spectrum(self._length)
        solved, _ = self._with_spectrum(self._length)
        real, spectrum = self._with_spectrum(self._length)
        forward, _ = self._fftw.plans(solved[None], spectrum[None], self._length)
        _, backward = self._fftw.plans(cells[None], spectrum[None], self._length)
        close = np.repeat(self._transform_in_x(kernel[:TILE]), 2, axis=1).astype(self.dtype)

        levels = 0
        while nx > SEGMENT_COLUMNS << levels:
            levels += 1
        segment = -(-nx // (1 << levels))
        lengths = [transform_length(segment << level) for level in range(levels)]
        work, work_spectrum = self._with_spectrum(max(lengths, default=2))
        plans = [self._fftw.plans(work[None], work_spectrum[None], length) for length in lengths]
        far = [rfft(kernel[0, :length], length) / length for length in lengths]
        within = kernel[0].astype(self.dtype)
        return Rows(
            execute=self._fftw.execute,
            forward=forward,
            backward=backward,
            cells=cells,
            solved=solved,
            spectrum=real,
            recent=np.zeros((TILE, len(real)), self.dtype),
            close=close,
            contact=np.zeros(nx, np.int64),
            kernel=within,
            reverse=within[::-1].copy(),
            segment=segment,
            far=np.concatenate([[], *far]).astype(self._complex),
            starts=np.cumsum([0] + [len(f) for f in far]),
            plans=np.array(plans, np.int64).reshape(-1, 2),
            work=work,
            work_spectrum=work_spectrum,
        )

    def _prepare_transfers(self, kernel, lengths):
        """Spectra of the kernel on this rank's frequencies and plans, for transfers of 1, 2, 4 .. leaves."""
        self._work = fftw.aligned(
            (2, max(min(_BATCH, LANES * lengths[-1]), lengths[-1])), dtype=self._complex
        )
        self._work[...] = 0
        for length in lengths:
            far = np.empty((len(kernel), LANES, length // 2 + 1), self._complex)
            for chunk, part in zip(far, kernel, strict=True):
                chunk[...] = rfft(part[:, :length], length) / length
            batch = LANES
            while batch * length > self._work.shape[1]:
                batch //= 2
            cells, spectrum = (work[: batch * length].reshape(batch, length) for work in self._work)
            plans = self._fftw.plans(cells, spectrum, length)
            self._transfers.append((far, self._fftw.execute, *plans, cells, spectrum))

    def _kernel_in_x(self, quadrant_rows, edges, rank):
        """x-transforms of all rows of K at this rank's frequencies, shape (chunks, LANES, ny)."""
        ny, size = self.shape[0], len(self._chunks)
        lags = [ny * q // size for q in range(size + 1)]
        here = np.zeros((edges[-1] * LANES, lags[rank + 1] - lags[rank]))
        for start in range(lags[rank], lags[rank + 1], _ROWS_AT_ONCE):
            stop = min(start + _ROWS_AT_ONCE, lags[rank + 1])
            rows = self._transform_in_x(quadrant_rows(start, stop))
            here[: self._frequencies, start - lags[rank] : stop - lags[rank]] = rows.T
        if self.comm is None:
            return here.reshape(self._chunks[rank], LANES, ny)
        lanes = self._chunks[rank] * LANES
        counts = np.diff(lags)
        received = np.empty(lanes * ny)
        sent = [chunks * LANES * counts[rank] for chunks in self._chunks]
        self.comm.Alltoallv([here, sent], [received, list(lanes * counts)])
        kernel = np.empty((lanes, ny))
        for first, last in itertools.pairwise(lags):
            kernel[:, first:last] = received[lanes * first : lanes * last].reshape(lanes, last - first)
        return kernel.reshape(self._chunks[rank], LANES, ny)

    @property
    def memory(self):
        """Bytes held on this rank."""
        arrays = [self._near, self._stored, self._leaf, *self._rows]
        if self._transfers:
            arrays += [self._work, *(far for far, *_ in self._transfers)]
        return sum({a.ctypes.data: a.nbytes for a in arrays if isinstance(a, np.ndarray)}.values())

    @property
    def products_per_sweep(self):
        """Operations of the sweeps so far, on average, divided by those of a full product with A.

        Not collective. Counted by a model that depends on the contact sets only: 2.5 N log2 N for a real
        transform, twice that for a complex one, 2 for a multiplication and an addition. In a row a contact
        cell is charged half a segment.
        """
        ny, frequencies = self.shape[0], self._frequencies
        length = transform_length(ny)
        product = 2 * ny * _flops(self._length) + frequencies * (4 * _flops(length) + 2 * length)
        return self._flops / max(1, self._sweeps) / product

    def sweep(self, r, mask, omega, d, backward=False):
        """Solve ``(D / omega + L_C) d = r`` on C; ``L_C^T`` instead of L_C for a backward sweep.

        Collective.

        Parameters
        ----------
        r : ndarray, shape (local rows, nx)
            Defect; not used outside C.
        mask : ndarray of bool, shape (local rows, nx)
            The contact set C.
        omega : float
            Damping; 1 is Gauss-Seidel itself.
        d : ndarray, shape (local rows, nx)
            The correction, to be added to the solution; zero outside C.
        backward : bool
            Last cell first.

        Raises
        ------
        ValueError
            If a field has another shape.
        """
        shape = self.slabs.local, self.shape[1]
        if not r.shape == mask.shape == d.shape == shape:
            raise ValueError(f"fields of shapes {r.shape}, {mask.shape}, {d.shape}: all must be {shape}")
        mask = mask.astype(bool, copy=False).view(np.uint8)
        d[...] = 0
        counts = count_contact(mask)
        if self.comm is not None:
            counts, local = np.empty(self.shape[0], np.int64), counts
            self.comm.Allgatherv(local, [counts, list(self.slabs.counts)])
        self._sweeps += 1
        self._flops += self._rows_flops(counts)
        occupied = counts[::-1] > 0 if backward else counts > 0
        leaves = self._leaves[backward]
        filled = [m for m, leaf in enumerate(leaves) if occupied[leaf.start : leaf.stop].any()]
        if not filled:
            return
        leaves = leaves[filled[0] : filled[-1] + 1]
        half = _largest_power(len(leaves))
        first, second = leaves[0].start, leaves[half].start if half < len(leaves) else self.shape[0]

        def place(rows):
            """Where rows are stored."""
            shift = first if rows.start < second else second
            return slice(rows.start - shift, rows.stop - shift)

        self._stored[:, place(slice(first, leaves[0].stop))] = 0
        for m, leaf in enumerate(leaves, 1):
            rows = slice(leaf.start, leaf.stop)
            if occupied[rows].any():
                block, slot = self._collect(place(rows), leaf.owner)
                if block is not None:
                    self._solve(block, slot, leaf, occupied[rows], r, mask, omega, d, backward)
                self._deal(block, place(rows), leaf.owner)
            else:
                self._stored[:, place(rows)] = 0
            if m < len(leaves):
                level = (m & -m).bit_length() - 1
                source = slice(leaves[m - (1 << level)].start, leaf.stop)
                target = slice(leaf.stop, leaves[min(m + (1 << level), len(leaves)) - 1].stop)
                if occupied[source].any() and occupied[target].any():
                    untouched = m == 1 << level  # the source begins with the first leaf
                    self._transfer(place(source), place(target), untouched, level)

    def _solve(self, block, slot, leaf, occupied, r, mask, omega, d, backward):
        """Solve the rows of a leaf of this rank."""
        row, step = (self.shape[0] - 1 - leaf.start, -1) if backward else (leaf.start, 1)
        row -= self.slabs.rows.start
        weight = self.dtype.type(omega / self._diagonal)
        block = block.view(self.dtype)
        solve_leaf(block, slot, occupied, self._near, self._rows, r, mask, d, row, step, weight)

    def _transfer(self, source, target, untouched, level):
        """Add the effect of the rows stored at `source` to those at `target`, which come right after them."""
        sizes = source.start, source.stop - source.start, target.start, target.stop - target.start
        transfer(self._stored, *sizes, untouched, *self._transfers[level])
        length = self._transfers[level][-1].shape[1]
        self._flops += self._frequencies * (4 * _flops(length) + 6 * length)

    def _collect(self, slots, owner):
        """Bring a leaf stored at `slots`, all frequencies, to its owner: array and first slot. Collective."""
        if self.comm is None:
            return self._stored, slots.start
        part = self._stored[:, slots].copy()
        if owner != self.comm.rank:
            self.comm.Gatherv(part, None, owner)
            return None, 0
        shape = sum(self._chunks), part.shape[1], LANES
        leaf = self._leaf[: np.prod(shape)]
        self.comm.Gatherv(part, [leaf, self._leaf_counts(shape)], owner)
        return leaf.reshape(shape), 0

    def _deal(self, leaf, slots, owner):
        """Store a solved leaf that its owner has at `slots` of all ranks. Collective."""
        if self.comm is None:
            return
        part = np.empty_like(self._stored[:, slots])
        send = None if leaf is None else [leaf, self._leaf_counts(leaf.shape)]
        self.comm.Scatterv(send, part, owner)
        self._stored[:, slots] = part

    def _leaf_counts(self, shape):
        return [chunks * shape[1] * shape[2] for chunks in self._chunks]

    def _rows_flops(self, counts):
        """Operations for single rows and inside leaves."""
        rows = self._rows
        lengths = 2 * (np.diff(rows.starts) - 1)
        row = 2 * _flops(self._length)
        row += sum((2 * _flops(n) + 3 * n) * (1 << k) for k, n in enumerate(reversed(lengths)))
        coupling = 0
        for leaf in self._leaves[0]:
            filled = np.count_nonzero(counts[leaf.start : leaf.stop])
            coupling += 2 * self._frequencies * filled * (filled - 1)
        return np.count_nonzero(counts) * row + counts.sum() * rows.segment + coupling


def _flops(length):
    """Operations of a real transform."""
    return 2.5 * length * np.log2(length)


@cache
def warm_up():
    """Compile the loops, or read them from the cache, now and not in the first sweep. Not collective."""
    rows, columns = 64, 4
    kernel = 1.0 / (1.0 + np.arange(rows)[:, None] + np.arange(columns))
    smoother = GaussSeidel(lambda first, last: kernel[first:last], (rows, columns))
    ones = np.ones((rows, columns))
    for backward in (False, True):
        smoother.sweep(ones, ones > 0, 1.0, np.empty_like(ones), backward)
