"""A residual continued between contacts: where the steps of `app.fast.rim` begin.

These steps reach as many cells as there are of them. Where contacts are further apart, ``B E r`` can only vanish
between them if E continues r from one to the next. So the steps begin with the mean of r over the contact around: in
square blocks of cells r and the share of contact are summed, smoothed over the blocks beside, and divided,

    x_o = P D S P^T r,    D = 1 / (S c + least),    c = P^T 1 on C,

P constant on blocks, P^T means over their cells, S binomial means over 3 x 3 blocks, twice, nothing beyond the patch.
By `least` the field falls off away from all contact, as the displacement does. The transpose, of a field b,

    b_c + P S D P^T b_o,

comes after the steps of E^T. All ranks have all blocks: each sums those of its rows. Contact in a few large areas gains
nothing by it: there the steps begin with zero.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from app.compiled import njit
from app.halfspace.grid import Slabs
from app.halfspace.reductions import any_order, sum_over

_LEAST = 0.15  # share of contact around a cell, beside which less counts little
_SMOOTHED = 2  # times
_SCATTERED = 0.08  # of the blocks are in contact in part, where this gains more than it costs


class Between:
    """``P D S P^T`` and its transpose on one grid; arrays hold this rank's rows. In single precision.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the grid.
    slabs : Slabs or None
        Distribution of the rows; None: all are here.
    comm : mpi4py communicator or None
        Ranks that share the grid.
    cells : int
        Of a block, in either direction.
    """

    def __init__(self, shape, slabs, comm, cells):
        slabs = slabs or Slabs(shape[0])
        self._comm, self._cells, self._first = comm, cells, slabs.rows.start
        blocks = [-(-n // cells) for n in shape]
        self._blocks, self._held, self._room = (np.zeros(blocks) for _ in range(3))
        self._row = np.zeros(shape[1], np.float32)

    def set_contact(self, contact):
        """Take over a contact set, ndarray of bool; return whether it is scattered. Collective."""
        self._contact = contact
        self._sum(contact, contact, True)
        scattered = (
            np.count_nonzero((self._blocks > 0) & (self._blocks < 1)) >= _SCATTERED * self._blocks.size
        )
        _smooth(self._blocks, self._room)
        np.divide(1.0, self._blocks + _LEAST, out=self._held)
        return scattered

    def fill(self, r, out):
        """out = r on C, the mean of r around elsewhere; r and out, of float64 or float32, may be one. Collective."""
        self._sum(r, self._contact, True)
        _smooth(self._blocks, self._room)
        self._blocks *= self._held
        _fill(r, self._contact, self._blocks, self._cells, self._first, self._row, out)

    def take_back(self, b):
        """Add to b on C what the transpose makes of b elsewhere. Collective."""
        self._sum(b, self._contact, False)
        self._blocks *= self._held
        _smooth(self._blocks, self._room)
        _take(self._blocks, self._contact, self._cells, self._first, self._row, b)

    def _sum(self, field, contact, inside):
        """Means over blocks of a field on C, or elsewhere. Collective."""
        self._blocks[...] = 0
        _add_up(field, contact, inside, self._cells, self._first, self._row, self._blocks)
        if self._comm is not None:
            self._blocks[...] = sum_over(self._comm, self._blocks.reshape(-1)).reshape(self._blocks.shape)


# Blocks in a row of these share what is added up, or spread, over the columns: rows are gone through as they lie.


@any_order
def _add_row(field, contact, inside, total):
    zero = total.dtype.type(0)
    for i in range(total.size):
        value = field[i]
        total[i] += value if contact[i] == inside else zero


@njit()
def _add_up(field, contact, inside, cells, first, row, blocks):
    """Add to each block the mean of its cells here, of the rows from `first` on; `row`: room for one."""
    ny, nx = contact.shape
    share = 1.0 / (cells * cells)
    for j in range(ny):
        if j == 0 or (first + j) % cells == 0:
            row[:] = 0
        _add_row(field[j], contact[j], inside, row)
        if j == ny - 1 or (first + j + 1) % cells == 0:
            of_block = blocks[(first + j) // cells]
            for i in range(nx):
                of_block[i // cells] += share * row[i]


@njit()
def _smooth(blocks, room):
    """Binomial means over 3 x 3 blocks, nothing beyond them; `room` has their shape."""
    ny, nx = blocks.shape
    for _ in range(_SMOOTHED):
        for j in range(ny):
            for i in range(nx):
                value = 2 * blocks[j, i]
                if j > 0:
                    value += blocks[j - 1, i]
                if j < ny - 1:
                    value += blocks[j + 1, i]
                room[j, i] = value / 4
        for j in range(ny):
            for i in range(nx):
                value = 2 * room[j, i]
                if i > 0:
                    value += room[j, i - 1]
                if i < nx - 1:
                    value += room[j, i + 1]
                blocks[j, i] = value / 4


@njit()
def _spread(blocks, cells, row):
    for i in range(row.size):
        row[i] = blocks[i // cells]


@any_order
def _fill_row(r, contact, values, out):
    for i in range(out.size):
        inside, outside = r[i], values[i]
        out[i] = inside if contact[i] else outside


@njit()
def _fill(r, contact, blocks, cells, first, row, out):
    for j in range(len(out)):
        if j == 0 or (first + j) % cells == 0:
            _spread(blocks[(first + j) // cells], cells, row)
        _fill_row(r[j], contact[j], row, out[j])


@any_order
def _take_row(values, contact, b):
    zero = values.dtype.type(0)
    for i in range(b.size):
        value = values[i]
        b[i] += value if contact[i] else zero


@njit()
def _take(blocks, contact, cells, first, row, b):
    for j in range(len(b)):
        if j == 0 or (first + j) % cells == 0:
            _spread(blocks[(first + j) // cells], cells, row)
        _take_row(row, contact[j], b[j])


@cache
def load_between(dtype):
    """Load the compiled loops for fields of a type now, not in the first iteration. Not collective."""
    between, field = Between((3, 3), None, None, 2), np.zeros((3, 3), dtype)
    between.set_contact(np.eye(3, dtype=bool))
    between.fill(field, field)
    between.take_back(field)
