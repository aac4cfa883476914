"""A rectangle of cells of a grid, as a grid of its own, and the way of fields there and back.

Pressure outside the contact area is zero and the displacement there is of no interest while contact is elsewhere: all
work can be done on a window around the contact area. Only in the end somebody has to look outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

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


class Scatter:
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

    def forward(self, field):
        """Return a copy of the window's part of a field on the grid, shape (rows here, columns). Collective."""
        if self.comm is None:
            return field[self._here, self.columns].copy()
        part = np.empty((self.inner.local, self.columns.stop - self.columns.start), field.dtype)
        of_grid, of_window = self._shared(field, part)
        self._exchange(of_grid, of_window)
        return part

    def reverse(self, part, field):
        """Put a field on the window into one on the grid, in place. Collective."""
        if self.comm is None:
            field[self._here, self.columns] = part
            return
        of_grid, of_window = self._shared(field, part)
        self._exchange(of_window, of_grid)

    def _shared(self, field, part):
        """For every rank: rows of `field` for its part of the window, and rows of `part` from its field."""
        rank, ranks = self.comm.rank, range(self.comm.size)
        first = self.window.y0 - self.outer.starts[rank]
        of_grid = [
            field[first + a : first + b, self.columns] for a, b in (self._rows(rank, q) for q in ranks)
        ]
        first = -self.inner.starts[rank]
        of_window = [part[first + a : first + b] for a, b in (self._rows(q, rank) for q in ranks)]
        return of_grid, of_window

    def _exchange(self, sources, targets):
        """Send every rank its rows and put theirs where they belong; what stays here moves only once. Collective."""
        here = self.comm.rank
        parcels = {
            rank: np.ascontiguousarray(rows)
            for rank, rows in enumerate(sources)
            if rows.size and rank != here
        }
        on_their_way = [self.comm.Isend(parcel, rank) for rank, parcel in parcels.items()]
        targets[here][...] = sources[here]
        for rank, rows in enumerate(targets):
            if rows.size and rank != here:
                arrived = np.empty(rows.shape, rows.dtype)
                self.comm.Recv(arrived, rank)
                rows[...] = arrived
        MPI.Request.Waitall(on_their_way)
