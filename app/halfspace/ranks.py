"""Which ranks share a grid.

Every grid, and every window of one, is dealt to as many ranks as it is worth: all, or the first few. So a rank has the
same number in every communicator here, and rows go point to point between any two layouts (`fetch`). A rank beyond has
no rows and takes no part; it hears of what was decided when it has rows again.
"""

from __future__ import annotations

import numpy as np

from app.halfspace.communication import Communicator
from app.halfspace.grid import Slabs

# A grid is worth another rank if that saves more than talking costs. Inside a machine that is so from this many cells
# a rank on, where a step of CG takes about 0.3 ms; between machines it is found by measuring the latency.
_CELLS_INSIDE = 8192
# A step waits for some 12 messages, and does 1e-9 s of work for a cell and a logarithm.
_CELLS_PER_SECOND = 4e8
_BYTES_PER_SECOND = 5e8  # sent in a solve for a second that a core computes, as replayed (docs/scaling.md)


class Ranks:
    """All ranks of a solver, and the first few of them for each grid that is not worth more.

    Collective.

    Parameters
    ----------
    comm : mpi4py communicator
    cells : int
        That a rank gets at least; 0: by the latency between machines.
    """

    def __init__(self, comm, cells=0):
        self.comm = comm if isinstance(comm, Communicator) else Communicator(comm)
        self.size, self.rank = comm.size, comm.rank
        self.first_machine = 1 if cells else self.comm.first_machine
        self.least = 0 if cells else _worth_a_machine(self.comm)
        self.cells = cells or _worth_a_rank(self.comm)
        self._made = {}

    def number(self, grid):
        """How many ranks a grid is worth, see `worth`. Not collective."""
        return worth(grid, self.size, self.cells, self.first_machine, self.least)

    def deal(self, grid, size=None):
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
        size = size or self.number(grid)
        return Slabs(grid.ny, size, self.rank, aligned(grid.ny, size))

    def first(self, size):
        """Communicator of the first ranks; None if this is the only one, or none of them. Collective over these."""
        if size == 1 or self.rank >= size:
            return None
        if size == self.size:
            return self.comm
        if size not in self._made:
            self._made[size] = self.comm.first(size)
        return self._made[size]

    def beyond(self, size):
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


def worth(grid, size, cells, first_machine=1, least=0):
    """How many of `size` ranks a grid is worth: all, those of the first machine, or a power of two. Not collective.

    Each has so many cells at least, and a row; of the first `first_machine` ranks `_CELLS_INSIDE`.
    More of them, on several machines, are more than `least`. Coarser grids, and windows, are never worth more.
    """
    most, inside = (min(grid.n // each, grid.ny) for each in (cells, _CELLS_INSIDE))
    number = size if most >= size else _power_of_two(most)
    if number > max(first_machine, least):
        return number
    return first_machine if inside >= first_machine else _power_of_two(inside)


def _power_of_two(most):
    return 1 << (max(most, 1).bit_length() - 1)


def worth_solving(grid, comm, cells=0):
    """How many ranks should solve on a target grid: all, or the first machine's, if it is not worth another.

    Collective over `comm`, a `Communicator`. All if `cells` per rank are asked for.
    """
    first_machine = comm.size if cells else comm.first_machine
    if first_machine < comm.size:
        known = grid, comm.size, _worth_a_rank(comm), first_machine
        # What another machine costs is asked last, as it takes longest.
        if worth(*known) <= first_machine or worth(*known, _worth_a_machine(comm)) <= first_machine:
            return first_machine
    return comm.size


def aligned(ny, size):
    """Rows that slabs should start at multiples of: the largest power of two that costs next to no balance.

    Not collective. Slabs of a grid and of the next coarser one then mostly fit.
    """
    block = 1
    while 32 * block * size <= ny:
        block *= 2
    return block


def _worth_a_rank(comm):
    """Cells from which on a rank pays that is on any machine. Collective when first asked for."""
    return max(_CELLS_INSIDE, 1 << round(np.log2(max(_CELLS_PER_SECOND * comm.latency, 1.0))))


def _worth_a_machine(comm):
    """Ranks from which on more machines pay: it takes less to send what they share than it saves to compute it.

    Collective when first asked for. With b s for a byte, r bytes for a s of computing, n ranks on the first machine:
    b r / P < 1 / n - 1 / P.
    """
    if comm.first_machine == comm.size:
        return 0
    return comm.first_machine * (1 + _BYTES_PER_SECOND * comm.byte_seconds)
