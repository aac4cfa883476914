"""A residual continued between contacts: where the steps of `app.methods.free.contact_edge` begin.

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

import numpy as np

from app.base.numba_cache import njit
from app.parallel.reductions import add_masked, njit_reassoc, sum_over
from app.parallel.slabs import Slabs

CONTACT_SHARE_OFFSET = 0.15  # share of contact around a cell, beside which less counts little
SMOOTHING_PASSES = 2  # times
MIN_SCATTERED_FRACTION = 0.08  # of the blocks are in contact in part, where this gains more than it costs


class BlockAverage:
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
        first = (slabs or Slabs(shape[0])).rows.start
        self._comm, self._cells = comm, cells
        self._places = cells, first, np.zeros(shape[1], np.float32)  # a row to work in
        self._shape = tuple(-(-n // cells) for n in shape)  # in blocks
        self._of_r, self._held, self._room = (np.zeros(self._shape) for _ in range(3))

    def set_contact(self, contact, r=None):
        """Take over a contact set, ndarray of bool, and if there is one look at a residual by the same reduction.

        Collective.

        Returns
        -------
        bool
            Whether C is scattered.
        """
        self._contact = contact
        fields = [contact] if r is None else [contact, r]
        blocks, *of_r = sum_over(self._comm, np.stack([self.local_means(field) for field in fields]))
        if of_r:
            [self._of_r] = of_r
        partly = np.count_nonzero((blocks > 0) & (blocks < 1))
        _smooth(blocks, self._room)
        np.divide(1.0, blocks + CONTACT_SHARE_OFFSET, out=self._held)
        return bool(partly >= MIN_SCATTERED_FRACTION * blocks.size)

    def update(self, r):
        """Find the means of the residual to be filled next. Collective."""
        self._of_r = sum_over(self._comm, self.local_means(r))

    def subtract(self, share, means):
        """The residual is less by a share of q; `means`: `local_means` of q, over the ranks. Not collective."""
        self._of_r -= share * means.reshape(self._shape)

    def local_means(self, q):
        """What the rows of this rank add to means over blocks of q, or of 0 outside C. Not collective."""
        blocks = np.zeros(self._shape)
        _add_up(q, self._contact, *self._places, blocks)
        return blocks

    def extend(self, r, out):
        """out = r on C, elsewhere the mean around, which is known; float64 or float32, may be one. Not collective."""
        blocks = self._of_r.copy()
        _smooth(blocks, self._room)
        blocks *= self._held
        _fill(r, self._contact, blocks, *self._places, out)

    def apply_transpose(self, r, b):
        """Add to b on C what the transpose makes of b elsewhere; return r.b, r what was filled last. Collective.

        It costs no reduction of its own: means of r are known.
        """
        blocks = np.zeros(self._shape)
        product = _add_up_beside(r, b, self._contact, *self._places, blocks)
        found = sum_over(self._comm, np.append(blocks, product))
        blocks = found[:-1].reshape(self._shape) * self._held
        _smooth(blocks, self._room)
        _take(blocks, self._contact, *self._places, b)
        return float(found[-1]) + self._cells**2 * float(np.vdot(self._of_r, blocks))


# Blocks in a row of these share what is added up, or spread, over the columns: rows are gone through as they lie.


@njit()
def _rows_of_blocks(first, ny, cells):
    """Numbers of the rows of blocks that have some of `ny` rows, from `first` on."""
    return range(first // cells, (first + ny - 1) // cells + 1)


@njit()
def _rows_in(k, cells, first, ny):
    """The rows, counted from `first` on, that are in row k of blocks."""
    return range(max(k * cells - first, 0), min((k + 1) * cells - first, ny))


@njit()
def _into_blocks(row, cells, blocks):
    share = 1.0 / (cells * cells)
    for i in range(row.size):
        blocks[i // cells] += share * row[i]


@njit()
def _add_up(field, contact, cells, first, row, blocks):
    """Add to each block the mean of a field on C over its cells here, of rows from `first` on; `row`: room for one."""
    for k in _rows_of_blocks(first, len(field), cells):
        row[:] = 0
        for j in _rows_in(k, cells, first, len(field)):
            add_masked(field[j], contact[j], row)
        _into_blocks(row, cells, blocks[k])


@njit_reassoc
def _add_row_beside(r, b, contact, total):
    product, zero = 0.0, total.dtype.type(0)
    for i in range(total.size):
        value = b[i]
        product += np.float64(r[i]) * value if contact[i] else 0.0
        total[i] += zero if contact[i] else value
    return product


@njit()
def _add_up_beside(r, b, contact, cells, first, row, blocks):
    """As `_add_up`, of b outside C; return r.b on C."""
    product = 0.0
    for k in _rows_of_blocks(first, len(b), cells):
        row[:] = 0
        for j in _rows_in(k, cells, first, len(b)):
            product += _add_row_beside(r[j], b[j], contact[j], row)
        _into_blocks(row, cells, blocks[k])
    return product


@njit()
def _smooth(blocks, room):
    """Binomial means over 3 x 3 blocks, nothing beyond them; `room` has their shape."""
    ny, nx = blocks.shape
    for _ in range(SMOOTHING_PASSES):
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


@njit_reassoc
def _fill_row(r, contact, values, out):
    for i in range(out.size):
        inside, outside = r[i], values[i]
        out[i] = inside if contact[i] else outside


@njit()
def _fill(r, contact, blocks, cells, first, row, out):
    for k in _rows_of_blocks(first, len(out), cells):
        _spread(blocks[k], cells, row)
        for j in _rows_in(k, cells, first, len(out)):
            _fill_row(r[j], contact[j], row, out[j])


@njit()
def _take(blocks, contact, cells, first, row, b):
    for k in _rows_of_blocks(first, len(b), cells):
        _spread(blocks[k], cells, row)
        for j in _rows_in(k, cells, first, len(b)):
            add_masked(row, contact[j], b[j])
