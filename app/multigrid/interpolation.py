"""From the cells of a coarser grid to those of a finer one: bilinear, or over a period by quintics; compiled.

Values are taken to be those in the centres of cells. Bilinear interpolation is the paper's (Sec. 4.3, 2). Quintics in x
and y through six cells each leave an error of sixth order, for the same time: memory decides.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.chebyshev import lagrange_weights
from app.parallel.reductions import mix_rows, njit_reassoc, wrap_ends

_POINTS = 6  # cells that a quintic goes through: loops are written out for them
BESIDE = _POINTS // 2  # coarse cells on either side of a fine one, for which there must be room


@njit()
def _inner_children(row, fine):
    """Both children of all cells of a row but the first and the last."""
    for i in range(1, row.size - 1):
        fine[2 * i] = 0.75 * row[i] + 0.25 * row[i - 1]
        fine[2 * i + 1] = 0.75 * row[i] + 0.25 * row[i + 1]


@njit()
def bilinear(coarse, fine, a, b, weight_y, c, d, weight_x, halved, row):
    """fine[j, i] from the four coarse cells in rows a, b and columns c, d; `halved`: two columns in each coarse one.

    `row`: room for one.
    """
    first, last = (2, 2 * row.size - 2) if halved and row.size > 2 else (0, 0)
    for j in range(fine.shape[0]):
        mix_rows(coarse[a[j]], weight_y[j], coarse[b[j]], row)
        if last:
            _inner_children(row, fine[j])
        for i in range(first):
            fine[j, i] = weight_x[i] * row[c[i]] + (1 - weight_x[i]) * row[d[i]]
        for i in range(last, fine.shape[1]):
            fine[j, i] = weight_x[i] * row[c[i]] + (1 - weight_x[i]) * row[d[i]]


@njit_reassoc
def _mix_six(a, b, c, d, e, f, weights, out):
    wa, wb, wc, wd, we, wf = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for i in range(out.size):
        out[i] = (wa * a[i] + wb * b[i]) + (wc * c[i] + wd * d[i]) + (we * e[i] + wf * f[i])


@njit_reassoc
def _halved_by_quintics(row, weights, fine):
    """Both children of all cells; `weights`: of the first ones. The others' are the same in the other order."""
    wa, wb, wc, wd, we, wf = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for i in range(np.uint64(fine.size // 2)):
        a, b, c, d = row[i], row[i + one], row[i + two], row[i + three]
        e, f, g, k = row[i + two + two], row[i + two + three], row[i + three + three], two * i
        fine[k] = (wa * a + wb * b) + (wc * c + wd * d) + (we * e + wf * f)
        fine[k + one] = (wf * b + we * c) + (wd * d + wc * e) + (wb * f + wa * g)


@njit()
def quintics(coarse, fine, rows, weights_y, columns, weights_x, halved, row):
    """fine[j, i] from six rows of coarse cells, from ``rows[j]`` on, and six columns, from ``columns[i]`` on.

    Parameters
    ----------
    coarse : ndarray, shape (coarse rows, coarse columns)
    fine : ndarray, shape (rows, columns)
    rows, columns : ndarray of int, shapes (rows,), (columns,)
        Columns are counted from `BESIDE` before the first one, and over a period.
    weights_y, weights_x : ndarray, shapes (rows, 6), (columns, 6)
    halved : bool
        Two columns in each coarse one.
    row : ndarray, shape (coarse columns + 2 BESIDE,)
        Room for one.
    """
    nx = coarse.shape[1]
    for j in range(fine.shape[0]):
        k = rows[j]
        _mix_six(
            coarse[k], coarse[k + 1], coarse[k + 2], coarse[k + 3], coarse[k + 4], coarse[k + 5],
            weights_y[j], row[BESIDE : BESIDE + nx],
        )  # fmt: skip
        wrap_ends(row, nx, BESIDE)
        if halved:
            _halved_by_quintics(row, weights_x[0], fine[j])
            continue
        for i in range(fine.shape[1]):
            total = 0.0
            for m in range(_POINTS):
                total += weights_x[i, m] * row[columns[i] + m]
            fine[j, i] = total


@lru_cache(maxsize=64)
def two_around(start, stop, count, factor, place, first=None):
    """Coarse cells around some fine ones, and the weight of the first: 3/4 for the parent, 1/4 for the next one.

    At the rim the two cells are the parent and the one inside, with weights 5/4 and -1/4. Over a period they are those
    before and behind the centre, by `place` (`Grid.places_in`), and may be number -1 or `count`. They are counted from
    cell `first`; if that is None, over the period.
    """
    index = np.arange(start, stop)
    one = other = index // factor
    weight = np.ones(len(index))
    if place is not None:
        one, share = _before(index, place)
        other, weight = one + 1, 1.0 - share
    elif factor > 1 and count > 1:
        towards = np.where(index % 2, 1, -1)
        inside = (one + towards >= 0) & (one + towards < count)
        other = np.where(inside, one + towards, one - towards)
        weight = np.where(inside, 0.75, 1.25)
    return (one % count, other % count, weight) if first is None else (one - first, other - first, weight)


@lru_cache(maxsize=64)
def six_around(start, stop, place, first):
    """The first of six coarse cells around each fine one, counted from cell `first`; and their weights, (cells, 6)."""
    before, share = _before(np.arange(start, stop), place)
    return before - (BESIDE - 1) - first, lagrange_weights(share, np.arange(_POINTS) - (BESIDE - 1))


def _before(index, place):
    """The coarse cell before the centre of each fine one, and how far behind it that is."""
    centre = place[0] * index + place[1]
    before = np.floor(centre).astype(int)
    return before, centre - before
