"""Work arrays that the ranks of a node share.

The parts of all ranks are in one anonymous file (memfd). The operating system frees the file when no array maps it any
more, even if a rank is killed.
"""

import mmap
import os
import secrets
from contextlib import suppress
from pathlib import Path

import numpy as np

from app.base.mpi import MPI


class Storage:
    """Work array that the ranks of a node share if possible. Collective.

    Parameters
    ----------
    sizes : sequence of int
        Number of bytes for each rank.
    rank : int
        Number of this rank; a rank without an entry in `sizes` has no bytes.
    comm : Communicator, mpi4py communicator or None
        The ranks that use the array. They share memory only if this is a `Communicator`. None if this rank has all
        rows, or none.

    Attributes
    ----------
    own : ndarray of uint8
        Bytes of this rank.
    all : ndarray of uint8, or None
        Bytes of all ranks; the bytes of rank q begin at ``starts[q]``. None if the ranks do not share memory.
    """

    def __init__(self, sizes, rank, comm):
        pages = [-(-size // mmap.PAGESIZE) for size in sizes]
        self.starts = mmap.PAGESIZE * np.concatenate([[0], np.cumsum(pages, dtype=np.int64)])
        self.all = None if comm is None else _map_shared(comm, int(self.starts[-1]))
        size = sizes[rank] if rank < len(sizes) else 0
        self.own = np.zeros(size, np.uint8) if self.all is None else self.all[self.starts[rank] :][:size]


def _map_shared(comm, size):
    """Return `size` bytes of shared memory, or None. Collective."""
    if not (getattr(comm, "shares_memory", False) and size and comm.single_node):
        return None
    file, mapped, path, name = -1, None, None, None
    if comm.rank == 0:
        with suppress(AttributeError, OSError):  # not on Linux, or forbidden
            file = os.memfd_create(f"contact-{secrets.token_hex(8)}")
            os.ftruncate(file, size)
            path = Path(f"/proc/{os.getpid()}/fd/{file}")
            name = path.readlink()
    path, name = comm.bcast((path, name))
    with suppress(OSError, ValueError):  # too little address space, or a container where this is another file
        if comm.rank > 0 and name and path.readlink() == name:
            file = os.open(path, os.O_RDWR)
        if file >= 0:
            mapped = np.frombuffer(mmap.mmap(file, size), np.uint8)
    all_mapped = comm.allreduce(mapped is not None, MPI.LAND)
    if file >= 0:
        os.close(file)
    return mapped if all_mapped else None
