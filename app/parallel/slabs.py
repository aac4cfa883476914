"""Distribution of a grid's rows over MPI ranks."""

import numpy as np


def none_if_single(comm):
    """Return `comm`, or None for a single rank."""
    return comm if comm is not None and comm.size > 1 else None


class Slabs:
    """Slabs of consecutive rows, one for each rank.

    The first `size` ranks share `ny` rows; `rank` is the number of this rank. Ranks from `size` on have no rows; some
    of the first ranks may have none either. Slabs begin at multiples of `block` rows; the last slab has the remaining
    rows, too.
    """

    def __init__(self, ny, size=1, rank=0, block=1):
        blocks = -(-ny // block)
        per_rank = np.full(size, blocks // size)
        per_rank[: blocks % size] += 1
        self._set(np.minimum(np.concatenate([[0], np.cumsum(per_rank)]) * block, ny), rank)

    def _set(self, starts, rank):
        self.starts = tuple(int(start) for start in starts)
        self.size, self.rank, self.ny = len(self.starts) - 1, rank, self.starts[-1]
        first, last = self.bounds(max(self.size, rank + 1))
        self.rows = slice(int(first[rank]), int(last[rank]))  # rows of this rank

    @classmethod
    def over(cls, comm, ny):
        """Distribute ny rows over all ranks of a communicator."""
        return cls(ny) if comm is None else cls(ny, comm.size, comm.rank)

    @classmethod
    def starting(cls, starts, rank):
        """Make slabs from each rank's first row, followed by the row count."""
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
        """True if this rank is in the group that shares the rows."""
        return self.rank < self.size

    def bounds(self, ranks):
        """Return each rank's first row and end row, for `ranks` ranks."""
        edges = np.full(ranks + 1, self.ny)
        shared = min(ranks, self.size) + 1
        edges[:shared] = self.starts[:shared]
        return edges[:-1], edges[1:]

    def coarsen(self, factor):
        """Return slabs of coarse rows, each of `factor` rows.

        A coarse row is on the rank that owns its first fine row.
        """
        if factor == 1:
            return self
        return self.starting([-(-start // factor) for start in self.starts], self.rank)

    def surround(self):
        """Return slabs of coarse rows extending beyond the grid.

        A coarse row consists of two fine rows. There is one more coarse row before the grid, and one after it. A coarse
        row is on the rank that owns its first fine row.
        """
        rows = self.ny // 2 + 2
        starts = [rows if start == self.ny else -(-start // 2) + bool(start) for start in self.starts]
        return self.starting(starts, self.rank)
