"""Compiled FFTW loops that transform rows and convolve columns.

- *Pairs.* Two real rows a, b are transformed as one complex row a + i b, at half the cost of two real transforms by
  FFTW. An odd last row is paired with itself.
- *Strips.* A strip has 16 columns of all transformed rows, stored row by row. Strips are consecutive in one flat array;
  the last may be narrower. Reading a row (a part of each strip) and reading 16 columns (a whole strip) both access
  memory in order.
- *Columns.* The columns of a strip are copied to the rows of a small array, transformed there, and copied back.

A product calls `rows_to_strips`, `convolve_columns` and `strips_to_rows`. These call FFTW from compiled code, because
on small grids every call from Python takes a noticeable part of the time.

LLVM vectorises these loops only under three conditions. Indices are unsigned, so that they are not tested for being
negative. Complex products are written as real products, so that they are not tested for NaN. The loop over a row is a
function of its own.
"""

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.fft.fftw import execute
from app.parallel.reductions import any_nonzero

STRIP = 16  # columns
ROWS = 2 * STRIP  # transformed together: two real rows are one sequence


@njit()
def _pair_row(a, b, row):
    for k in range(a.size):
        row[k] = complex(a[k], b[k])


@njit()
def _pair_masked_row(a, b, mask_a, mask_b, row):
    for k in range(a.size):
        row[k] = complex(a[k] if mask_a[k] else 0, b[k] if mask_b[k] else 0)


@njit()
def _unpair_row(row, a, b):
    for k in range(a.size):
        a[k] = row[k].real
        b[k] = row[k].imag


@njit()
def _unpair_masked_row(row, mask_a, mask_b, a, b):
    for k in range(a.size):
        a[k] = row[k].real if mask_a[k] else 0
        b[k] = row[k].imag if mask_b[k] else 0


@njit()
def _split(both, first, a, b):
    """Split the transform of a pair of rows into two transforms.

    `both` is the transform of a complex row a + i b. The output `a` and `b` are the transforms of the rows a and b,
    from frequency `first` on.
    """
    length, start, half = np.uint64(both.size), np.uint64(first), both.real.dtype.type(0.5)
    for c in range(np.uint64(first == 0), np.uint64(a.size)):
        x, y = both[start + c], both[length - start - c]
        a[c] = complex(half * (x.real + y.real), half * (x.imag - y.imag))
        b[c] = complex(half * (x.imag + y.imag), half * (y.real - x.real))
    if first == 0 and a.size:
        x = both[0]
        a[0], b[0] = x.real, x.imag


@njit()
def _unite(both, first, a, b):
    """Combine the transforms of two rows; inverse of `_split`."""
    length, start = np.uint64(both.size), np.uint64(first)
    for c in range(np.uint64(a.size)):
        x, y = a[c], b[c]
        both[start + c] = complex(x.real - y.imag, x.imag + y.real)
    for c in range(np.uint64(first == 0), np.uint64(a.size)):
        x, y = a[c], b[c]
        both[length - start - c] = complex(x.real + y.imag, y.real - x.imag)


@njit()
def _copy_strip(source, i, target, k):
    for c in range(np.uint64(STRIP)):
        target[k + c] = source[i + c]


@njit()
def store_rows(rows, strips, height, start):
    """Copy rows to strips of `height` rows, from row `start` on."""
    whole = rows.shape[1] // STRIP * STRIP
    width = rows.shape[1] - whole
    for strip in range(0, whole, STRIP):
        at = height * strip + start * STRIP
        for j in range(rows.shape[0]):
            _copy_strip(rows[j], np.uint64(strip), strips, np.uint64(at + j * STRIP))
    for j in range(rows.shape[0]):
        at = height * whole + (start + j) * width
        for c in range(width):
            strips[at + c] = rows[j, whole + c]


@njit()
def _load_rows(rows, strips, height, start):
    """Copy rows from strips, the inverse of `store_rows`."""
    whole = rows.shape[1] // STRIP * STRIP
    width = rows.shape[1] - whole
    for strip in range(0, whole, STRIP):
        at = height * strip + start * STRIP
        for j in range(rows.shape[0]):
            _copy_strip(strips, np.uint64(at + j * STRIP), rows[j], np.uint64(strip))
    for j in range(rows.shape[0]):
        at = height * whole + (start + j) * width
        for c in range(width):
            rows[j, whole + c] = strips[at + c]


@njit()
def _store_pairs(transforms, length, first, count, active, scratch, strips, height, start):
    """Split the transforms of pairs of rows, and store them in strips.

    `count` rows are stored, from row `start` of the strips on, with the frequencies from `first` on. The strips have
    `height` rows. If `active` is false, the rows are zero.
    """
    if not height:
        return
    columns = strips.size // height
    rows = scratch[: count * columns].reshape(count, columns)
    if not active:
        rows[:] = 0
    for m in range((count + 1) // 2 if active else 0):
        _split(transforms[m, :length], first, rows[2 * m], rows[min(2 * m + 1, count - 1)])
    store_rows(rows, strips, height, start)


@njit()
def _fetch_pairs(transforms, length, first, count, scratch, strips, height, start):
    """Unite the transforms of pairs of rows from strips; the inverse of `_store_pairs`."""
    if not height:
        return
    columns = strips.size // height
    rows = scratch[: count * columns].reshape(count, columns)
    _load_rows(rows, strips, height, start)
    for m in range((count + 1) // 2):
        _unite(transforms[m, :length], first, rows[2 * m], rows[min(2 * m + 1, count - 1)])


@njit()
def _gather_row(row, columns, at):
    for c in range(np.uint64(STRIP)):
        columns[c, at] = row[c]


@njit()
def _scatter_row(columns, at, row):
    for c in range(np.uint64(STRIP)):
        row[c] = columns[c, at]


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
def _divide(column, factor, scale):
    length, half = np.uint64(column.size), np.uint64(factor.size)
    for k in range(length):
        by = scale / factor[k if k < half else length - k]
        column[k] = complex(column[k].real * by, column[k].imag * by)


@njit()
def _any_active(p, mask, rows, start, stop):
    """Return whether any row from `start` to `stop` - 1 is nonzero.

    If `rows` is given, it marks the nonzero rows. Otherwise the mask, if given, or else p is searched.
    """
    if rows.size:
        return rows[start:stop].any()
    return any_nonzero(mask[start:stop]) if mask.size else any_nonzero(p[start:stop])


@njit()
def rows_to_strips(
    p, mask, rows, length, pairs, transforms, scratch, strips, edges, fftw, forward, few_forward
):
    """Transform rows of p in x, and store strips.

    - With a `mask`, p counts as zero outside of it. Without a mask, this array has size 0.
    - `rows` marks the rows that are not zero. If they are unknown, this array has size 0.
    - `strips` receives the transforms. The frequencies are divided into a part for each rank; `edges` has the first
      frequency of each part, and the end. The strips of a part are consecutive.
    - Rows are transformed in batches, from `pairs` to `transforms`. `forward` is the FFTW plan of a whole batch. The
      last batch may have fewer rows; its plan is `few_forward`.
    """
    height = p.shape[0]
    for start in range(0, height, ROWS):
        stop = min(start + ROWS, height)
        active = _any_active(p, mask, rows, start, stop)
        if active:
            for m in range((stop - start + 1) // 2):
                j = start + 2 * m
                l = min(j + 1, stop - 1)
                if mask.size:
                    _pair_masked_row(p[j], p[l], mask[j], mask[l], pairs[m])
                else:
                    _pair_row(p[j], p[l], pairs[m])
                pairs[m, p.shape[1] :] = 0
            execute(fftw, forward if stop - start == ROWS else few_forward)
        for k in range(edges.size - 1):
            part = strips[height * edges[k] : height * edges[k + 1]]
            _store_pairs(transforms, length, edges[k], stop - start, active, scratch, part, height, start)


@njit()
def strips_to_rows(
    out, mask, rows, length, pairs, transforms, scratch, strips, edges, fftw, backward, few_backward
):
    """Transform strips back into the rows of `out`.

    The arguments are as in `rows_to_strips`. `out` is zero outside the mask. If `rows` is given, only the rows that it
    marks are computed.
    """
    height = out.shape[0]
    for start in range(0, height, ROWS):
        stop = min(start + ROWS, height)
        if rows.size and not rows[start:stop].any():
            continue
        if mask.size and not any_nonzero(mask[start:stop]):
            out[start:stop] = 0
            continue
        for k in range(edges.size - 1):
            part = strips[height * edges[k] : height * edges[k + 1]]
            _fetch_pairs(transforms, length, edges[k], stop - start, scratch, part, height, start)
        execute(fftw, backward if stop - start == ROWS else few_backward)
        for m in range((stop - start + 1) // 2):
            j = start + 2 * m
            l = min(j + 1, stop - 1)
            if mask.size:
                _unpair_masked_row(pairs[m], mask[j], mask[l], out[j], out[l])
            else:
                _unpair_row(pairs[m], out[j], out[l])


@njit()
def _gather_columns(strip, columns, start):
    """Copy a strip to `columns`, from entry `start` of each column on."""
    for r in range(strip.shape[0]):
        if strip.shape[1] == STRIP:
            _gather_row(strip[r], columns, np.uint64(start + r))
        else:
            for c in range(strip.shape[1]):
                columns[c, start + r] = strip[r, c]


@njit()
def _scatter_columns(columns, start, strip):
    """Copy columns to a strip, the inverse of `_gather_columns`."""
    for r in range(strip.shape[0]):
        if strip.shape[1] == STRIP:
            _scatter_row(columns, np.uint64(start + r), strip[r])
        else:
            for c in range(strip.shape[1]):
                strip[r, c] = columns[c, start + r]


@njit()
def convolve_columns(
    own, received, places, heights, rank, length, columns, transforms, parts, spectrum, scale,
    fftw, forward, backward, few_forward, few_backward,
):  # fmt: skip
    """Convolve columns in y, strip by strip; overwrite `own` and `received`.

    Parameters
    ----------
    own : ndarray of complex
        Strips of the rows of this rank.
    received : ndarray of complex
        Strips of the rows of the other ranks; the strips of rank q begin at ``places[q]``.
    heights : ndarray of int, shape (ranks,)
        Number of rows of each rank.
    columns, transforms, parts : ndarray
        Work arrays: a strip of columns, padded to the period `length`; the transforms of these columns; and a view of
        the transforms as real numbers.
    spectrum : ndarray, shape (columns, half a period and one)
        Factors of the transforms. If `scale` is not 0, transforms are divided by the factors and multiplied by `scale`.
    fftw : int
        Address of FFTW's ``execute``.
    forward, backward, few_forward, few_backward : int
        Addresses of the plans of a whole strip, and of the last strip, which may have fewer columns.
    """
    count = spectrum.shape[0]
    for first in range(0, count, STRIP):
        last = min(first + STRIP, count)
        ny = 0
        for q in range(heights.size):
            height = heights[q]
            strips = own if q == rank else received[places[q] : places[q] + height * count]
            strip = strips[height * first : height * last].reshape(height, last - first)
            _gather_columns(strip, columns, ny)
            ny += height
        columns[: last - first, ny:] = 0
        execute(fftw, forward if last - first == STRIP else few_forward)
        for c in range(last - first):
            if scale:
                _divide(transforms[c, :length], spectrum[first + c], scale)
            else:
                _scale_first_half(parts[c], spectrum[first + c])
                _scale_second_half(parts[c, : 2 * length], spectrum[first + c])
        execute(fftw, backward if last - first == STRIP else few_backward)
        start = 0
        for q in range(heights.size):
            height = heights[q]
            strips = own if q == rank else received[places[q] : places[q] + height * count]
            strip = strips[height * first : height * last].reshape(height, last - first)
            _scatter_columns(columns, start, strip)
            start += height
