"""Lists of cells of a grid, and sums over near cells of two lists.

The cells of a list are also stored as *segments*: eight cells of a row, aligned, of which at least one is listed. Loops
over segments are several times faster than loops over cells.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from app.halfspace.list_loops import BAND, SEGMENT, sum_local, sum_on_rows

_BLOCKS = 64  # largest number of blocks in each direction, to estimate the number of pairs


class Segments(NamedTuple):
    """Segments that contain listed cells, sorted by band of rows, by column and by row."""

    rows: np.ndarray  # row of each segment
    columns: np.ndarray  # position of each segment in its row [segments]
    starts: np.ndarray  # first segment of each band, shape (bands + 1,)
    slots: np.ndarray  # positions of the listed cells among the cells of all segments

    @property
    def cells(self):
        """Number of cells of all segments."""
        return SEGMENT * len(self.columns)


class CellList:
    """Cells of a grid, sorted row by row.

    Parameters
    ----------
    grid : Grid
        The grid.
    cells : ndarray
        Sorted flat indices ``iy nx + ix``, or an array of bool of the grid's shape.

    Attributes
    ----------
    cells, ix, iy : ndarray of int
        Flat indices, columns and rows.
    """

    def __init__(self, grid, cells):
        cells = np.asarray(cells)
        self.grid = grid
        self.cells = np.flatnonzero(cells) if cells.dtype == bool else cells.astype(np.int64, copy=False)
        self.iy, self.ix = np.divmod(self.cells, grid.nx)
        self._cache = {}

    def cached(self, key, make):
        """Return what is stored with a key, at first the result of ``make()``."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def __len__(self):
        return len(self.cells)

    @cached_property
    def segments(self):
        """Segments that contain the cells."""
        column = self.ix // SEGMENT
        new = (np.diff(column, prepend=-1) != 0) | (np.diff(self.iy, prepend=-1) != 0)
        rows, columns = self.iy[new], column[new]
        order = np.lexsort((rows, columns, rows // BAND))
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        rows, columns = rows[order], columns[order]
        starts = np.searchsorted(rows // BAND, np.arange(-(-self.grid.ny // BAND) + 1))
        return Segments(rows, columns, starts, SEGMENT * rank[np.cumsum(new) - 1] + self.ix % SEGMENT)


class LocalSum:
    """Sums over near cells: the convolution with a small even table.

    `quadrant` has the coefficients at offsets in y and x, from 0 on.
    """

    def __init__(self, quadrant):
        quadrant = quadrant[:, : np.flatnonzero(quadrant.any(axis=0)).max(initial=0) + 1]
        rows, columns = quadrant.shape
        last = columns - 1 - np.argmax(quadrant[:, ::-1] != 0, axis=1)
        bands = np.arange((rows + BAND - 2) // BAND + 1)
        reach = np.maximum.accumulate(last[::-1])[::-1][np.maximum(BAND * bands - BAND + 1, 0)]
        self._reach = (reach + SEGMENT - 1) // SEGMENT
        centre = SEGMENT * (int(self._reach.max()) + 1)
        self._table = np.zeros((BAND * (len(bands) + 1), 2 * centre + 1))
        self._table[:rows, centre : centre + columns] = quadrant
        self._table[:rows, centre - columns + 1 : centre + 1] = quadrant[:, ::-1]

    def apply(self, sources, p, targets, out=None):
        """Return the sums at the targets, added to `out` if it is given."""
        of, to = sources.segments, targets.segments
        values, sums = np.zeros(of.cells), np.zeros(to.cells)
        values[of.slots] = p
        near = np.empty(len(of.rows), np.int64)
        sum_local(*to[:3], *of[:3], values, self._table, self._reach, near, sums)
        if out is None:
            return sums[to.slots]
        out += sums[to.slots]
        return out

    def add_on_rows(self, sources, p, first, u):
        """Add the sums to u, shape (rows, nx), on rows from row `first` on."""
        sum_on_rows(sources.ix, sources.iy, p, self._table, first, u)


def estimate_pairs(sources, targets, radius):
    """Return about how many pairs of segments are nearer than a radius.

    `radius` is a pair for y and x [cells]. The numbers of segments in blocks of about half a radius are multiplied, so
    the time does not depend on the number of pairs.
    """
    shape = targets.grid.ny, -(-targets.grid.nx // SEGMENT)
    radius = radius[0] + BAND / 2, (radius[1] + SEGMENT / 2) / SEGMENT
    sides = [max(1, int(r / 2), -(-n // _BLOCKS)) for r, n in zip(radius, shape, strict=True)]
    counts = [-(-n // side) for n, side in zip(shape, sides, strict=True)]
    padded, spectra = [2 * count for count in counts], []
    for cells in (sources, targets):
        block = cells.segments.rows // sides[0] * counts[1] + cells.segments.columns // sides[1]
        segments = np.bincount(block, minlength=counts[0] * counts[1]).reshape(counts)
        spectra.append(np.fft.rfft2(segments, s=padded))
    pairs = np.fft.irfft2(spectra[0] * spectra[1].conj(), s=padded)
    y, x = (_distances(count, side) / r for count, side, r in zip(counts, sides, radius, strict=True))
    near = (y**2)[:, None, :, None] + (x**2)[None, :, None, :] <= 1
    return float((pairs * near.mean(axis=(2, 3))).sum())


def _distances(count, side):
    """Return distances of cells of two blocks, for periodic offsets of blocks, shape (2 count, samples)."""
    offsets = np.minimum(np.arange(2 * count), np.arange(2 * count, 0, -1))
    return side * (offsets[:, None] + np.linspace(-0.75, 0.75, 5))
