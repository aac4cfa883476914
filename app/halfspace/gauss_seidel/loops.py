"""Compiled loops of a Gauss-Seidel sweep.

A leaf is a block of rows, a transfer the effect of leaves on later leaves; see
`app.halfspace.gauss_seidel.gauss_seidel`. Frequencies are stored in chunks of `LANES`, for vectorised loops.
"""

from typing import NamedTuple

import numpy as np
from numba import uintp

from app.base.numba_cache import njit
from app.halfspace.fft.fftw import execute
from app.parallel.reductions import add_row, copy_row, nonzero_span, sum_row

LANES = 32  # frequencies in a chunk
TILE = 4  # rows that act on as many others in one loop
MIN_RUN = 160  # cells of a row from which transforms are faster than scalar products
_WIDTH = 2 * LANES  # real numbers in a chunk
_1, _2, _3, _4, _5, _6 = (np.uintp(i * _WIDTH) for i in range(1, 7))  # offsets of the rows of a tile


class RowSolver(NamedTuple):
    """Kernels, FFT plans and work arrays of compiled code for single rows."""

    execute: int  # address of FFTW's execute
    plans: np.ndarray  # (TILE, 2), transforms of `solved` to a row of `tile`, and of that row to `cells`
    cells: np.ndarray  # (Nx,), right-hand side of a row
    solved: np.ndarray  # (Nx,), d of the row: zero outside C
    tile: np.ndarray  # (TILE, chunks * 2 LANES), transforms of `cells` or `solved`, as reals
    close: np.ndarray  # (TILE, chunks * 2 LANES), transformed kernel at lags 0 to TILE - 1
    contact: np.ndarray  # (nx,), columns of the contact cells of a row
    kernel: np.ndarray  # (nx,), coupling within a row
    reverse: np.ndarray  # (nx,), `kernel` backwards
    segment: int  # columns of a segment
    levels: int  # number of levels of transfers between segments
    lengths: np.ndarray  # lengths of transforms: those of the levels, then those of whole runs, ascending
    starts: np.ndarray  # offsets of the spectra for these lengths
    spectra: np.ndarray  # spectra of the kernel, then of the inverse of the triangle
    part_plans: np.ndarray  # (lengths, 2), forward and backward, both on `work`
    work: np.ndarray  # (longest + 2,)
    work_spectrum: np.ndarray  # (longest / 2 + 1,), the memory of `work`
    added: np.ndarray  # (TILE * 2 LANES,), sums for a tile in a chunk


@njit(fastmath={"contract", "reassoc", "nsz"})
def _four_dots(d, start, stop, kernel, k0, k1, k2, k3):
    """Return sums of d[i] kernel[k + i] over i, for four offsets k."""
    s0 = s1 = s2 = s3 = 0 * d[0]
    for index in range(start, stop):
        i = uintp(index)
        x = d[i]
        s0 += x * kernel[k0 + i]
        s1 += x * kernel[k1 + i]
        s2 += x * kernel[k2 + i]
        s3 += x * kernel[k3 + i]
    return s0, s1, s2, s3


@njit(fastmath={"contract"})
def _convolve(rows, number):
    """Convolve ``rows.work`` in place with the stored kernel `number`."""
    start = uintp(rows.starts[number])
    execute(rows.execute, rows.part_plans[number, 0])
    for k in range(uintp(rows.lengths[number] // 2 + 1)):
        rows.work_spectrum[k] *= rows.spectra[start + k]
    execute(rows.execute, rows.part_plans[number, 1])


@njit()
def _solve_run(rows, first, count):
    """Solve a row without holes by one convolution.

    The contact cells are the `count` cells from `first` on. Return False, without a solution, if `solve_row` is faster.
    """
    number = rows.levels
    while number < len(rows.lengths) and rows.lengths[number] < 2 * count:
        number += 1
    if count < MIN_RUN or number == len(rows.lengths):
        return False
    copy_row(rows.cells[first : first + count], rows.work[:count])
    rows.work[count : rows.lengths[number]] = 0
    _convolve(rows, number)
    copy_row(rows.work[:count], rows.solved[first : first + count])
    return True


@njit()
def solve_row(rows, count, weight):
    """Solve d + weight L_C d = weight x in a row.

    x is ``rows.cells``, the solution d is ``rows.solved``. The matrix L_C couples each of the `count` contact cells to
    the contact cells before it. The weight is omega divided by the diagonal of A.
    """
    x, d, contact, kernel, reverse = rows.cells, rows.solved, rows.contact, rows.kernel, rows.reverse
    last = len(kernel) - 1
    first, end = contact[0], contact[count - 1] + 1
    d[:] = 0
    if end - first == count and _solve_run(rows, first, count):
        return
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
            # With fewer than four cells the last one replaces the missing ones, without effect.
            t0, t1 = contact[done], contact[done + min(1, more - 1)]
            t2, t3 = contact[done + min(2, more - 1)], contact[done + more - 1]
            k0, k1, k2, k3 = uintp(last - t0), uintp(last - t1), uintp(last - t2), uintp(last - t3)
            s0, s1, s2, s3 = _four_dots(d, start, t0, reverse, k0, k1, k2, k3)
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
        copy_row(d[stop - size : stop], rows.work[:size])
        rows.work[size : rows.lengths[level]] = 0
        _convolve(rows, level)
        for i in range(stop, min(stop + size, end)):
            x[i] -= rows.work[size + i - stop]


@njit(fastmath={"contract"})
def _tile(y, w, b, kernel, k, width):
    """Add the effect of four solved rows on four later rows."""
    # y[t] += sum_s kernel[k + t - s + 3] w[b + s]
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
def _add_tiles(y, flat, source, near, start, reach, filled, place, least, most):
    """Add the effect of earlier tiles on a tile to `y`.

    A tile is a group of TILE rows. The lag of an earlier tile is its distance from this tile in rows. The sum is over
    the tiles with contact at lags from `least` to `most`, within the `reach` of these frequencies.

    - `flat` has the rows of all tiles; `source` is the index at which this tile begins.
    - `near` has the kernel for all lags; `start` is the index of lag 0.
    - `filled` marks the tiles with contact; `place` is the index of this tile.
    """
    for lag in range(least, most + 1, TILE):
        if lag - TILE >= reach:
            return
        if filled[place - lag // TILE]:
            _tile(y, flat, uintp(source - lag * _WIDTH), near, uintp(start + (lag - 3) * _WIDTH), _WIDTH)


@njit()
def find_contact_extent(mask, occupied):
    """Mark rows with contact; return first and end column, number of cells."""
    start, stop, cells = mask.shape[1], 0, 0
    for j in range(mask.shape[0]):
        first, last = nonzero_span(mask[j])
        occupied[j] = last > 0
        if last > 0:
            start, stop = min(start, first), max(stop, last)
            cells += sum_row(mask[j, first:last])
    return start, stop, cells


@njit()
def _list_contact(contact, mask):
    count = 0
    for k in range(uintp(len(mask))):
        contact[count] = k
        count += mask[k]
    return count


@njit()
def solve_leaf(w, now, summed, near, reach, filled, rows, r, mask, d, column, weight):
    """Solve a leaf, which is a block of rows.

    Let m be the number of the leaf. On entry w[now] is the effect of the leaves up to m - 2 on the rows of leaf m. On
    return w[now] has these rows, solved and transformed in x.

    Parameters
    ----------
    w : ndarray, shape (2, chunks, rows, 2 LANES)
        This leaf, w[now], and the leaf before. In chunks of frequencies from `summed` on, the effect of the leaves up
        to m - 2 is zero; there w[now] need not be set on entry.
    near : ndarray, shape (chunks * 2 rows * 2 LANES,)
        Kernel at all lags (distances in rows) between the two leaves.
    reach : ndarray, shape (chunks,)
        Lag beyond which the kernel is negligible.
    filled : ndarray of bool, shape (2 rows / TILE,)
        True for tiles (groups of TILE rows) with contact: the tiles of the leaf before, then the tiles of this leaf.
    rows : RowSolver
        Data to solve single rows.
    r, mask, d : ndarray, shape (<= rows, >= column + nx)
        Rows of the fields from `column` on, in the order of the sweep; d is zero in rows without contact.
    """
    _, chunks, size, width = w.shape
    flat, tiles, y = w.reshape(-1), size // TILE, rows.added
    for c in range(chunks):  # effect of the leaf before on all rows
        this, before = (now * chunks + c) * size, ((1 - now) * chunks + c + 1) * size
        lags = 2 * c * size * width
        for t in range(0, size, TILE):
            if filled[tiles + t // TILE]:
                target = flat[(this + t) * width : (this + t + TILE) * width]
                if c < summed:
                    copy_row(target, y)
                else:
                    y[:] = 0
                source, place = (before + t) * width, tiles + t // TILE
                _add_tiles(y, flat, source, near, lags, reach[c], filled, place, t + TILE, t + size)
                copy_row(y, target)
    for t in range(0, size, TILE):
        if not filled[tiles + t // TILE]:
            w[now, :, t : t + TILE] = 0
            continue
        for c in range(chunks):
            source = ((now * chunks + c) * size + t) * width
            copy_row(flat[source : source + TILE * width], y)
            lags = 2 * c * size * width
            _add_tiles(y, flat, source, near, lags, reach[c], filled, tiles + t // TILE, TILE, t)
            for q in range(TILE):
                copy_row(y[q * width : (q + 1) * width], rows.tile[q, c * width : (c + 1) * width])
        part = slice(t, t + TILE), slice(column, column + len(rows.kernel))
        _solve_tile(rows, r[part], mask[part], d[part], weight)
        for c in range(chunks):
            for q in range(TILE):
                start = ((now * chunks + c) * size + t + q) * width
                copy_row(rows.tile[q, c * width : (c + 1) * width], flat[start : start + width])


@njit()
def _solve_tile(rows, r, mask, d, weight):
    """Solve a tile's rows one after the other.

    A tile is a group of TILE rows. On entry ``rows.tile`` is the effect of earlier tiles on these rows. On return it
    has these rows, solved and transformed.
    """
    solved = 0  # bits
    for q in range(TILE):
        count = _list_contact(rows.contact, mask[q]) if q < len(r) else 0
        if not count:
            rows.tile[q] = 0
            continue
        for p in range(q):
            if (solved >> p) & 1:
                _multiply_add(rows.tile[q], rows.close[q - p], rows.tile[p])
        execute(rows.execute, rows.plans[q, 1])
        add_row(rows.cells[: r.shape[1]], 1.0, r[q])
        solve_row(rows, count, weight)
        copy_row(rows.solved[: d.shape[1]], d[q])
        execute(rows.execute, rows.plans[q, 0])
        solved |= 1 << q


@njit()
def _fill(cells, start, rows):
    """Transpose rows into cells: cells[f, start + s] = rows[s, f]."""
    n, lanes = rows.shape
    for s in range(0, n, TILE):
        for f in range(lanes):
            cells[f, start + s] = rows[s, f]
            cells[f, start + s + 1] = rows[s + 1, f]
            cells[f, start + s + 2] = rows[s + 2, f]
            cells[f, start + s + 3] = rows[s + 3, f]


@njit()
def _add(rows, cells, start):
    """Add transposed cells to rows: rows[t, f] += cells[f, start + t]."""
    n, lanes = rows.shape
    for t in range(0, n, TILE):
        for f in range(lanes):
            rows[t, f] += cells[f, start + t]
            rows[t + 1, f] += cells[f, start + t + 1]
            rows[t + 2, f] += cells[f, start + t + 2]
            rows[t + 3, f] += cells[f, start + t + 3]


@njit()
def transfer(w, first, last, end, sources, targets, far, fftw, forward, backward, cells, spectrum):
    """Add the effect of solved leaves on later leaves.

    A leaf is a block of rows, a chunk a group of LANES frequencies. The `sources` leaves just before leaf `end` act on
    the `targets` leaves just after leaf `end`. Only chunks `first` to `last` - 1 are computed.

    - `w` has all leaves, shape (leaves, chunks, rows, LANES).
    - `far` has the kernel's transforms in y, for lags of one leaf or more, shape (>= last, LANES, length / 2 + 1).
    - `fftw` is the address of FFTW's ``execute``. `forward` and `backward` are the addresses of the plans between the
      work arrays `cells` and `spectrum`.
    """
    rows, lanes = w.shape[2:]
    batch, length = cells.shape
    half = far.shape[2]
    for c in range(first, last):
        for lane in range(0, lanes, batch):
            for leaf in range(sources):
                _fill(cells, leaf * rows, w[end - sources + leaf, c, :, lane : lane + batch])
            cells[:, sources * rows :] = 0
            execute(fftw, forward)
            for f in range(batch):
                z, kernel = spectrum[f], far[c, lane + f]
                for k in range(half):
                    z[k] *= kernel[k]
                for k in range(half, length):
                    z[k] *= kernel[length - k].conjugate()
            execute(fftw, backward)
            for leaf in range(targets):
                _add(w[end + 1 + leaf, c, :, lane : lane + batch], cells, (sources + leaf) * rows)
