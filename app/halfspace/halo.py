"""Rows beside a slab of a periodic grid: the neighbours', or those from the other end of the patch."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI


class Halo:
    """Fetches some rows before and after this rank's, over the period, from whatever ranks have them.

    Parameters
    ----------
    slabs : Slabs
    comm : mpi4py communicator or None
        Ranks that share the rows; None if all are here.
    width : int
        Rows on either side.
    """

    def __init__(self, slabs, comm, width):
        self.comm = comm if comm is not None and comm.size > 1 else None
        self._here = self._wanted(slabs, width, slabs.rank)
        if self.comm is None:
            return
        ranks = [rank for rank in range(comm.size) if rank != comm.rank]
        first, last = slabs.rows.start, slabs.rows.stop
        self._sent, self._got = {}, {}
        for rank in ranks:
            rows = self._wanted(slabs, width, rank)
            mine = rows[(rows >= first) & (rows < last)] - first
            if mine.size:
                self._sent[rank] = mine
            a, b = slabs.starts[rank], slabs.starts[rank + 1]
            theirs = np.flatnonzero((self._here >= a) & (self._here < b))
            if theirs.size:
                self._got[rank] = theirs
        self._own = np.flatnonzero((self._here >= first) & (self._here < last))
        self._own_rows = self._here[self._own] - first

    @staticmethod
    def _wanted(slabs, width, rank):
        """Rows of the grid that a rank asks for: those before its own, then those after them."""
        first, last = slabs.starts[rank], slabs.starts[rank + 1]
        if first == last:
            return np.empty(0, int)
        return np.concatenate([np.arange(first - width, first), np.arange(last, last + width)]) % slabs.ny

    def __call__(self, field):
        """Fetch the rows of a field.

        Collective.

        Parameters
        ----------
        field : ndarray, shape (local rows, columns)

        Returns
        -------
        before, after : ndarray, shape (width, columns)
            Of the field's type; without rows if there are none here.
        """
        if self.comm is None:
            rows = field[self._here]
        else:
            rows = np.empty((self._here.size, field.shape[1]), field.dtype)
            parcels = [(rank, field[mine]) for rank, mine in self._sent.items()]
            requests = [self.comm.Isend(parcel, rank) for rank, parcel in parcels]
            rows[self._own] = field[self._own_rows]
            for rank, places in self._got.items():
                arrived = np.empty((places.size, field.shape[1]), field.dtype)
                self.comm.Recv(arrived, rank)
                rows[places] = arrived
            MPI.Request.Waitall(requests)
        half = len(rows) // 2
        return rows[:half], rows[half:]


def row_before(field, periodic, slabs, comm, beyond):
    """Row before the first one of this rank.

    Collective. Before the first of a periodic patch comes its last one, of a free patch a row of the value `beyond`.

    Parameters
    ----------
    field : ndarray, shape (local rows, nx)
    periodic : bool
    slabs : Slabs or None
        None: all rows are here.
    comm : mpi4py communicator or None
    beyond : number

    Returns
    -------
    ndarray, shape (nx,)
    """
    row = np.full(field.shape[1], beyond, field.dtype)
    owners = [rank for rank, count in enumerate(slabs.counts) if count] if slabs else [0]
    if not len(field):
        return row
    if len(owners) == 1:
        return field[-1].copy() if periodic else row
    place = owners.index(slabs.rank)
    before, after = owners[place - 1], owners[(place + 1) % len(owners)]
    if not periodic:
        before = before if place else MPI.PROC_NULL
        after = after if after > slabs.rank else MPI.PROC_NULL
    comm.Sendrecv(field[-1].copy(), after, recvbuf=row, source=before)
    return row
