"""A sweep on several ranks: rank 0 solves leaf after leaf, the others compute what solved leaves add to later ones.

Only rows one after the other are sequential, and what they add to their own leaf and the next. Everything else, the
transfers of `app.halfspace.gauss_seidel.sweep`, is dealt to the ranks by frequencies. A leaf needs them from the last
leaf but one, so they run while rank 0 solves:

    rank 0      ... solve 7    solve 8    solve 9  ...        needs for leaf m: what leaves up to m - 2 add to it
    others      ... transfers  transfers  transfers           have after leaf m: transfers that begin at leaf m + 2
                    of 6       of 7       of 8

Whoever owns the rows of a leaf sends the defect to rank 0 and gets the correction. Nothing is collective, nobody waits
but rank 0 for what others add, and they for solved leaves.
"""

from __future__ import annotations

import itertools

import numpy as np

from app.base.mpi import MPI

_DEFECT, _CORRECTION, _ADDED, _SOLVED = range(1, 5)  # tags


def deal_chunks(weights, ranks):
    """Deal chunks of frequencies to the ranks, by the work they make: all but rank 0, if there are several.

    Returns
    -------
    list of (int, int)
        First of each rank, and one past its last.
    """
    helpers = max(ranks - 1, 1)
    middle = (np.cumsum(weights) - np.asarray(weights) / 2) / max(np.sum(weights), 1)
    inner = np.searchsorted(middle, np.arange(1, helpers) / helpers)
    edges = [0, *(int(edge) for edge in inner), len(weights)]
    return [(0, 0)] * (ranks - helpers) + list(itertools.pairwise(edges))


class Flow:
    """Messages of one sweep.

    Not collective: ranks talk two by two.

    Parameters
    ----------
    comm : mpi4py communicator
    slabs : Slabs
        Whose rows are whose.
    edges : list of (int, int)
        Chunks of each rank, see `deal_chunks`.
    leaves : list of slice
        Rows of the leaves that have contact, by number; None for others.
    r, d : ndarray, shape (local rows, nx)
        Defect and correction; of float64, contiguous.
    """

    def __init__(self, comm, slabs, edges, leaves, r, d):
        self._comm, self._edges, self._r, self._d = comm, edges, r, d
        self._starts, self._leaves = slabs.starts, leaves
        self._sent = []  # requests, and what must not change until they are done
        self._added = {}  # requests by leaf
        if comm.rank:
            start = slabs.rows.start
            for leaf in filter(None, leaves):
                for owner, rows in self._parts(leaf):
                    if owner == comm.rank:
                        mine = slice(rows.start - start, rows.stop - start)
                        self._sent.append((comm.Isend(r[mine], 0, _DEFECT), r))
                        self._sent.append((comm.Irecv(d[mine], 0, _CORRECTION), d))

    def _parts(self, leaf):
        """Yield (owner, rows) of a leaf."""
        for owner, (first, last) in enumerate(itertools.pairwise(self._starts)):
            rows = slice(max(first, leaf.start), min(last, leaf.stop))
            if rows.start < rows.stop:
                yield owner, rows

    # -- rank 0 --------------------------------------------------------------------------------------------

    def fields(self, m):
        """Return defect and correction of leaf m, from its owners; the latter is to be filled in, and `send_back`."""
        leaf = self._leaves[m]
        if leaf.stop <= self._starts[1]:
            return self._r[leaf], self._d[leaf]
        r = np.empty((leaf.stop - leaf.start, self._r.shape[1]))
        for owner, rows in self._parts(leaf):
            here = r[rows.start - leaf.start : rows.stop - leaf.start]
            if owner:
                self._comm.Recv(here, owner, _DEFECT)
            else:
                here[...] = self._r[rows]
        return r, np.zeros_like(r)

    def send_back(self, m, d):
        """Give the correction on leaf m to its owners."""
        leaf = self._leaves[m]
        if leaf.stop <= self._starts[1]:
            return
        for owner, rows in self._parts(leaf):
            here = d[rows.start - leaf.start : rows.stop - leaf.start]
            if owner:
                self._sent.append((self._comm.Isend(here, owner, _CORRECTION), d))
            else:
                self._d[rows] = here

    def collect(self, block):
        """Receive what is added to a leaf, all chunks of it."""
        for rank, (first, last) in enumerate(self._edges):
            if rank and first < last:
                self._comm.Recv(block[first:last], rank, _ADDED)

    def deal(self, block):
        """Send a solved leaf. They wait for it: so it is taken at once, also where nothing moves in the background."""
        MPI.Request.Waitall(
            [
                self._comm.Isend(block[first:last], rank, _SOLVED)
                for rank, (first, last) in enumerate(self._edges)
                if rank and first < last
            ]
        )

    # -- the others ----------------------------------------------------------------------------------------

    def add(self, m, block):
        """Send what is added to leaf m."""
        self._added[m] = self._comm.Isend(block, 0, _ADDED)

    def take(self, m, block):
        """Receive leaf m, solved, where there was what is added to it."""
        if m in self._added:
            self._added.pop(m).Wait()
        self._comm.Recv(block, 0, _SOLVED)

    def finish(self):
        """Wait for what is still on its way."""
        MPI.Request.Waitall([request for request, _ in self._sent])
