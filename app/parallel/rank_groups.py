"""Ranks that share a grid.

The target grid is shared by all ranks. Every other grid, and every window of one, is shared by all or by the first few,
so that each of these has enough cells. The other ranks have no rows of it and take no part; they receive the results
when they next own rows. A rank has the same number in every communicator here. Rows move point to point between any two
layouts (`fetch`).
"""

from app.parallel.communicator import Communicator
from app.parallel.slabs import Slabs


class RankGroups:
    """Ranks of a solver, and those that share each grid.

    `cells` is the least number of cells per rank on a shared grid.
    """

    def __init__(self, comm, cells):
        self.comm = comm if isinstance(comm, Communicator) else Communicator(comm)
        self.size, self.rank, self.cells = comm.size, comm.rank, cells
        self._subcomms = {}

    def count_for(self, grid):
        """Return the number of ranks that share a grid."""
        return count_ranks(grid, self.size, self.cells)

    def slabs(self, grid, size=None):
        """Return slabs on the first `size` (`count_for`) ranks."""
        size = size or self.count_for(grid)
        return Slabs(grid.ny, size, self.rank, slab_alignment(grid.ny, size))

    def distribute(self, grid, size=None):
        """Return slabs and communicator of a grid. Collective.

        The communicator is None if this rank has all rows, or none.
        """
        slabs = self.slabs(grid, size)
        if slabs.size == 1 or not slabs.active:
            return slabs, None
        return slabs, self.comm if slabs.size == self.size else self._subcomm(slabs.size, range(slabs.size))

    def idle_comm(self, size):
        """Return a communicator of rank 0 and the ranks from `size` on.

        None if there are no such ranks, and on the others of the first ranks. Collective over its ranks when first
        called for `size`.
        """
        if size == self.size or 0 < self.rank < size:
            return None
        return self.comm if size == 1 else self._subcomm(-size, [0, *range(size, self.size)])

    def _subcomm(self, key, ranks):
        if key not in self._subcomms:
            self._subcomms[key] = self.comm.subcomm(ranks)
        return self._subcomms[key]

    def destroy(self):
        """Free the communicators made here. Collective."""
        for key in sorted(self._subcomms):
            self._subcomms.pop(key).Free()


def count_ranks(grid, size, cells):
    """Return how many of `size` ranks share a grid.

    All do, or a power of two. Each has a row and at least `cells` cells. Coarser grids never have more ranks.
    """
    most = min(grid.n // cells, grid.ny)
    return size if most >= size else 1 << (max(most, 1).bit_length() - 1)


def slab_alignment(ny, size):
    """Return the largest power of two that aligns balanced slabs.

    Slabs of a grid and of the next coarser one then mostly match.
    """
    block = 1
    while 32 * block * size <= ny:
        block *= 2
    return block
