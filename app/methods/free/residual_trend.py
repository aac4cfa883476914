"""Trend of the residual over the patch, if cells are plastic.

Cells that reach the hardness lose the pressure above it. The other cells of C make up for it in the next solve, so the
remaining residual varies slowly over the patch. A correction of this residual also displaces the cells between the
cells of C. The trend is a mean of the residual over the cells of C nearby. It follows from means over blocks of all
sizes, from the whole patch to a few cells:

    trend = (s + offset * trend of blocks twice as large) / (c + offset).

s is the mean of the residual in a block, with zero outside C, and c is the share of C. The largest block is the whole
patch, and outside it the trend is zero. A block follows the spots in it as far as they are stiff. In a block of length
L, N spots of radius a have a share of N pi a^2 / L^2, and they are 2 a N / L times as stiff as a punch on the whole
block. This ratio is the share divided by the offset pi a / (2 L), so the offset halves when L doubles.
"""

import numpy as np

from app.methods.free.block_average import add_blocks, sum_blocks
from app.parallel.reductions import sum_over

BLOCK_CELLS = 16  # cells of the smallest blocks in each direction
SHARE_OFFSET = 0.3  # for the smallest blocks: spots of three cells radius


class ResidualTrend:
    """Trend of a residual over the patch.

    Collective. Arrays have the rows of this rank.

    Parameters
    ----------
    r : ndarray, shape (local rows, nx), [mm]
        Residual on C.
    contact : ndarray of bool, shape (local rows, nx)
        The contact set C.
    slabs : Slabs
        Distribution of the rows.
    comm : mpi4py communicator or None
        Ranks that share the rows.
    """

    def __init__(self, r, contact, slabs, comm):
        nx = r.shape[1]
        self._places = BLOCK_CELLS, slabs.rows.start, np.zeros(nx, np.float32)
        fields = np.zeros((2, -(-slabs.ny // BLOCK_CELLS), -(-nx // BLOCK_CELLS)))
        for field, blocks in zip((r, contact), fields, strict=True):
            sum_blocks(field, contact, *self._places, blocks)
        self._trend = _trend(*sum_over(comm, fields))

    def add(self, factor, cells, out):
        """Add `factor` times the residual's trend to `out`, in the mask `cells`."""
        add_blocks(factor * self._trend, cells, *self._places, out)


def _trend(sums, shares):
    """Return the residual's trend in each smallest block."""
    levels = [(sums, shares)]
    while max(sums.shape) > 1:
        sums, shares = _halve(sums), _halve(shares)
        levels.append((sums, shares))
    trend = np.zeros((1, 1))
    for level in reversed(range(len(levels))):
        sums, shares = levels[level]
        offset = SHARE_OFFSET / 2**level
        if trend.shape != sums.shape:
            trend = trend.repeat(2, 0).repeat(2, 1)[: sums.shape[0], : sums.shape[1]]
        trend = (sums + offset * trend) / (shares + offset)
    return trend


def _halve(blocks):
    """Return means over blocks twice as large; values beyond the patch are zero."""
    rows = np.add.reduceat(blocks, range(0, blocks.shape[0], 2), axis=0)
    return np.add.reduceat(rows, range(0, blocks.shape[1], 2), axis=1) / 4
