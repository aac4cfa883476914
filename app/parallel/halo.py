"""Rows beside a slab: the neighbours', on a periodic grid also those from the other end of the patch."""

from __future__ import annotations

import numpy as np

from app.parallel.fetch import Fetch


class _Beside:
    """Fetches rows beside those of this rank: two pairs of arrays say from where to where, for every rank."""

    def __init__(self, slabs, before, after, comm):
        self._fetch = Fetch(slabs, [before, after], comm)
        rank = 0 if comm is None else slabs.rank
        self._before = int(before[1][rank] - before[0][rank])

    def __call__(self, field):
        """Fetch the rows of a field.

        Collective.

        Parameters
        ----------
        field : ndarray, shape (local rows, columns)

        Returns
        -------
        before, after : ndarray, shape (at most so many, columns)
            Of the field's type; without rows if there are none here.
        """
        rows = self._fetch(field)
        return rows[: self._before], rows[self._before :]


class Halo(_Beside):
    """Fetches some rows before and after this rank's from whatever ranks have them.

    Parameters
    ----------
    slabs : Slabs
    comm : mpi4py communicator or None
        Ranks that share the rows; None if all are here.
    width : int
        Rows on either side.
    periodic : bool
        Over the period; else fewer at the ends of the patch.
    """

    def __init__(self, slabs, comm, width, periodic=True):
        first, last = slabs.bounds(1 if comm is None else comm.size)
        low, high = first - width, last + width
        if not periodic:
            low, high = np.maximum(low, 0), np.minimum(high, slabs.ny)
        some = last > first
        super().__init__(slabs, (np.where(some, low, first), first), (last, np.where(some, high, last)), comm)


class CoarseHalo(_Beside):
    """Fetches the coarse rows between which those of a slab lie, but for those that are here.

    Parameters
    ----------
    slabs : Slabs
        Of the fine rows; of the coarse ones: `Slabs.surround`, or over a period those of two rows each.
    comm : mpi4py communicator or None
    periodic : bool

    Attributes
    ----------
    first : int
        Number of the first one, which may be here, counted as `Slabs.surround` does: over a period, too, that made of
        the first two fine rows is the second one.
    """

    def __init__(self, slabs, comm, periodic=False):
        coarse = slabs.coarsen(2) if periodic else slabs.surround()
        size, rank = (1, 0) if comm is None else (comm.size, slabs.rank)
        (first, last), (begin, end) = slabs.bounds(size), coarse.bounds(size)
        low, high = first // 2 - periodic, (last - 1) // 2 + 3 - periodic
        high = high if periodic else np.minimum(high, coarse.ny)
        some = last > first
        super().__init__(coarse, (np.where(some, low, begin), begin), (end, np.where(some, high, end)), comm)
        self.first = int(low[rank]) + periodic


def fetch_row_before(field, periodic, slabs, comm, beyond):
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
    if comm is None:
        return field[-1] if periodic and len(field) else np.full(field.shape[1], beyond, field.dtype)
    first, last = slabs.bounds(comm.size)
    low = np.where(last > first, first - 1 if periodic else np.maximum(first - 1, 0), first)
    found = Fetch(slabs, [(low, first)], comm)(field)
    return found[0] if len(found) else np.full(field.shape[1], beyond, field.dtype)
