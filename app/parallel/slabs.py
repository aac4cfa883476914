"""Slabs: the rows of a grid that each rank owns."""

from __future__ import annotations

import numpy as np


def none_if_single(comm):
    """Return `comm`, or None if it has one rank only, which has nobody to talk to. Not collective."""
    return comm if comm is not None and comm.size > 1 else None


class Slabs:
    """Which rows of a grid each rank owns. Every rank holds the same table; not collective.

    Parameters
    ----------
    ny : int
        Rows of the grid.
    size, rank : int
        Number of ranks that share them, and this one's number; one from `size` on has no rows.
    block : int
        Slabs start at multiples of this many rows. The last slab takes what is left. Ranks may own no rows at all.
    """

    def __init__(self, ny, size=1, rank=0, block=1):
        blocks = -(-ny // block)
        per_rank = np.full(size, blocks // size)
        per_rank[: blocks % size] += 1
        starts = np.minimum(np.concatenate([[0], np.cumsum(per_rank)]) * block, ny)
        self._set(starts, rank)

    def _set(self, starts, rank):
        self.starts = tuple(int(s) for s in starts)
        self.size, self.rank, self.ny = len(starts) - 1, rank, self.starts[-1]
        first, last = self.bounds(max(self.size, rank + 1))
        self.rows = slice(int(first[rank]), int(last[rank]))  # this rank's

    @classmethod
    def over(cls, comm, ny):
        """Deal the rows to the ranks of a communicator; None: all of them here."""
        return cls(ny) if comm is None else cls(ny, comm.size, comm.rank)

    @classmethod
    def starting(cls, starts, rank):
        """Slabs with given first rows, of one rank more than there are, seen by one of them."""
        slabs = cls.__new__(cls)
        slabs._set(starts, rank)
        return slabs

    @property
    def counts(self):
        """Number of rows of each rank."""
        return tuple(b - a for a, b in zip(self.starts, self.starts[1:], strict=False))

    @property
    def local(self):
        """Number of rows on this rank."""
        return self.rows.stop - self.rows.start

    @property
    def active(self):
        """Whether this rank is one of those that share the rows."""
        return self.rank < self.size

    def bounds(self, ranks):
        """First row of each of so many ranks and one past its last, two arrays; those beyond `size` have none."""
        edges = np.full(ranks + 1, self.ny)
        known = min(ranks, self.size) + 1
        edges[:known] = self.starts[:known]
        return edges[:-1], edges[1:]

    def coarsen(self, factor):
        """Slabs of the coarse grid whose rows are made of `factor` of these rows each: with the first is the parent."""
        return (
            self if factor == 1 else self.starting([-(-start // factor) for start in self.starts], self.rank)
        )

    def surround(self):
        """Slabs of a grid with a row for every two of these, one before them, and one behind the last or around it.

        With the first of two is the row; rows behind are with the last of these.
        """
        rows = self.ny // 2 + 2
        starts = (rows if start == self.ny else -(-start // 2) + bool(start) for start in self.starts)
        return self.starting(list(starts), self.rank)
