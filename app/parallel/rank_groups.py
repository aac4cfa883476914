"""Ranks that share a grid.

All ranks share the target grid (the finest grid). Every coarser grid, and every window (part of a grid), is shared by
all ranks or by the first few ranks, so that each of these has enough cells. The other ranks have no rows of this grid
and do not work on it; they receive the results when they next own rows. The ranks that share a grid keep their numbers.
`app.parallel.fetch` moves rows from the layout of one grid to the layout of another.
"""

from app.parallel.communicator import Communicator
from app.parallel.slabs import Slabs


class RankGroups:
    """Ranks of a solver, and ranks of each grid.

    If several ranks share a grid, each has at least `cells` cells; the target grid is an exception.
    """

    def __init__(self, comm, cells):
        self.comm = comm if isinstance(comm, Communicator) else Communicator(comm)
        self.size, self.rank, self.cells = comm.size, comm.rank, cells
        self._subcomms = {}

    def count_for(self, grid):
        """Return how many ranks should share a grid."""
        return count_ranks(grid, self.size, self.cells)

    def slabs(self, grid, size=None):
        """Return a grid's `Slabs` on `size` ranks, by default ``count_for(grid)``."""
        size = size or self.count_for(grid)
        return Slabs(grid.ny, size, self.rank, slab_alignment(grid.ny, size))

    def distribute(self, grid, size=None):
        """Return slabs and communicator of a grid. Collective.

        The communicator is None on a rank that has all rows of the grid, and on a rank without rows. `size` is the
        number of ranks that share the grid, by default ``count_for(grid)``.
        """
        slabs = self.slabs(grid, size)
        if slabs.size == 1 or not slabs.active:
            return slabs, None
        return slabs, self.comm if slabs.size == self.size else self._subcomm(slabs.size, range(slabs.size))

    def idle_comm(self, size):
        """Return a communicator of rank 0 and the ranks from `size` on.

        The ranks from `size` on do not share a grid; rank 0 broadcasts results to them. The communicator is None if
        there are no such ranks, and on ranks 1 to `size` - 1. Collective over its ranks when first called for `size`.
        """
        if size == self.size or 0 < self.rank < size:
            return None
        return self.comm if size == 1 else self._subcomm(-size, [0, *range(size, self.size)])

    def _subcomm(self, key, ranks):
        """Return the communicator of some ranks, made once for each key."""
        if key not in self._subcomms:
            self._subcomms[key] = self.comm.subcomm(ranks)
        return self._subcomms[key]

    def destroy(self):
        """Free the communicators made here. Collective."""
        for key in sorted(self._subcomms):
            self._subcomms.pop(key).Free()


def count_ranks(grid, size, cells):
    """Return how many of `size` ranks share a grid.

    The result is `size` or a power of two. If the result is above 1, each rank has at least one row and at least
    `cells` cells. A coarser grid never has more ranks than a finer one.
    """
    most = min(grid.n // cells, grid.ny)
    return size if most >= size else 1 << (max(most, 1).bit_length() - 1)


def slab_alignment(ny, size):
    """Return the number of rows at whose multiples slabs begin.

    The number is a power of two, so that most fine cells are on the rank of their coarse cell. The returned number is
    the largest power of two for which each rank has at least 16 multiples, so that the load is balanced. `ny` is the
    number of rows, `size` the number of ranks.
    """
    block = 1
    while 32 * block * size <= ny:
        block *= 2
    return block
