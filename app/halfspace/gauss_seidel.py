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

import ctypes
import itertools
import weakref
from functools import cache
from typing import NamedTuple

import numba
import numpy as np
from llvmlite import ir
from mpi4py_fft import fftw
from numba import types, uintp
from numba.extending import intrinsic
from scipy.fft import dct, rfft

from app.halfspace.fft.lengths import transform_length
from app.halfspace.grid import Slabs

LEAF_ROWS = 48  # at most; with more an FFT is faster than direct coupling
SEGMENT_COLUMNS = 512  # at most
_LANES = 32  # frequencies in a chunk
_WIDTH = 2 * _LANES  # as reals
_TILE = 4  # rows that act on as many others at once
_ROWS_AT_ONCE = 32  # rows of the kernel
_BATCH = 1 << 12  # complex numbers per batch of transforms in y: stay in the cache

_1, _2, _3, _4, _5, _6 = (np.uintp(i * _WIDTH) for i in range(1, 7))  # offsets of the rows of a tile


class _FFTW:
    """Plans as addresses that compiled code can execute, of the FFTW that mpi4py_fft is linked to."""

    def __init__(self, dtype):
        known = {"float64": (fftw.fftw_xfftn, "fftw"), "float32": (fftw.fftwf_xfftn, "fftwf")}
        if dtype.name not in known:
            raise ValueError(f"dtype {dtype.name}: must be one of {', '.join(known)}")
        module, name = known[dtype.name]
        self._library, self._name = ctypes.CDLL(module.__file__), name
        # mpi4py_fft does the same before it plans: the first such call in a process forgets all plans.
        self._library[f"{name}_plan_with_nthreads"](1)
        self._destroy = self._library[f"{name}_destroy_plan"]
        self._destroy.argtypes = [ctypes.c_void_p]
        self.execute = ctypes.cast(self._library[f"{name}_execute"], ctypes.c_void_p).value

    def plans(self, cells, spectrum, length):
        """Plan the transforms of the rows of `cells` (real or complex) to `spectrum` and back."""
        there, back = (
            (ctypes.c_void_p(a.ctypes.data), None, 1, a.strides[0] // a.itemsize) for a in (cells, spectrum)
        )
        head = (1, ctypes.byref(ctypes.c_int(length)), len(cells))
        if np.iscomplexobj(cells):
            kinds, signs = ("dft", "dft"), ((-1,), (1,))
        else:
            kinds, signs = ("dft_r2c", "dft_c2r"), ((), ())
        return (
            self._plan(kinds[0], *head, *there, *back, *signs[0], fftw.FFTW_ESTIMATE),
            self._plan(kinds[1], *head, *back, *there, *signs[1], fftw.FFTW_ESTIMATE),
        )

    def _plan(self, kind, *arguments):
        planner = self._library[f"{self._name}_plan_many_{kind}"]
        planner.restype = ctypes.c_void_p
        plan = planner(*arguments)
        if plan is None:
            raise RuntimeError(f"FFTW cannot plan {kind}")
        weakref.finalize(self, self._destroy, plan)
        return plan


@intrinsic
def _execute(typing_context, function, plan):
    """Call ``void function(void *plan)``; both are addresses."""

    def generate(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        function_pointer = ir.FunctionType(ir.VoidType(), [pointer]).as_pointer()
        function, plan = arguments
        builder.call(builder.inttoptr(function, function_pointer), [builder.inttoptr(plan, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


class _Rows(NamedTuple):
    """What the solution of single rows needs, for compiled code."""

    execute: int  # address of FFTW's execute
    forward: int  # plan solved -> spectrum
    backward: int  # plan spectrum -> cells
    cells: np.ndarray  # (Nx,), right-hand side of a row
    solved: np.ndarray  # (Nx,), d of the row: zero outside C
    spectrum: np.ndarray  # (2 F,), transform of either, as reals
    recent: np.ndarray  # (_TILE, 2 F), transforms of the last solved rows
    close: np.ndarray  # (_TILE, 2 F), kernel at the smallest lags
    contact: np.ndarray  # (nx,), columns of the contact cells of a row
    kernel: np.ndarray  # (nx,), coupling within a row
    reverse: np.ndarray  # (nx,), the same backwards
    segment: int  # columns of a segment
    far: np.ndarray  # spectra of the kernel, level after level
    starts: np.ndarray  # (levels + 1,), where they start
    plans: np.ndarray  # (levels, 2), forward and backward, both on `work`
    work: np.ndarray  # (longest + 2,)
    work_spectrum: np.ndarray  # (longest / 2 + 1,), the same memory


@numba.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _four_dots(d, start, stop, kernel, k0, k1, k2, k3):
    """Sums over start <= i < stop of d[i] kernel[k + i], for four offsets k."""
    s0 = s1 = s2 = s3 = 0 * d[0]
    for index in range(start, stop):
        i = uintp(index)
        x = d[i]
        s0 += x * kernel[k0 + i]
        s1 += x * kernel[k1 + i]
        s2 += x * kernel[k2 + i]
        s3 += x * kernel[k3 + i]
    return s0, s1, s2, s3


@numba.njit(cache=True)
def _solve_row(rows, count, weight):
    """Solve d + weight L_C d = weight x on the `count` contact cells of a row."""
    x, d, contact, kernel, reverse = rows.cells, rows.solved, rows.contact, rows.kernel, rows.reverse
    last = len(kernel) - 1
    first, end = contact[0], contact[count - 1] + 1
    d[:] = 0
    done = 0
    m = 0
    while True:
        start = first + m * rows.segment
        stop = min(start + rows.segment, end)
        m += 1
        while done < count and contact[done] < stop:
            more = 1
            while more < 4 and done + more < count and contact[done + more] < stop:
                more += 1
            # Of fewer than four cells the last stands in for the missing ones, to no effect.
            t0, t1 = contact[done], contact[done + min(1, more - 1)]
            t2, t3 = contact[done + min(2, more - 1)], contact[done + more - 1]
            s0, s1, s2, s3 = _four_dots(
                d, start, t0, reverse, uintp(last - t0), uintp(last - t1), uintp(last - t2), uintp(last - t3)
            )
            d[t0] = d0 = weight * (x[t0] - s0)
            if more > 1:
                d[t1] = d1 = weight * (x[t1] - s1 - kernel[t1 - t0] * d0)
            if more > 2:
                d[t2] = d2 = weight * (x[t2] - s2 - kernel[t2 - t0] * d0 - kernel[t2 - t1] * d1)
            if more > 3:
                s3 += kernel[t3 - t0] * d0 + kernel[t3 - t1] * d1 + kernel[t3 - t2] * d2
                d[t3] = weight * (x[t3] - s3)
            done += more
        if done == count:
            return
        level = 0
        while not (m >> level) & 1:
            level += 1
        size = rows.segment << level
        if contact[done] >= stop + size:
            continue
        a, b = rows.starts[level], rows.starts[level + 1]
        rows.work[:size] = d[stop - size : stop]
        rows.work[size : 2 * (b - a - 1)] = 0
        _execute(rows.execute, rows.plans[level, 0])
        for k in range(b - a):
            rows.work_spectrum[k] *= rows.far[a + k]
        _execute(rows.execute, rows.plans[level, 1])
        for i in range(stop, min(stop + size, end)):
            x[i] -= rows.work[size + i - stop]


@numba.njit(cache=True, fastmath={"contract"})
def _tile(y, w, b, kernel, k, width):
    """Effect of four rows on four others: y[t] += sum_s kernel[k + t - s + 3] w[b + s]."""
    for index in range(width):
        f = uintp(index)
        k0 = kernel[k + f]
        k1 = kernel[k + _1 + f]
        k2 = kernel[k + _2 + f]
        k3 = kernel[k + _3 + f]
        k4 = kernel[k + _4 + f]
        k5 = kernel[k + _5 + f]
        k6 = kernel[k + _6 + f]
        w0 = w[b + f]
        w1 = w[b + _1 + f]
        w2 = w[b + _2 + f]
        w3 = w[b + _3 + f]
        y[f] += k3 * w0 + k2 * w1 + k1 * w2 + k0 * w3
        y[_1 + f] += k4 * w0 + k3 * w1 + k2 * w2 + k1 * w3
        y[_2 + f] += k5 * w0 + k4 * w1 + k3 * w2 + k2 * w3
        y[_3 + f] += k6 * w0 + k5 * w1 + k4 * w2 + k3 * w3


@numba.njit(cache=True, fastmath={"contract"})
def _multiply_add(y, kernel, x):
    for f in range(len(y)):
        y[f] += kernel[f] * x[f]


@numba.njit(cache=True)
def _solve_leaf(w, slot, occupied, near, rows, r, mask, d, row, step, weight):
    """Solve the rows of a leaf: w[:, slot + j] is turned from what earlier leaves add to row j into row j."""
    chunks, slots, width = w.shape
    nx, lags = r.shape[1], near.shape[1]
    flat, flat_near = w.reshape(-1), near.reshape(-1)
    y = np.empty(_TILE * width, w.dtype)
    column = 0 if step > 0 else nx - 1
    for t in range(0, len(occupied), _TILE):
        tile = occupied[t : t + _TILE]
        if not tile.any():
            w[:, slot + t : slot + t + len(tile)] = 0
            continue
        for c in range(chunks):
            here = (c * slots + slot) * width
            target = flat[here + t * width : here + (t + len(tile)) * width]
            y[: len(target)] = target
            for s in range(0, t, _TILE):
                if occupied[s : s + _TILE].any():
                    lag = c * lags + t - s - 3
                    _tile(y, flat, uintp(here + s * width), flat_near, uintp(lag * width), width)
            target[:] = y[: len(target)]
        for q in range(len(tile)):
            if not tile[q]:
                w[:, slot + t + q] = 0
                continue
            for c in range(chunks):
                part = rows.spectrum[c * width : (c + 1) * width]
                part[:] = w[c, slot + t + q, : len(part)]
            for p in range(q):
                if tile[p]:
                    _multiply_add(rows.spectrum, rows.close[q - p], rows.recent[p])
            _execute(rows.execute, rows.backward)
            i = row + step * (t + q)
            count = 0
            for k in range(nx):
                rows.contact[count] = k
                count += mask[i, column + step * k]
            for k in range(nx):
                rows.cells[k] += r[i, column + step * k]
            _solve_row(rows, count, weight)
            for k in range(nx):
                d[i, column + step * k] = rows.solved[k]
            _execute(rows.execute, rows.forward)
            rows.recent[q] = rows.spectrum
            for c in range(chunks):
                part = rows.spectrum[c * width : (c + 1) * width]
                w[c, slot + t + q, : len(part)] = part


@numba.njit(cache=True)
def _load(cells, rows):
    """cells[f, s] = rows[s, f], four rows at a time; zeros after them."""
    n, lanes = rows.shape
    whole = n - n % 4
    for s in range(0, whole, 4):
        for f in range(lanes):
            cells[f, s] = rows[s, f]
            cells[f, s + 1] = rows[s + 1, f]
            cells[f, s + 2] = rows[s + 2, f]
            cells[f, s + 3] = rows[s + 3, f]
    for s in range(whole, n):
        for f in range(lanes):
            cells[f, s] = rows[s, f]
    cells[:, n:] = 0


@numba.njit(cache=True)
def _add(rows, cells, shift):
    """rows[t, f] += cells[f, shift + t], four rows at a time."""
    n, lanes = rows.shape
    whole = n - n % 4
    for t in range(0, whole, 4):
        for f in range(lanes):
            rows[t, f] += cells[f, shift + t]
            rows[t + 1, f] += cells[f, shift + t + 1]
            rows[t + 2, f] += cells[f, shift + t + 2]
            rows[t + 3, f] += cells[f, shift + t + 3]
    for t in range(whole, n):
        for f in range(lanes):
            rows[t, f] += cells[f, shift + t]


@numba.njit(cache=True)
def _transfer(
    w, source, n_source, target, n_target, untouched, far, execute, forward, backward, cells, spectrum
):
    """Add the effect of the rows w[:, source : source + n_source] on the next n_target rows, at w[:, target]."""
    chunks, _, lanes = w.shape
    batch, length = cells.shape
    half = far.shape[2]
    for c in range(chunks):
        for lane in range(0, lanes, batch):
            _load(cells, w[c, source : source + n_source, lane : lane + batch])
            _execute(execute, forward)
            for f in range(batch):
                z, kernel = spectrum[f], far[c, lane + f]
                for k in range(half):
                    z[k] *= kernel[k]
                for k in range(half, length):
                    z[k] *= kernel[length - k].conjugate()
            _execute(execute, backward)
            rows = w[c, target : target + n_target, lane : lane + batch]
            if untouched:
                rows[:] = 0
            _add(rows, cells, n_source)


@numba.njit(cache=True)
def _count(mask):
    """Contact cells of each row."""
    counts = np.empty(len(mask), np.int64)
    for j, row in enumerate(mask):
        count = 0
        for cell in row:
            count += cell
        counts[j] = count
    return counts


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
        chunks = -(-self._frequencies // _LANES)
        size, rank = (1, 0) if self.comm is None else (comm.size, comm.rank)
        edges = [chunks * q // size for q in range(size + 1)]
        self._chunks = [b - a for a, b in itertools.pairwise(edges)]  # of each rank

        self._fftw = _FFTW(self.dtype)
        first_rows = quadrant_rows(0, min(ny, leaf_rows + _TILE))
        self._diagonal = float(first_rows[0, 0])
        self._rows = self._prepare_rows(first_rows)
        near = np.zeros((leaf_rows + _TILE, chunks * _LANES))
        near[: len(first_rows), : self._frequencies] = self._transform_in_x(first_rows)
        near = near.reshape(-1, chunks, _LANES).transpose(1, 0, 2)
        self._near = np.repeat(near, 2, axis=2).astype(self.dtype, order="C")  # for Re and Im

        half = _largest_power(len(leaves))
        self._stored = np.zeros((self._chunks[rank], half * leaf_rows, _LANES), self._complex)
        self._leaf = None if self.comm is None else np.empty(chunks * leaf_rows * _LANES, self._complex)
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
        close = np.repeat(self._transform_in_x(kernel[:_TILE]), 2, axis=1).astype(self.dtype)

        levels = 0
        while nx > SEGMENT_COLUMNS << levels:
            levels += 1
        segment = -(-nx // (1 << levels))
        lengths = [transform_length(segment << level) for level in range(levels)]
        work, work_spectrum = self._with_spectrum(max(lengths, default=2))
        plans = [self._fftw.plans(work[None], work_spectrum[None], length) for length in lengths]
        far = [rfft(kernel[0, :length], length) / length for length in lengths]
        within = kernel[0].astype(self.dtype)
        return _Rows(
            execute=self._fftw.execute,
            forward=forward,
            backward=backward,
            cells=cells,
            solved=solved,
            spectrum=real,
            recent=np.zeros((_TILE, len(real)), self.dtype),
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
            (2, max(min(_BATCH, _LANES * lengths[-1]), lengths[-1])), dtype=self._complex
        )
        self._work[...] = 0
        for length in lengths:
            far = np.empty((len(kernel), _LANES, length // 2 + 1), self._complex)
            for chunk, part in zip(far, kernel, strict=True):
                chunk[...] = rfft(part[:, :length], length) / length
            batch = _LANES
            while batch * length > self._work.shape[1]:
                batch //= 2
            cells, spectrum = (work[: batch * length].reshape(batch, length) for work in self._work)
            plans = self._fftw.plans(cells, spectrum, length)
            self._transfers.append((far, self._fftw.execute, *plans, cells, spectrum))

    def _kernel_in_x(self, quadrant_rows, edges, rank):
        """x-transforms of all rows of K at this rank's frequencies, shape (chunks, _LANES, ny)."""
        ny, size = self.shape[0], len(self._chunks)
        lags = [ny * q // size for q in range(size + 1)]
        here = np.zeros((edges[-1] * _LANES, lags[rank + 1] - lags[rank]))
        for start in range(lags[rank], lags[rank + 1], _ROWS_AT_ONCE):
            stop = min(start + _ROWS_AT_ONCE, lags[rank + 1])
            rows = self._transform_in_x(quadrant_rows(start, stop))
            here[: self._frequencies, start - lags[rank] : stop - lags[rank]] = rows.T
        if self.comm is None:
            return here.reshape(self._chunks[rank], _LANES, ny)
        lanes = self._chunks[rank] * _LANES
        counts = np.diff(lags)
        received = np.empty(lanes * ny)
        sent = [chunks * _LANES * counts[rank] for chunks in self._chunks]
        self.comm.Alltoallv([here, sent], [received, list(lanes * counts)])
        kernel = np.empty((lanes, ny))
        for first, last in itertools.pairwise(lags):
            kernel[:, first:last] = received[lanes * first : lanes * last].reshape(lanes, last - first)
        return kernel.reshape(self._chunks[rank], _LANES, ny)

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
        counts = _count(mask)
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
        _solve_leaf(block, slot, occupied, self._near, self._rows, r, mask, d, row, step, weight)

    def _transfer(self, source, target, untouched, level):
        """Add the effect of the rows stored at `source` to those at `target`, which come right after them."""
        sizes = source.start, source.stop - source.start, target.start, target.stop - target.start
        _transfer(self._stored, *sizes, untouched, *self._transfers[level])
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
        shape = sum(self._chunks), part.shape[1], _LANES
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
def load():
    """Load the compiled loops now, not in the first sweep. Not collective."""
    rows, columns = 64, 4
    kernel = 1.0 / (1.0 + np.arange(rows)[:, None] + np.arange(columns))
    smoother = GaussSeidel(lambda first, last: kernel[first:last], (rows, columns))
    ones = np.ones((rows, columns))
    for backward in (False, True):
        smoother.sweep(ones, ones > 0, 1.0, np.empty_like(ones), backward)
