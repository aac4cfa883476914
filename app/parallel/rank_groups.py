"""Which ranks share a grid.

Every grid but the target, and every window of one, is dealt to all ranks or to the first few, so that each has enough
cells. A rank has the same number in every communicator here, and rows go point to point between any two layouts
(`fetch`). A rank beyond has no rows and takes no part. It receives the results when it next owns rows.
"""

from __future__ import annotations

from app.parallel.communicator import Communicator
from app.parallel.slabs import Slabs


class RankGroups:
    """All ranks of a solver, and the first few of them for each small grid.

    Parameters
    ----------
    comm : mpi4py communicator
    cells : int
        Least number of cells of a rank that shares a grid.
    """

    def __init__(self, comm, cells):
        self.comm = comm if isinstance(comm, Communicator) else Communicator(comm)
        self.size, self.rank, self.cells = comm.size, comm.rank, cells
        self._made = {}

    def count_for(self, grid):
        """Return how many ranks share a grid, see `count_ranks`. Not collective."""
        return count_ranks(grid, self.size, self.cells)

    def distribute(self, grid, size=None):
        """Deal the rows of a grid to the first `size` ranks. Collective over these, when it is their first grid.

        Returns
        -------
        slabs : Slabs
        comm : Communicator or None
            None if all rows are here, or none.
        """
        slabs = self.slabs(grid, size)
        return slabs, self.first(slabs.size)

    def slabs(self, grid, size=None):
        """Those of `deal`. Not collective."""
        size = size or self.count_for(grid)
        return Slabs(grid.ny, size, self.rank, slab_alignment(grid.ny, size))

    def first(self, size):
        """Communicator of the first ranks; None if this is the only one, or none of them. Collective over these."""
        if size == 1 or self.rank >= size:
            return None
        if size == self.size:
            return self.comm
        if size not in self._made:
            self._made[size] = self.comm.first(size)
        return self._made[size]

    def idle_comm(self, size):
        """Communicator of rank 0 and those beyond the first `size`, which wait for a grid that they have no part in.

        Collective over these, when first asked for. None if there are none, and on the other first ranks.
        """
        if size == self.size or 0 < self.rank < size:
            return None
        if size == 1:
            return self.comm
        if -size not in self._made:
            self._made[-size] = self.comm.of([0, *range(size, self.size)])
        return self._made[-size]

    def destroy(self):
        """Free the communicators made here. Collective."""
        for size in sorted(self._made):
            self._made.pop(size).Free()


def count_ranks(grid, size, cells):
    """Return how many of `size` ranks share a grid: all, or a power of two. Not collective.

    Each has `cells` cells at least, and a row. Coarser grids, and windows, are never on more.
    """
    most = min(grid.n // cells, grid.ny)
    return size if most >= size else 1 << (max(most, 1).bit_length() - 1)


def slab_alignment(ny, size):
    """Rows that slabs should start at multiples of: the largest power of two that costs next to no balance.

    Not collective. Slabs of a grid and of the next coarser one then mostly fit.
    """
    block = 1
    while 32 * block * size <= ny:
        block *= 2
    return block
