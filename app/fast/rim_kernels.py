"""Compiled loops of the rim extension: lists of cells, and sweeps over them."""

from __future__ import annotations

import numpy as np

from app.compiled import njit

# In the lists ~j stands for cell j if a neighbour may lie in another row array or outside the patch.


@njit()
def _above_or_below(before, here, after, near):
    for i in range(np.uint64(near.size)):
        near[i] = before[i] | here[i] | after[i]
        before[i] = here[i]


@njit()
def _left_or_right(near, marked, counts):
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(counts.size)):
        marked[i + one] = near[i] | near[i + one] | near[i + two]
        counts[i] += marked[i + one]


@njit()
def _left_or_right_of(near, marked, of, counts):
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(counts.size)):
        marked[i + one] = near[i] | near[i + one] | near[i + two]
        counts[i] += marked[i + one] & of[i]


@njit()
def dilate(marked, of, counts):
    """Mark what is beside a marked cell, too; count how often each of the cells `of` (None: of all) was marked."""
    before, near = marked[0].copy(), np.empty_like(marked[0])
    for row in range(counts.shape[0]):
        _above_or_below(before, marked[row + 1], marked[row + 2], near)
        if of is None:
            _left_or_right(near, marked[row + 1], counts[row])
        else:
            _left_or_right_of(near, marked[row + 1], of[row], counts[row])


@njit()
def _special(kinds, deep, found):
    for i in range(kinds.size):
        found[i] = (kinds[i] != 0) & (kinds[i] != deep)


@njit()
def list_cells(kinds, deep, cells, counts):
    """List the cells of all kinds but 0 and `deep` in order, count those of each kind; return how many there are."""
    total = 0
    nx = kinds.shape[1]
    found = np.zeros(-(-nx // 8) * 8, np.uint8)
    words = found.view(np.uint64)
    some, columns = np.empty(words.size + 1, np.int64), np.empty(found.size + 1, np.int64)
    for row in range(kinds.shape[0]):
        _special(kinds[row], deep, found)
        # Without branches: none could be predicted.
        hits = 0
        for word in range(words.size):
            some[hits] = word
            hits += words[word] != 0
        number = 0
        for hit in range(hits):
            for i in range(8 * some[hit], 8 * some[hit] + 8):
                columns[number] = i
                number += found[i]
        first, outer = row * nx, row == 0 or row == kinds.shape[0] - 1
        for m in range(number):
            i = columns[m]
            counts[kinds[row, i]] += 1
            cells[total] = ~(first + i) if outer or i == 0 or i == nx - 1 else first + i
            total += 1
    return total


@njit()
def sort_cells(kinds, cells, out, places):
    """Sort listed cells by their kinds; places[kind] says where the first of a kind goes, and is changed."""
    for m in range(cells.size):
        kind = kinds[max(cells[m], ~cells[m])]
        out[places[kind]] = cells[m]
        places[kind] += 1


@njit()
def take_and_scale(x, cells, factor, values):
    """values = x on the cells, and factor x there afterwards."""
    for m in range(cells.size):
        j = max(cells[m], ~cells[m])
        values[m] = x[j]
        x[j] *= factor


@njit()
def take_out(x, cells, values):
    """values = x on the cells, and zero there afterwards."""
    for m in range(cells.size):
        j = max(cells[m], ~cells[m])
        values[m] = x[j]
        x[j] = 0


@njit()
def put(x, cells, values):
    """x = values on the cells."""
    for m in range(cells.size):
        x[max(cells[m], ~cells[m])] = values[m]


@njit()
def sweep(x, above, below, periodic, cells, source, weights, step, new):
    """x += step (source - N x - x) on the listed cells, all from the old values, by way of `new`.

    An empty source is zero.
    """
    wx, wy, wd = weights
    nx, some = np.int64(above.size), source.size > 0
    for m in range(cells.size):
        j = np.int64(cells[m])
        if j >= 0:
            a, b = j - nx, j + nx
            in_x, in_y = x[j - 1] + x[j + 1], x[a] + x[b]
            diagonal = (x[a - 1] + x[a + 1]) + (x[b - 1] + x[b + 1])
        else:
            row, i = ~j // nx, ~j % nx
            left, right = i - 1, i + 1
            if periodic:
                left, right = left % nx, right % nx
            in_x = _value(x, above, below, row, left) + _value(x, above, below, row, right)
            in_y = _value(x, above, below, row - 1, i) + _value(x, above, below, row + 1, i)
            diagonal = (_value(x, above, below, row - 1, left) + _value(x, above, below, row - 1, right)) + (
                _value(x, above, below, row + 1, left) + _value(x, above, below, row + 1, right)
            )
        here = x[max(j, ~j)]
        wanted = (source[m] if some else x.dtype.type(0)) - (wx * in_x + wy * in_y + wd * diagonal)
        new[m] = here + step * (wanted - here)
    for m in range(cells.size):
        x[max(cells[m], ~cells[m])] = new[m]


@njit()
def _value(x, above, below, row, i):
    """x in row `row` and column `i`, of which one may be just outside this rank's rows or the patch."""
    nx = above.size
    if i < 0 or i >= nx:
        return x.dtype.type(0)
    if row < 0:
        return above[i]
    if row * nx >= x.size:
        return below[i]
    return x[row * nx + i]


@njit()
def extend(x, wrapped, periodic, band, sizes, weights, steps, new):
    """All steps of E."""
    above, below = np.zeros(x.shape[1], x.dtype), np.zeros(x.shape[1], x.dtype)
    for i, size in enumerate(sizes):
        if wrapped:
            above[:], below[:] = x[-1], x[0]
        sweep(x.reshape(-1), above, below, periodic, band[:size], new[:0], weights, steps[i], new)


@njit()
def restrict(x, wrapped, periodic, band, sizes, inner, rim, weights, steps, kept, source, new):
    """As `extend`, for E^T."""
    flat, above, below = x.reshape(-1), np.zeros(x.shape[1], x.dtype), np.zeros(x.shape[1], x.dtype)
    take_out(flat, inner, kept)
    take_and_scale(flat, band, steps[0], source)
    for i in range(1, sizes.size + 1):
        if wrapped:
            above[:], below[:] = x[-1], x[0]
        last = i == sizes.size
        cells, of = (inner[:rim], kept) if last else (band[: sizes[sizes.size - 1 - i]], source)
        sweep(flat, above, below, periodic, cells, of, weights, 1.0 if last else steps[i], new)
    put(flat, inner[rim:], kept[rim:])
