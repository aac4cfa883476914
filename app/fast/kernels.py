"""Compiled loops of the rim extension: lists of cells by their distance from contact, and sweeps over these lists."""

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
def _dilate(marked, of, counts):
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
def _list(kinds, deep, cells, counts):
    """List the cells of each kind but 0 and `deep`: ``cells[kind, : counts[kind]]``."""
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
            kind = kinds[row, i]
            cells[kind, counts[kind]] = ~(first + i) if outer or i == 0 or i == nx - 1 else first + i
            counts[kind] += 1


@njit()
def _dilate_within(spread, of, kinds, around, wrapped):
    """As `_dilate`, over the sides of a periodic patch, too: in x, and in y if all rows are here."""
    if around:
        spread[:, 0], spread[:, -1] = spread[:, -2], spread[:, 1]
    if wrapped:
        spread[0], spread[-1] = spread[-2], spread[1]
    _dilate(spread, of, kinds)


@njit()
def kinds(mask, spread, steps, around, wrapped):
    """Kinds of cells, see `RimExtension.set_contact`; `spread` is room for these with the cells beside them."""
    kinds = np.empty(mask.shape, np.uint8)
    for j in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            kinds[j, i] = spread[j + 1, i + 1] = mask[j, i]
    for _ in range(steps):
        _dilate_within(spread, None, kinds, around, wrapped)
    for j in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            spread[j + 1, i + 1] = not mask[j, i]
    for _ in range(2):
        _dilate_within(spread, mask, kinds, around, wrapped)
    return kinds


@njit()
def cells(kinds, steps):
    """List the cells that take part: the fields of `_Cells`."""
    deep = steps + 1
    counts = np.zeros(deep + 3, np.int64)
    cells = np.empty((deep + 3, kinds.size + 1), np.int32)  # only the pages in use become memory
    _list(kinds, np.uint8(deep), cells, counts)
    sizes, done = np.empty(steps, np.int64), 0
    band = np.empty(counts[1:deep].sum(), np.int32)
    for layer in range(steps):
        kind = steps - layer
        band[done : done + counts[kind]] = cells[kind, : counts[kind]]
        done += counts[kind]
        sizes[layer] = done
    rim, behind = counts[deep + 2], counts[deep + 1]
    inner = np.empty(rim + behind, np.int32)
    inner[:rim], inner[rim:] = cells[deep + 2, :rim], cells[deep + 1, :behind]
    return band, sizes, inner, rim


@njit()
def some(kinds, rows):
    """Mark the rows with anything in them."""
    for j in range(rows.size):
        rows[j] = kinds[j].any()


@njit()
def extend(x, wrapped, periodic, band, sizes, weights):
    """E on rows that have no others beside them."""
    above, below = np.zeros(x.shape[1], x.dtype), np.zeros(x.shape[1], x.dtype)
    nothing = np.zeros(band.size, x.dtype)
    for size in sizes:
        if wrapped:
            above[:], below[:] = x[-1], x[0]
        sweep(x.reshape(-1), above, below, periodic, band[:size], nothing[:size], weights)


@njit()
def restrict(x, wrapped, periodic, band, sizes, inner, rim, weights):
    """E^T on rows that have no others beside them."""
    above, below = np.zeros(x.shape[1], x.dtype), np.zeros(x.shape[1], x.dtype)
    flat = x.reshape(-1)
    kept, source = take(flat, inner), take(flat, band)
    put(flat, inner, np.zeros(inner.size, x.dtype))
    for layer in range(sizes.size - 2, -2, -1):
        if wrapped:
            above[:], below[:] = x[-1], x[0]
        if layer >= 0:
            sweep(flat, above, below, periodic, band[: sizes[layer]], source, weights)
        else:
            sweep(flat, above, below, periodic, inner[:rim], kept, weights)
    put(flat, inner[rim:], kept[rim:])


@njit()
def take(x, cells):
    """Return x in the listed cells."""
    values = np.empty(cells.size, x.dtype)
    for m in range(cells.size):
        values[m] = x[max(cells[m], ~cells[m])]
    return values


@njit()
def put(x, cells, values):
    """Set x in the listed cells."""
    for m in range(cells.size):
        x[max(cells[m], ~cells[m])] = values[m]


@njit()
def sweep(x, above, below, periodic, cells, source, weights):
    """x <- source - N x on the listed cells, all from the old values."""
    wx, wy, wd = weights
    new = np.empty(cells.size, x.dtype)
    nx = np.int64(above.size)
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
        new[m] = source[m] - (wx * in_x + wy * in_y + wd * diagonal)
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
