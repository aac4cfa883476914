"""Windows of a grid, and transfer of fields.

A window is a rectangle of cells of a grid, used as a grid of its own. Outside the contact area the pressure is zero,
and the iteration does not need the displacement there. So the iteration can work on a window around the contact area.
Only the final verification needs the cells outside the window.
"""

from dataclasses import dataclass

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.grid import Grid
from app.parallel.fetch import Fetch
from app.parallel.reductions import minimum_over, nonzero_span


@dataclass(frozen=True)
class Window:
    """Rectangle of cells: rows [y0, y1) and columns [x0, x1) of a grid."""

    y0: int
    y1: int
    x0: int
    x1: int

    @property
    def n(self):
        """Number of cells."""
        return (self.y1 - self.y0) * (self.x1 - self.x0)

    def grid(self, whole):
        """Return this window of `whole` as a grid.

        It is periodic in one direction if it has all cells of the period.
        """
        x0, y0 = whole.x0 + self.x0 * whole.dx, whole.y0 + self.y0 * whole.dy
        shape = self.y1 - self.y0, self.x1 - self.x0
        sizes = zip(whole.repeats, shape, whole.shape, strict=True)
        kept = all(not repeats or n == m for repeats, n, m in sizes)
        return Grid(shape[1], shape[0], whole.dx, whole.dy, x0, y0, whole.one_way if kept else "")

    def refine(self, factors, grid):
        """Return the window of the fine cells, with the coarsening factors (fy, fx)."""
        fy, fx = factors
        return Window(self.y0 * fy, min(self.y1 * fy, grid.ny), self.x0 * fx, min(self.x1 * fx, grid.nx))

    def coarsen(self, factors):
        """Return the window of the coarse cells that this window touches."""
        fy, fx = factors
        return Window(self.y0 // fy, -(-self.y1 // fy), self.x0 // fx, -(-self.x1 // fx))

    def join(self, other):
        """Return the smallest window around this and another one."""
        return Window(
            min(self.y0, other.y0), max(self.y1, other.y1), min(self.x0, other.x0), max(self.x1, other.x1)
        )

    def relative_to(self, other):
        """Return this window, counted from `other`'s first cell."""
        return Window(self.y0 - other.y0, self.y1 - other.y0, self.x0 - other.x0, self.x1 - other.x0)


def whole_window(grid):
    """Return the window of all cells of a grid."""
    return Window(0, grid.ny, 0, grid.nx)


def bounding_boxes(masks, slabs, comm):
    """Return, for each mask, the smallest window around its cells. Collective.

    A mask is an array of bool on the rows of this rank. The window of a mask without cells is None. All masks together
    take one reduction over `comm`, the ranks that share the rows.
    """
    minima = minimum_over(comm, [local_bounds(mask, slabs) for mask in masks])
    return [window_from_bounds(bounds) for bounds in minima]


def local_bounds(mask, slabs):
    """Return this rank's bounds of a mask, for `window_from_bounds`.

    The bounds are four numbers: the first row and column, then minus the last row and column, counted on the whole
    grid. All are infinite if the mask has no cells on this rank.
    """
    first = slabs.rows.start
    y0, y1, x0, x1 = _extent(mask)
    return [first + y0, x0, 1 - first - y1, 1 - x1] if y1 else [np.inf] * 4


def window_from_bounds(minima):
    """Return the window from the minima of `local_bounds` over ranks; None if no rank has cells."""
    y0, x0, y1, x1 = minima
    return None if np.isinf(y0) else Window(int(y0), 1 - int(y1), int(x0), 1 - int(x1))


@njit()
def _extent(mask):
    """Return first and end row, first and end column of a mask."""
    y0, y1, x0, x1 = 0, 0, mask.shape[1], 0
    for j in range(mask.shape[0]):
        first, last = nonzero_span(mask[j])
        if last:
            y0, y1 = y0 if y1 else j, j + 1
            x0, x1 = min(x0, first), max(x1, last)
    return y0, y1, x0, x1


class Scatter:
    """Transfer of fields between grid and window.

    `outer` and `inner` are the `Slabs` of the grid and of the window; `comm` has all ranks that own rows of either.
    """

    def __init__(self, window, outer, inner, comm):
        ranks = 1 if comm is None else comm.size
        first, last = inner.bounds(ranks)
        self._forward = Fetch(outer, [(first + window.y0, last + window.y0)], comm)
        first, last = (np.clip(rows, window.y0, window.y1) for rows in outer.bounds(ranks))
        self._reverse = Fetch(inner, [(first - window.y0, last - window.y0)], comm)
        start = outer.rows.start
        first = min(max(window.y0 - start, 0), outer.local)
        self._columns = slice(window.x0, window.x1)
        self._place = slice(first, first + self._reverse.rows), self._columns

    def forward(self, field, out=None):
        """Copy a field's part in the window to `out`, by default new. Collective."""
        part = self._forward(field[:, self._columns], out)
        if out is None:
            return part.copy() if self._forward.unchanged else part
        if part is not out:
            out[...] = part
        return out

    def reverse(self, part, field, storage=None):
        """Copy `part`, a window field, into `field`. Collective.

        `field` is a field of the grid. `storage` is an array of bytes for the received rows, by default a new one.
        """
        rows, columns = self._reverse.rows, part.shape[1]
        out = None if storage is None else storage[: rows * columns * part.itemsize].view(part.dtype)
        field[self._place] = self._reverse(part, None if out is None else out.reshape(rows, columns))
