"""Compiled loops of a Gauss-Seidel sweep: single rows, the rows of a leaf, transfers between leaves.

What leaves and transfers are is said in `app.halfspace.sweeps.gauss_seidel`. Frequencies are stored in chunks of
`LANES`, so that a loop over the lanes of a chunk becomes vector instructions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import uintp

from app.compiled import njit
from app.halfspace.fft.fftw import execute

LANES = 32  # frequencies in a chunk
TILE = 4  # rows that act on as many others at once
_WIDTH = 2 * LANES  # of a chunk, as reals
_1, _2, _3, _4, _5, _6 = (np.uintp(i * _WIDTH) for i in range(1, 7))  # offsets of the rows of a tile


class Rows(NamedTuple):
    """What the solution of single rows needs, for compiled code."""

    execute: int  # address of FFTW's execute
    forward: int  # plan solved -> spectrum
    backward: int  # plan spectrum -> cells
    cells: np.ndarray  # (Nx,), right-hand side of a row
    solved: np.ndarray  # (Nx,), d of the row: zero outside C
    spectrum: np.ndarray  # (2 F,), transform of either, as reals
    recent: np.ndarray  # (TILE, 2 F), transforms of the last solved rows
    close: np.ndarray  # (TILE, 2 F), kernel at the smallest lags
    contact: np.ndarray  # (nx,), columns of the contact cells of a row
    kernel: np.ndarray  # (nx,), coupling within a row
    reverse: np.ndarray  # (nx,), the same backwards
    segment: int  # columns of a segment
    far: np.ndarray  # spectra of the kernel, level after level
    starts: np.ndarray  # (levels + 1,), where they start
    plans: np.ndarray  # (levels, 2), forward and backward, both on `work`
    work: np.ndarray  # (longest + 2,)
    work_spectrum: np.ndarray  # (longest / 2 + 1,), the same memory


@njit(fastmath={"contract", "reassoc", "nsz"})
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


@njit()
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
        execute(rows.execute, rows.plans[level, 0])
        for k in range(b - a):
            rows.work_spectrum[k] *= rows.far[a + k]
        execute(rows.execute, rows.plans[level, 1])
        for i in range(stop, min(stop + size, end)):
            x[i] -= rows.work[size + i - stop]


@njit(fastmath={"contract"})
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


@njit(fastmath={"contract"})
def _multiply_add(y, kernel, x):
    for f in range(len(y)):
        y[f] += kernel[f] * x[f]


@njit()
def solve_leaf(w, slot, occupied, near, rows, r, mask, d, row, step, weight):
    """Solve the rows of a leaf: w[:, slot + j] is turned from what earlier leaves add to row j into row j."""
    chunks, slots, width = w.shape
    nx, lags = r.shape[1], near.shape[1]
    flat, flat_near = w.reshape(-1), near.reshape(-1)
    y = np.empty(TILE * width, w.dtype)
    column = 0 if step > 0 else nx - 1
    for t in range(0, len(occupied), TILE):
        tile = occupied[t : t + TILE]
        if not tile.any():
            w[:, slot + t : slot + t + len(tile)] = 0
            continue
        for c in range(chunks):
            here = (c * slots + slot) * width
            target = flat[here + t * width : here + (t + len(tile)) * width]
            y[: len(target)] = target
            for s in range(0, t, TILE):
                if occupied[s : s + TILE].any():
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
            execute(rows.execute, rows.backward)
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
            execute(rows.execute, rows.forward)
            rows.recent[q] = rows.spectrum
            for c in range(chunks):
                part = rows.spectrum[c * width : (c + 1) * width]
                w[c, slot + t + q, : len(part)] = part


@njit()
def _fill(cells, rows):
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


@njit()
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


@njit()
def transfer(w, source, n_source, target, n_target, untouched, far, fftw, forward, backward, cells, spectrum):
    """Add the effect of the rows w[:, source : source + n_source] on the next n_target rows, at w[:, target]."""
    chunks, _, lanes = w.shape
    batch, length = cells.shape
    half = far.shape[2]
    for c in range(chunks):
        for lane in range(0, lanes, batch):
            _fill(cells, w[c, source : source + n_source, lane : lane + batch])
            execute(fftw, forward)
            for f in range(batch):
                z, kernel = spectrum[f], far[c, lane + f]
                for k in range(half):
                    z[k] *= kernel[k]
                for k in range(half, length):
                    z[k] *= kernel[length - k].conjugate()
            execute(fftw, backward)
            rows = w[c, target : target + n_target, lane : lane + batch]
            if untouched:
                rows[:] = 0
            _add(rows, cells, n_source)


@njit()
def count_contact(mask):
    """Contact cells of each row."""
    counts = np.empty(len(mask), np.int64)
    for j, row in enumerate(mask):
        count = 0
        for cell in row:
            count += cell
        counts[j] = count
    return counts
