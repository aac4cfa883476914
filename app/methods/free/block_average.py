"""Block means of the residual between contact spots.

The extension E (`app.methods.free.contact_edge`) continues a residual r from contact cells to other cells, one cell
further in each step. With B, the inverse of A, ``B E r`` vanishes between distant contact spots only if E extends r
from one spot to the next. So the steps start from means of r over the contact nearby. To compute these, r and the share
of contact are averaged over square blocks of cells and smoothed over neighbour blocks; then r is divided by the share:

    x_o = P D S M r,    D = 1 / (S c + offset),    c = M 1 on C.

x_o is the start of the steps outside the contact set C. P copies block values to cells, and M computes means over the
cells of blocks. S computes binomial means over 3 x 3 blocks twice, with zeros outside the patch. Because of the offset,
x_o decays with the distance from contact, as the displacement does. The transpose for a field b on and outside C is

    b_C + P S D M b_o

and is applied after the steps of E^T. All ranks have all blocks, and each rank sums the cells of its rows. If contact
consists of a few large areas, block means are of no use, and the steps start from zero.
"""

import numpy as np

from app.base.numba_cache import njit
from app.parallel.reductions import add_masked, njit_reassoc, sum_over
from app.parallel.slabs import Slabs

CONTACT_SHARE_OFFSET = 0.15  # share of contact nearby below which means decay to zero
SMOOTHING_PASSES = 2
MIN_SCATTERED_FRACTION = 0.08  # smallest fraction of blocks in partial contact for which block means are used


class BlockAverage:
    """Extension of a residual by its block means, and the transpose.

    Collective. Arrays have the rows of this rank.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the grid.
    slabs : Slabs or None
        Distribution of the rows; None if all rows are on this rank.
    comm : mpi4py communicator or None
        Ranks that share the grid.
    cells : int
        Number of cells of a block in each direction.
    contrast : float
        Compliance for long waves over that for short ones. If it is large, displacements decay slowly between contact
        spots, so the offset (see the module) is divided by it.
    """

    def __init__(self, shape, slabs, comm, cells, contrast=1.0):
        first = (slabs or Slabs(shape[0])).rows.start
        self._comm, self._cells, self._offset = comm, cells, CONTACT_SHARE_OFFSET / contrast
        self._places = cells, first, np.zeros(shape[1], np.float32)  # a work row
        self._shape = tuple(-(-n // cells) for n in shape)  # in blocks
        self._means, self._weights, self._work = (np.zeros(self._shape) for _ in range(3))

    def set_contact(self, contact, r=None):
        """Set the contact set; return whether contact consists of scattered spots.

        If a residual r is given, its block means are computed, too.
        """
        self._contact = contact
        fields = [contact] if r is None else [contact, r]
        shares, *means = sum_over(self._comm, np.stack([self.local_means(field) for field in fields]))
        if means:
            [self._means] = means
        partial = np.count_nonzero((shares > 0) & (shares < 1))
        _smooth(shares, self._work)
        np.divide(1.0, shares + self._offset, out=self._weights)
        return bool(partial >= MIN_SCATTERED_FRACTION * shares.size)

    def update(self, r):
        """Compute the block means of a residual r."""
        self._means = sum_over(self._comm, self.local_means(r))

    def subtract(self, share, means):
        """Update the block means of a changed residual.

        ``share * q`` was subtracted from the residual. `means` is the sum of `local_means(q)` over the ranks.
        """
        self._means -= share * means.reshape(self._shape)

    def local_means(self, q):
        """Return this rank's terms of the block means of a field q.

        The block means are the sum of these terms over all ranks.
        """
        blocks = np.zeros(self._shape)
        sum_blocks(q, self._contact, *self._places, blocks)
        return blocks

    def extend(self, r, out):
        """Set `out` to r on contact, and to smoothed block means elsewhere.

        `out` may be r.
        """
        blocks = self._means.copy()
        _smooth(blocks, self._work)
        blocks *= self._weights
        _extend(r, self._contact, blocks, *self._places, out)

    def apply_transpose(self, r, b):
        """Apply the transpose of `extend` to b, in place; return r.b afterwards.

        Only contact cells of b are changed. The scalar product r.b is computed from the stored block means of the
        residual, so `r` must be the residual last passed to `extend`.
        """
        blocks = np.zeros(self._shape)
        product = _sum_blocks_outside(r, b, self._contact, *self._places, blocks)
        sums = sum_over(self._comm, np.append(blocks, product))
        blocks = sums[:-1].reshape(self._shape) * self._weights
        _smooth(blocks, self._work)
        add_blocks(blocks, self._contact, *self._places, b)
        return float(sums[-1]) + self._cells**2 * float(np.vdot(self._means, blocks))


# Fields are read row by row: the rows of a row of blocks are first added to one work row.


@njit()
def _block_rows(first, ny, cells):
    """Return the range of block rows containing local rows."""
    return range(first // cells, (first + ny - 1) // cells + 1)


@njit()
def _rows_in_block(k, cells, first, ny):
    """Return block row k's range of local rows."""
    return range(max(k * cells - first, 0), min((k + 1) * cells - first, ny))


@njit()
def _add_row_to_blocks(row, cells, blocks):
    share = 1.0 / (cells * cells)
    for i in range(row.size):
        blocks[i // cells] += share * row[i]


@njit()
def sum_blocks(field, contact, cells, first, row, blocks):
    """Add a field's block means on contact to `blocks`.

    In the means, cells outside contact count as zero.
    """
    for k in _block_rows(first, len(field), cells):
        row[:] = 0
        for j in _rows_in_block(k, cells, first, len(field)):
            add_masked(field[j], contact[j], row)
        _add_row_to_blocks(row, cells, blocks[k])


@njit_reassoc
def _sum_row_outside(r, b, contact, total):
    product, zero = 0.0, total.dtype.type(0)
    for i in range(total.size):
        value = b[i]
        product += np.float64(r[i]) * value if contact[i] else 0.0
        total[i] += zero if contact[i] else value
    return product


@njit()
def _sum_blocks_outside(r, b, contact, cells, first, row, blocks):
    """Add a field's block means outside contact to `blocks`.

    The field is b; contact cells count as zero. Return the scalar product r.b over contact, where r is the residual.
    """
    product = 0.0
    for k in _block_rows(first, len(b), cells):
        row[:] = 0
        for j in _rows_in_block(k, cells, first, len(b)):
            product += _sum_row_outside(r[j], b[j], contact[j], row)
        _add_row_to_blocks(row, cells, blocks[k])
    return product


@njit()
def _smooth(blocks, work):
    """Smooth block values by binomial means over 3 x 3 blocks.

    Blocks outside the patch count as zero.
    """
    ny, nx = blocks.shape
    for _ in range(SMOOTHING_PASSES):
        for j in range(ny):
            for i in range(nx):
                value = 2 * blocks[j, i]
                if j > 0:
                    value += blocks[j - 1, i]
                if j < ny - 1:
                    value += blocks[j + 1, i]
                work[j, i] = value / 4
        for j in range(ny):
            for i in range(nx):
                value = 2 * work[j, i]
                if i > 0:
                    value += work[j, i - 1]
                if i < nx - 1:
                    value += work[j, i + 1]
                blocks[j, i] = value / 4


@njit()
def _spread(blocks, cells, row):
    for i in range(row.size):
        row[i] = blocks[i // cells]


@njit_reassoc
def _extend_row(r, contact, values, out):
    for i in range(out.size):
        inside, outside = r[i], values[i]
        out[i] = inside if contact[i] else outside


@njit()
def _extend(r, contact, blocks, cells, first, row, out):
    for k in _block_rows(first, len(out), cells):
        _spread(blocks[k], cells, row)
        for j in _rows_in_block(k, cells, first, len(out)):
            _extend_row(r[j], contact[j], row, out[j])


@njit()
def add_blocks(blocks, contact, cells, first, row, b):
    """Add block values to b in contact cells."""
    for k in _block_rows(first, len(b), cells):
        _spread(blocks[k], cells, row)
        for j in _rows_in_block(k, cells, first, len(b)):
            add_masked(row, contact[j], b[j])
