"""Messages of a sweep on several ranks.

A leaf is a block of rows. Rank 0 solves one leaf after the other, and adds the effect of a solved leaf on the next one.
The effects on leaves further away (transfers, see `app.halfspace.gauss_seidel.gauss_seidel`) are computed by the other
ranks, each for some frequencies. A leaf does not need the transfers of the leaf just before it, so transfers run while
rank 0 solves:

    rank 0      ... solve 7    solve 8    solve 9  ...        needs for leaf m: effects of leaves up to m - 2
    others      ... transfers  transfers  transfers           have after leaf m: transfers to leaf m + 2 and later
                    of 6       of 7       of 8

The ranks that own the rows of a leaf send the defect to rank 0, and receive the correction. All messages are point to
point. Rank 0 waits for transfers from the other ranks, and the other ranks wait for solved leaves.
"""

import itertools

import numpy as np

from app.base.mpi import MPI

_DEFECT, _CORRECTION, _EFFECT, _SOLVED = range(1, 5)  # tags


def deal_chunks(weights, ranks):
    """Deal chunks of frequencies to ranks for equal work.

    `weights` are the work of each chunk, `ranks` the number of ranks. Return a pair for each rank: the first chunk, and
    the chunk after the last. Rank 0 gets no chunks if there are several ranks.
    """
    helpers = max(ranks - 1, 1)
    middle = (np.cumsum(weights) - np.asarray(weights) / 2) / max(np.sum(weights), 1)
    inner = np.searchsorted(middle, np.arange(1, helpers) / helpers)
    edges = [0, *(int(edge) for edge in inner), len(weights)]
    return [(0, 0)] * (ranks - helpers) + list(itertools.pairwise(edges))


class SweepMessages:
    """Messages of one sweep, point to point.

    A leaf is a block of rows, a chunk a group of frequencies. `edges` are the first and the end chunk of each rank,
    from `deal_chunks`. `leaves` has the slice of rows of each leaf, or None for a leaf without contact. `r` and `d` are
    defect and correction on the rows of this rank, contiguous arrays of float64.
    """

    def __init__(self, comm, slabs, edges, leaves, r, d):
        self._comm, self._edges, self._r, self._d = comm, edges, r, d
        self._starts, self._leaves = slabs.starts, leaves
        self._sent = []  # requests, with arrays that must not change until these are complete
        self._effects = {}  # requests by leaf
        if comm.rank:
            start = slabs.rows.start
            for leaf in filter(None, leaves):
                for owner, rows, _ in self._parts(leaf):
                    if owner == comm.rank:
                        local = slice(rows.start - start, rows.stop - start)
                        self._sent.append((comm.Isend(r[local], 0, _DEFECT), r))
                        self._sent.append((comm.Irecv(d[local], 0, _CORRECTION), d))

    def _parts(self, leaf, field=None):
        """Yield the ranks that own rows of a leaf, and their rows.

        `leaf` is the slice of the leaf's rows. `field` is an array on the rows of the leaf, or None. Yield as third
        value its part on the rows of the rank, or None.
        """
        for owner, (first, last) in enumerate(itertools.pairwise(self._starts)):
            a, b = max(first, leaf.start), min(last, leaf.stop)
            if a < b:
                part = None if field is None else field[a - leaf.start : b - leaf.start]
                yield owner, slice(a, b), part

    # -- rank 0 --------------------------------------------------------------------------------------------

    def fields(self, m):
        """Return the defect on leaf m, and an array for its correction."""
        leaf = self._leaves[m]
        if leaf.stop <= self._starts[1]:
            return self._r[leaf], self._d[leaf]
        r = np.empty((leaf.stop - leaf.start, self._r.shape[1]))
        for owner, rows, part in self._parts(leaf, r):
            if owner:
                self._comm.Recv(part, owner, _DEFECT)
            else:
                part[...] = self._r[rows]
        return r, np.zeros_like(r)

    def send_back(self, m, d):
        """Send the correction d of leaf m to the owners of its rows."""
        leaf = self._leaves[m]
        if leaf.stop <= self._starts[1]:
            return
        for owner, rows, part in self._parts(leaf, d):
            if owner:
                self._sent.append((self._comm.Isend(part, owner, _CORRECTION), d))
            else:
                self._d[rows] = part

    def collect(self, block):
        """Receive into `block` the effects of earlier leaves from other ranks."""
        for rank, (first, last) in enumerate(self._edges):
            if rank and first < last:
                self._comm.Recv(block[first:last], rank, _EFFECT)

    def deal(self, block):
        """Send other ranks their frequencies of a solved leaf.

        `block` has the rows of the leaf, transformed in x, by chunks of frequencies. Wait until the messages are sent,
        because MPI may progress messages only inside of its calls.
        """
        parts = [(rank, block[slice(*edges)]) for rank, edges in enumerate(self._edges) if rank]
        MPI.Request.Waitall([self._comm.Isend(part, rank, _SOLVED) for rank, part in parts if len(part)])

    # -- other ranks ---------------------------------------------------------------------------------------

    def send_effects(self, m, block):
        """Send `block`, the effects of earlier leaves on leaf m, to rank 0."""
        self._effects[m] = self._comm.Isend(block, 0, _EFFECT)

    def receive_solved(self, m, block):
        """Receive the solved leaf m into `block`, replacing the effects on it."""
        if m in self._effects:
            self._effects.pop(m).Wait()
        self._comm.Recv(block, 0, _SOLVED)

    def finish(self):
        """Wait until all messages of the sweep are complete."""
        MPI.Request.Waitall([request for request, _ in self._sent])
