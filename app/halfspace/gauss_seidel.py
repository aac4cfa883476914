"""Exact lexicographic Gauss-Seidel sweeps for C A C p = b, at the cost of a few FFT convolutions."""

from __future__ import annotations

import ctypes
import weakref
from typing import NamedTuple

import numba
import numpy as np
from llvmlite import ir
from mpi4py_fft import fftw
from numba import types, uintp
from numba.extending import intrinsic
from scipy.fft import dct, rfft

from app.halfspace.convolution import transform_length
from app.halfspace.grid import Slabs

LANES = 32  # x-frequencies that are handled together
_TILE = 4  # rows whose coupling is computed together
_LEAF_ROWS = 48  # rows of a leaf at most: beyond that an FFT beats row-by-row coupling
_SEGMENT = 512  # columns of a row segment at most
_BUFFER = 1 << 15  # reals per batch of transforms in y: stay in the second-level cache
_REASSOCIATE = {"contract", "reassoc", "nsz"}

_1, _2, _3, _4, _5, _6 = (np.uintp(i * LANES) for i in range(1, 7))  # offsets of rows of a tile


@intrinsic
def _execute(typingctx, function, plan):
    """Call ``void function(void *plan)``, both given as addresses."""

    def codegen(context, builder, signature, args):
        pointer = ir.IntType(8).as_pointer()
        function_type = ir.FunctionType(ir.VoidType(), [pointer])
        builder.call(
            builder.inttoptr(args[0], function_type.as_pointer()), [builder.inttoptr(args[1], pointer)]
        )
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), codegen


class _FFTW:
    """Plans of the FFTW library mpi4py_fft is linked to, as addresses that compiled code can call."""

    def __init__(self, dtype):
        module, name = {
            "float64": (fftw.fftw_xfftn, "fftw"),
            "float32": (fftw.fftwf_xfftn, "fftwf"),
        }[np.dtype(dtype).name]
        library = ctypes.CDLL(module.__file__)
        pointer, integer = ctypes.c_void_p, ctypes.c_int
        layout = [pointer, pointer, integer, integer]
        # As mpi4py_fft does before each plan: its very first call resets FFTW and would spoil earlier plans.
        getattr(library, f"{name}_plan_with_nthreads")(1)
        self._forward = getattr(library, f"{name}_plan_many_dft_r2c")
        self._backward = getattr(library, f"{name}_plan_many_dft_c2r")
        for planner in (self._forward, self._backward):
            planner.restype = pointer
            planner.argtypes = [integer, pointer, integer, *layout, *layout, ctypes.c_uint]
        self._destroy = getattr(library, f"{name}_destroy_plan")
        self._destroy.argtypes = [pointer]
        self.execute = ctypes.cast(getattr(library, f"{name}_execute"), pointer).value

    def plans(self, real, spectrum, length):
        """Forward and backward transforms of the rows of `real`, shape (rows, >= length)."""
        n = ctypes.byref(ctypes.c_int(length))
        rows = len(real)
        inside = (real.ctypes.data, None, 1, real.strides[0] // real.itemsize)
        outside = (spectrum.ctypes.data, None, 1, spectrum.strides[0] // spectrum.itemsize)
        forward = self._forward(1, n, rows, *inside, *outside, fftw.FFTW_ESTIMATE)
        backward = self._backward(1, n, rows, *outside, *inside, fftw.FFTW_ESTIMATE)
        for plan in (forward, backward):
            weakref.finalize(self, self._destroy, plan)
        return forward, backward


class _Rows(NamedTuple):
    """What the solution of single rows needs, for compiled code."""

    execute: int  # address of fftw_execute
    forward: int  # plan cells -> spectrum
    backward: int  # plan spectrum -> cells
    cells: np.ndarray  # (Nx,), a row in x, padded
    spectrum: np.ndarray  # (Nx/2+1,), its transform
    solved: np.ndarray  # (Nx,) the solved row, zero wherever there is no contact
    contact: np.ndarray  # (nx,) columns in contact
    kernel: np.ndarray  # (nx,) coupling within a row
    reverse: np.ndarray  # (nx,) the same backwards
    segment: int
    far: np.ndarray  # spectra of the kernel, level after level
    plans: np.ndarray  # (levels, 2)
    starts: np.ndarray  # (levels,) of the spectra
    work: np.ndarray  # (L+2,)
    work_spectrum: np.ndarray  # (L/2+1,) same memory


@numba.njit(cache=True, fastmath=_REASSOCIATE)
def _dots(d, start, stop, kernel, a, b, c, e):
    """Four sums over i of d[i] kernel[offset + i], start <= i < stop."""
    s0 = s1 = s2 = s3 = d[0] * 0
    for i in range(start, stop):
        j = uintp(i)
        x = d[j]
        s0 += x * kernel[a + j]
        s1 += x * kernel[b + j]
        s2 += x * kernel[c + j]
        s3 += x * kernel[e + j]
    return s0, s1, s2, s3


@numba.njit(cache=True, fastmath=_REASSOCIATE)
def _solve_row(rows, count, weight):
    """Solve (1/weight + L_C) d = x on the contact cells of a row. Return flops."""
    x, d, contact, kernel, reverse = rows.cells, rows.solved, rows.contact, rows.kernel, rows.reverse
    last = len(kernel) - 1
    first, end = contact[0], contact[count - 1] + 1
    flops = 0.0
    done = 0
    m = 0
    while True:
        start = first + m * rows.segment
        m += 1
        stop = min(start + rows.segment, end)
        while done < count and contact[done] < stop:
            more = 1
            while more < 4 and done + more < count and contact[done + more] < stop:
                more += 1
            t0 = contact[done]
            t1 = contact[done + min(1, more - 1)]
            t2 = contact[done + min(2, more - 1)]
            t3 = contact[done + more - 1]
            s0, s1, s2, s3 = _dots(
                d, start, t0, reverse, uintp(last - t0), uintp(last - t1), uintp(last - t2), uintp(last - t3)
            )
            flops += 8 * (t0 - start)
            d0 = weight * (x[t0] - s0)
            d[t0] = d0
            if more > 1:
                d1 = weight * (x[t1] - s1 - kernel[t1 - t0] * d0)
                d[t1] = d1
                if more > 2:
                    d2 = weight * (x[t2] - s2 - kernel[t2 - t0] * d0 - kernel[t2 - t1] * d1)
                    d[t2] = d2
                    if more > 3:
                        d3 = weight * (
                            x[t3] - s3 - kernel[t3 - t0] * d0 - kernel[t3 - t1] * d1 - kernel[t3 - t2] * d2
                        )
                        d[t3] = d3
            done += more
        if done == count:
            return flops
        level = 0
        while not (m >> level) & 1:
            level += 1
        size = rows.segment << level
        if contact[done] >= stop + size:
            continue
        work, spectrum = rows.work, rows.work_spectrum
        a = rows.starts[level]
        n = rows.starts[level + 1] - a
        length = 2 * (n - 1)
        work[:size] = d[stop - size : stop]
        work[size:length] = 0
        _execute(rows.execute, rows.plans[level, 0])
        for k in range(n):
            spectrum[k] *= rows.far[a + k]
        _execute(rows.execute, rows.plans[level, 1])
        for i in range(stop, min(stop + size, end)):
            x[i] -= work[size + i - stop]
        flops += 5 * length * np.log2(length) + 6 * n


@numba.njit(cache=True, fastmath={"contract"})
def _tile(y, w, b, kernel, k, lanes):
    """Effect of four rows on four others: y[t] += sum_s kernel[k + t - s + 3] w[b + s], re and im."""
    for lane in range(lanes):
        f = uintp(lane)
        k0 = kernel[k + f]
        k1 = kernel[k + _1 + f]
        k2 = kernel[k + _2 + f]
        k3 = kernel[k + _3 + f]
        k4 = kernel[k + _4 + f]
        k5 = kernel[k + _5 + f]
        k6 = kernel[k + _6 + f]
        x0 = w[b + f]
        x1 = w[b + _2 + f]
        x2 = w[b + _4 + f]
        x3 = w[b + _6 + f]
        y[f] += k3 * x0 + k2 * x1 + k1 * x2 + k0 * x3
        y[_2 + f] += k4 * x0 + k3 * x1 + k2 * x2 + k1 * x3
        y[_4 + f] += k5 * x0 + k4 * x1 + k3 * x2 + k2 * x3
        y[_6 + f] += k6 * x0 + k5 * x1 + k4 * x2 + k3 * x3
        x0 = w[b + _1 + f]
        x1 = w[b + _3 + f]
        x2 = w[b + _5 + f]
        x3 = w[b + _6 + _1 + f]
        y[_1 + f] += k3 * x0 + k2 * x1 + k1 * x2 + k0 * x3
        y[_3 + f] += k4 * x0 + k3 * x1 + k2 * x2 + k1 * x3
        y[_5 + f] += k5 * x0 + k4 * x1 + k3 * x2 + k2 * x3
        y[_6 + _1 + f] += k6 * x0 + k5 * x1 + k4 * x2 + k3 * x3


@numba.njit(cache=True)
def _solve_leaf(w, slot, occupied, near, rows, r, mask, d, row, step, weight):
    """Solve the rows of a leaf; w holds what earlier leaves add to r, then the solved rows."""
    n = len(occupied)
    chunks, slots, width = w.shape
    ny, nx = r.shape
    flat, near_flat = w.reshape(-1), near.reshape(-1)
    lags = near.shape[1]
    y = np.empty(_TILE * 2 * LANES, w.dtype)
    column = 0 if step > 0 else nx - 1
    flops = 0.0
    for t in range(0, n, _TILE):
        rest = min(_TILE, n - t)
        if occupied[t : t + rest].any() and t > 0:
            for c in range(chunks):
                y[:] = 0
                for s in range(0, t, _TILE):
                    if occupied[s : s + _TILE].any():
                        _tile(
                            y,
                            flat,
                            uintp(((c * slots) + slot + s) * width),
                            near_flat,
                            uintp((c * lags + t - s - 3) * LANES),
                            LANES,
                        )
                        flops += 64 * LANES
                for q in range(rest):
                    target = w[c, slot + t + q]
                    for f in range(width):
                        target[f] += y[q * width + f]
        for j in range(t, t + rest):
            if not occupied[j]:
                w[:, slot + j] = 0
                continue
            i = row + step * j
            for c in range(chunks):
                target = w[c, slot + j]
                for s in range(t, j):
                    if occupied[s]:
                        k = near[c, j - s]
                        source = w[c, slot + s]
                        for f in range(LANES):
                            target[f] += k[f] * source[f]
                            target[LANES + f] += k[f] * source[LANES + f]
            _interleave(w, slot + j, rows.spectrum)
            _execute(rows.execute, rows.backward)
            count = 0
            rows.solved[:] = 0
            for q in range(nx):
                if mask[i, column + step * q]:
                    rows.contact[count] = q
                    rows.cells[q] += r[i, column + step * q]
                    count += 1
            flops += _solve_row(rows, count, weight)
            for q in range(nx):
                d[i, column + step * q] = rows.solved[q]
            _execute(rows.execute, rows.forward)
            _split(w, slot + j, rows.spectrum)
    return flops


@numba.njit(cache=True)
def _interleave(w, slot, spectrum):
    for c in range(w.shape[0]):
        for f in range(min(LANES, len(spectrum) - c * LANES)):
            spectrum[c * LANES + f] = complex(w[c, slot, f], w[c, slot, LANES + f])


@numba.njit(cache=True)
def _split(w, slot, spectrum):
    for c in range(w.shape[0]):
        for f in range(min(LANES, len(spectrum) - c * LANES)):
            w[c, slot, f] = spectrum[c * LANES + f].real
            w[c, slot, LANES + f] = spectrum[c * LANES + f].imag


@numba.njit(cache=True)
def _transfer(w, source, target, sources, targets, assign, far, execute, forward, backward, real, spectrum):
    """Add the effect of solved rows on later rows; w[:, source + s] acts on w[:, target + t]."""
    chunks, _, width = w.shape
    batch = len(real)
    n = far.shape[2]
    length = 2 * (n - 1)
    ns, nt = len(sources), len(targets)
    for c in range(chunks):
        for lane in range(0, width, batch):
            for s in range(ns):
                if sources[s]:
                    for f in range(batch):
                        real[f, s] = w[c, source + s, lane + f]
                else:
                    for f in range(batch):
                        real[f, s] = 0
            real[:, ns:length] = 0
            _execute(execute, forward)
            for f in range(batch):
                k = far[c, (lane + f) % LANES]
                z = spectrum[f]
                for q in range(n):
                    z[q] *= k[q]
            _execute(execute, backward)
            for t in range(nt):
                if targets[t]:
                    if assign:
                        for f in range(batch):
                            w[c, target + t, lane + f] = real[f, ns + t]
                    else:
                        for f in range(batch):
                            w[c, target + t, lane + f] += real[f, ns + t]


class _Leaf(NamedTuple):
    start: int
    stop: int
    owner: int


class GaussSeidel:
    def __init__(self, quadrant_rows, grid_shape, slabs=None, comm=None, dtype=float):
        self.shape = ny, nx = grid_shape
        self.slabs = slabs or Slabs(ny)
        self.comm = comm if comm is not None and comm.size > 1 else None
        self.dtype = np.dtype(dtype)
        complex_type = np.result_type(self.dtype, np.complex64)
        size, rank = (1, 0) if self.comm is None else (self.comm.size, self.comm.rank)

        self._leaves, self._leaf_rows = _cut(self.slabs.starts)
        levels = (len(self._leaves) - 1).bit_length()

        nx_fft = transform_length(nx)
        frequencies = nx_fft // 2 + 1
        chunks = -(-frequencies // LANES)
        self._chunk_edges = np.arange(size + 1) * chunks // size
        mine = slice(self._chunk_edges[rank], self._chunk_edges[rank + 1])

        fft = self._fftw = _FFTW(self.dtype)
        # kernel
        near_lags = -(-self._leaf_rows // _TILE) * _TILE
        near = np.zeros((near_lags, chunks * LANES))
        rows = quadrant_rows(0, min(near_lags, ny))
        near[: len(rows), :frequencies] = _even_transform(rows, nx_fft)
        diagonal_row = rows[0].astype(self.dtype)
        self._diagonal = rows[0, 0]
        near = near.reshape(near_lags, chunks, LANES).transpose(1, 0, 2) / -nx_fft
        self._near = np.ascontiguousarray(near, self.dtype)

        my_lanes = (mine.stop - mine.start) * LANES
        self._far = []
        self._batches = []
        if levels:
            kernel = np.zeros((my_lanes, ny))
            for a in range(0, ny, 32):
                rows = _even_transform(quadrant_rows(a, min(a + 32, ny)), nx_fft)
                padded = np.zeros((len(rows), chunks * LANES))
                padded[:, :frequencies] = rows
                kernel[:, a : a + 32] = padded[:, mine.start * LANES : mine.stop * LANES].T
            for level in range(levels):
                length = transform_length(self._leaf_rows << level)
                n = length // 2 + 1
                far = np.empty((mine.stop - mine.start, LANES, n), complex_type)
                for c in range(len(far)):
                    far[c] = rfft(kernel[c * LANES : (c + 1) * LANES, :length], length) / (-nx_fft * length)
                batch = (
                    int(np.clip(1 << (_BUFFER // length).bit_length() - 1, 1, 2 * LANES))
                    if length < _BUFFER
                    else 1
                )
                spectrum = fftw.aligned((batch, n), dtype=complex_type)
                spectrum[...] = 0
                real = spectrum.view(self.dtype)
                self._far.append(far)
                self._batches.append((fft.execute, *fft.plans(real, spectrum, length), real, spectrum))

        half = 1 << (levels - 1) if levels else 1
        self._rows_stored = half * self._leaf_rows
        self._w = np.zeros((mine.stop - mine.start, self._rows_stored, 2 * LANES), self.dtype)
        self._leaf = None

        # rows
        cells = fftw.aligned(nx_fft, dtype=self.dtype)
        solved = fftw.aligned(nx_fft, dtype=self.dtype)
        spectrum = fftw.aligned(frequencies, dtype=complex_type)
        cells[:], solved[:], spectrum[:] = 0, 0, 0
        forward, _ = fft.plans(solved[None], spectrum[None], nx_fft)
        _, backward = fft.plans(cells[None], spectrum[None], nx_fft)
        row_levels = 0
        while -(-nx // (1 << row_levels)) > _SEGMENT:
            row_levels += 1
        segment = -(-nx // (1 << row_levels))
        lengths = [transform_length(segment << level) for level in range(row_levels)]
        starts = np.concatenate([[0], np.cumsum([l // 2 + 1 for l in lengths])]).astype(np.int64)
        far = np.zeros(starts[-1], complex_type)
        work = fftw.aligned(max(lengths, default=2) // 2 + 1, dtype=complex_type)
        work[:] = 0
        plans = np.zeros((row_levels, 2), np.int64)
        for level, length in enumerate(lengths):
            far[starts[level] : starts[level + 1]] = rfft(diagonal_row[:length], length) / length
            plans[level] = fft.plans(work.view(self.dtype)[None], work[None], length)
        self._rows = _Rows(
            fft.execute,
            forward,
            backward,
            cells,
            spectrum,
            solved,
            np.zeros(nx, np.int64),
            diagonal_row,
            np.ascontiguousarray(diagonal_row[::-1]),
            segment,
            far,
            plans,
            starts,
            work.view(self.dtype),
            work,
        )

    @property
    def memory(self):
        arrays = [self._near, *self._far, self._w, *(b[-1] for b in self._batches)]
        arrays += [a for a in self._rows if isinstance(a, np.ndarray)]
        return sum(a.nbytes for a in arrays)

    def sweep(self, r, mask, omega, d, backward=False):
        ny = self.shape[0]
        mask = mask.view(np.uint8)
        d[...] = 0
        occupied = mask.any(axis=1)
        leaves = self._leaves
        if backward:
            occupied = occupied[::-1].copy()
            leaves = [_Leaf(ny - l.stop, ny - l.start, l.owner) for l in reversed(leaves)]
        leaves = [l for l in leaves]
        while leaves and not occupied[leaves[0].start : leaves[0].stop].any():
            leaves.pop(0)
        while leaves and not occupied[leaves[-1].start : leaves[-1].stop].any():
            leaves.pop()
        if not leaves:
            return
        step = -1 if backward else 1
        half = 1 << (len(leaves) - 1).bit_length() - 1 if len(leaves) > 1 else 1
        first = leaves[0].start
        base = leaves[half].start if len(leaves) > half else ny

        def slot(row):
            return row - first if row < base else row - base

        self._w[:, : leaves[0].stop - first] = 0
        weight = self.dtype.type(omega / self._diagonal)
        for m, leaf in enumerate(leaves, 1):
            here = occupied[leaf.start : leaf.stop]
            if here.any():
                row = ny - 1 - leaf.start if backward else leaf.start
                _solve_leaf(
                    self._w, slot(leaf.start), here, self._near, self._rows, r, mask, d, row, step, weight
                )
            if m == len(leaves):
                break
            level = (m & -m).bit_length() - 1
            start = leaves[m - (1 << level)].start
            stop = leaves[min(m + (1 << level), len(leaves)) - 1].stop
            sources, targets = occupied[start : leaf.stop], occupied[leaf.stop : stop]
            assign = m & (m - 1) == 0
            _transfer(
                self._w,
                slot(start),
                slot(leaf.stop),
                sources,
                targets,
                assign,
                self._far[level],
                *self._batches[level],
            )


def _even_transform(rows, length):
    """Fourier transform in x of the even, zero-padded rows; real."""
    padded = np.zeros((len(rows), length // 2 + 1))
    padded[:, : rows.shape[1]] = rows
    return dct(padded, type=1, axis=1, overwrite_x=True)


def _cut(starts):
    """Cut the slabs into leaves of nearly equal size, at most a power of two of them."""
    counts = np.diff(starts)
    leaves = 1
    while leaves * _LEAF_ROWS < starts[-1] or leaves < np.count_nonzero(counts):
        leaves *= 2
    rows = -(-starts[-1] // leaves)
    while np.sum(-(-counts // rows)) > leaves:
        rows += 1
    cut = []
    for owner, (start, stop) in enumerate(zip(starts[:-1], starts[1:], strict=True)):
        parts = -(-(stop - start) // rows)
        edges = [start + (stop - start) * p // parts for p in range(parts + 1)] if parts else []
        cut += [_Leaf(a, b, owner) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return cut, rows
