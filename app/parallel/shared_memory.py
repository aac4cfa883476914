"""Working storage of products; ranks on one machine see each other's, so that they need not send what is in it.

The parts of all ranks lie in one file without a name (memfd). It goes with the last array that shows it, however a rank
ends: nobody has to free it, together with the others or at all.
"""

from __future__ import annotations

import mmap
import os
import secrets
from contextlib import suppress
from pathlib import Path

import numpy as np

from app.base.mpi import MPI


class Storage:
    """Bytes to work in, of this rank, and where ranks share memory those of all of them.

    Collective over `comm`.

    Parameters
    ----------
    sizes : sequence of int
        Bytes of each rank.
    rank : int
    comm : mpi4py communicator or None
        Ranks of a `Communicator` share memory, if they may; None: this rank has all rows, or none.

    Attributes
    ----------
    own : ndarray of uint8
    all : ndarray of uint8 or None
        Those of all ranks, of rank q from ``starts[q]`` on; None if they do not share memory.
    """

    def __init__(self, sizes, rank, comm):
        self._sizes = tuple(sizes)
        pages = [-(-size // mmap.PAGESIZE) for size in self._sizes]
        self.starts = mmap.PAGESIZE * np.concatenate([[0], np.cumsum(pages, dtype=np.int64)])
        self.all = None if comm is None else _memory_of_all(comm, int(self.starts[-1]))
        size = self._sizes[rank] if rank < len(self._sizes) else 0
        self.own = np.zeros(size, np.uint8) if self.all is None else self.all[self.starts[rank] :][:size]

    def suits(self, sizes):
        """Whether there is as much for a product; the same on all ranks. Not collective."""
        return len(sizes) <= len(self._sizes) and all(map(int.__le__, sizes, self._sizes))


def _memory_of_all(comm, size):
    """So many bytes, zero, that all ranks see; None if they are on several machines or may not. Collective."""
    if not (getattr(comm, "shares_memory", False) and size and comm.single_node):
        return None
    file, found, place, name = -1, None, None, None
    if comm.rank == 0:
        with suppress(AttributeError, OSError):  # not on Linux; forbidden
            file = os.memfd_create(f"contact-{secrets.token_hex(8)}")
            os.ftruncate(file, size)
            place = Path(f"/proc/{os.getpid()}/fd/{file}")
            name = place.readlink()
    place, name = comm.bcast((place, name))
    with suppress(
        OSError, ValueError
    ):  # another container, in which that is another file; too little address space
        if comm.rank > 0 and name and place.readlink() == name:
            file = os.open(place, os.O_RDWR)
        if file >= 0:
            found = np.frombuffer(mmap.mmap(file, size), np.uint8)
    everybody = comm.allreduce(found is not None, MPI.LAND)
    if file >= 0:
        os.close(file)
    return found if everybody else None
