"""A rectangle of cells of a grid, as a grid of its own, and the way of fields there and back.

Pressure outside the contact area is zero and the displacement there is of no interest while contact is elsewhere: all
work can be done on a window around the contact area. Only in the end somebody has to look outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.halfspace.grid import Grid
from app.halfspace.reductions import minimum_over


@dataclass(frozen=True)
class Window:
    """Rows ``y0 <= j < y1`` and columns ``x0 <= i < x1`` of a grid."""

    y0: int
    y1: int
    x0: int
    x1: int

    @property
    def n(self):
        """Number of cells."""
        return (self.y1 - self.y0) * (self.x1 - self.x0)

    def grid(self, whole):
        """Return these cells of the grid `whole` as a grid. Not collective."""
        return Grid(
            self.x1 - self.x0,
            self.y1 - self.y0,
            whole.dx,
            whole.dy,
            whole.x0 + self.x0 * whole.dx,
            whole.y0 + self.y0 * whole.dy,
        )

    def refine(self, factors, grid):
        """Return the children of these cells, as far as they are on the finer `grid`. Not collective."""
        fy, fx = factors
        return Window(self.y0 * fy, min(self.y1 * fy, grid.ny), self.x0 * fx, min(self.x1 * fx, grid.nx))

    def coarsen(self, factors):
        """Return the cells of the coarser grid that have children here. Not collective."""
        fy, fx = factors
        return Window(self.y0 // fy, -(-self.y1 // fy), self.x0 // fx, -(-self.x1 // fx))

    def join(self, other):
        """Return the smallest window around this and another one. Not collective."""
        return Window(
            min(self.y0, other.y0), max(self.y1, other.y1), min(self.x0, other.x0), max(self.x1, other.x1)
        )

    def within(self, other):
        """Return the same cells counted from the first of `other`. Not collective."""
        return Window(self.y0 - other.y0, self.y1 - other.y0, self.x0 - other.x0, self.x1 - other.x0)


def whole(grid):
    """Window of all cells of a grid."""
    return Window(0, grid.ny, 0, grid.nx)


def bounding_box(mask, slabs, comm):
    """Window of all cells that are set in a mask, None if there are none.

    Collective.

    Parameters
    ----------
    mask : ndarray of bool, shape (local rows, nx)
    slabs : Slabs
    comm : mpi4py communicator or None
        Ranks that share the rows.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    first = slabs.rows.start if comm is not None else 0
    box = np.full(4, np.inf)
    if rows.size:
        box[:] = first + rows[0], columns[0], -(first + rows[-1]), -columns[-1]
    box = minimum_over(comm, box)
    if np.isinf(box[0]):
        return None
    return Window(int(box[0]), 1 - int(box[2]), int(box[1]), 1 - int(box[3]))


class Passage:
    """Moves fields from the rows of a grid to those of a window of it, each with slabs of their own.

    Parameters
    ----------
    window : Window
    outer, inner : Slabs
        Rows of the grid and of the window.
    comm : mpi4py communicator or None
        Ranks that share the rows of both; None if this rank holds all of the grid.
    """

    def __init__(self, window, outer, inner, comm):
        self.window, self.outer, self.inner = window, outer, inner
        self.comm = comm
        self.columns = slice(window.x0, window.x1)
        rows = inner.rows  # where every rank has all of the grid, it may still have a part of the window only
        self._here = slice(window.y0 + rows.start, window.y0 + rows.stop)

    def _rows(self, outer_rank, inner_rank):
        """Rows of the window that one rank holds as part of the grid and another one as part of the window."""
        first = max(self.outer.starts[outer_rank] - self.window.y0, self.inner.starts[inner_rank])
        last = min(self.outer.starts[outer_rank + 1] - self.window.y0, self.inner.starts[inner_rank + 1])
        return first, max(first, last)

    def enter(self, field):
        """Return a copy of the window's part of a field on the grid, shape (rows here, columns). Collective."""
        if self.comm is None:
            return field[self._here, self.columns].copy()
        rank, ranks = self.comm.rank, range(self.comm.size)
        first = self.window.y0 - self.outer.starts[rank]
        spans = [self._rows(rank, other) for other in ranks]
        sent = [field[first + a : first + b, self.columns] for a, b in spans]
        received = [self._rows(other, rank) for other in ranks]
        return self._exchange(sent, received, field.dtype)

    def leave(self, part, field):
        """Put a field on the window into one on the grid, in place. Collective."""
        if self.comm is None:
            field[self._here, self.columns] = part
            return
        rank, ranks = self.comm.rank, range(self.comm.size)
        first = self.inner.starts[rank]
        sent = [part[a - first : b - first] for a, b in (self._rows(other, rank) for other in ranks)]
        received = [self._rows(rank, other) for other in ranks]
        arrived = self._exchange(sent, received, part.dtype)
        filled = [span for span in received if span[0] < span[1]]
        if filled:
            start = self.window.y0 - self.outer.starts[rank]
            field[start + filled[0][0] : start + filled[-1][1], self.columns] = arrived

    def _exchange(self, sent, received, dtype):
        """Send consecutive rows to every rank and receive theirs; return what came, one row below the other."""
        width = self.columns.stop - self.columns.start
        arrived = np.empty((sum(b - a for a, b in received), width), dtype)

        def counts(lengths):
            sizes = np.array(lengths) * width
            return sizes, np.concatenate([[0], np.cumsum(sizes)[:-1]])

        self.comm.Alltoallv(
            [np.ascontiguousarray(np.concatenate(sent)), counts([len(rows) for rows in sent])],
            [arrived, counts([b - a for a, b in received])],
        )
        return arrived
