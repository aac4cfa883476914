"""Rows that change place: point to point between any two layouts, and only between ranks that share some."""

from __future__ import annotations

import numpy as np

from app.parallel.slabs import none_if_single


class Fetch:
    """Brings every rank the rows it wants from the ranks that have them: point to point, one message for a pair.

    Parameters
    ----------
    have : Slabs
        Of the rows, which may have fewer ranks.
    want : sequence of (first, last)
        Arrays of integers, one for each rank of `comm`: rows ``first <= j < last``; beyond the grid those one period
        on. A rank gets those of all pairs, one after the other.
    comm : mpi4py communicator or None
        All ranks; None: this one alone.
    """

    def __init__(self, have, want, comm=None):
        self._comm, self.have = none_if_single(comm), have
        self._sent, self._got = {}, {}  # rank -> slices of the rows here, and of the rows wanted
        self.rows = 0  # wanted
        for first, last in want:
            if self._comm is None:
                self._find_alone(int(np.max(first)), int(np.max(last)))
            else:
                self._find(*(np.broadcast_to(rows, comm.size) for rows in (first, last)))
        here = 0 if self._comm is None else have.rank
        self._own = self._sent.pop(here, []), self._got.pop(here, [])
        everything = [slice(0, have.local)]
        self.unchanged = self._own == (everything, everything) and self.rows == have.local
        self.unchanged &= not (self._sent or self._got)
        self.unchanged |= not (self.rows or have.local)

    def _find(self, first, last):
        """Find who has what, where each rank wants rows ``first <= j < last``: two arrays."""
        ny, here = self.have.ny, self.have.rank
        starts, ends = self.have.bounds(len(first))
        some = last > first
        low, high = (first[some].min(), last[some].max()) if some.any() else (0, 0)
        for shift in range(low // ny * ny, high, ny):  # of one period after the other
            for rank, a, b in _overlaps(first, last, starts[here] + shift, ends[here] + shift):
                mine = slice(a - shift - starts[here], b - shift - starts[here])
                self._sent.setdefault(rank, []).append(mine)
            for rank, a, b in _overlaps(starts + shift, ends + shift, first[here], last[here]):
                place = slice(self.rows + a - first[here], self.rows + b - first[here])
                self._got.setdefault(rank, []).append(place)
        self.rows += max(int(last[here] - first[here]), 0)

    def _find_alone(self, first, last):
        """The same where this rank has all rows and wants ``first <= j < last``: done often, and so without arrays."""
        ny = self.have.ny
        for shift in range(first // ny * ny, last, ny) if last > first else ():
            a, b = max(first, shift), min(last, shift + ny)
            self._sent.setdefault(0, []).append(slice(a - shift, b - shift))
            self._got.setdefault(0, []).append(slice(self.rows + a - first, self.rows + b - first))
        self.rows += max(last - first, 0)

    def __call__(self, field, out=None):
        """Fetch rows of a field.

        Collective; only ranks that share something talk.

        Parameters
        ----------
        field : ndarray, shape (local rows, columns)
        out : ndarray, shape (rows wanted, columns), optional
            Where they go, unless the field itself is returned.

        Returns
        -------
        ndarray, shape (rows wanted, columns)
            The field itself if every row wanted is here already, in order.
        """
        if self.unchanged:
            return field
        found = np.empty((self.rows, field.shape[1]), field.dtype) if out is None else out
        parcels = [(rank, _packed(field, parts)) for rank, parts in self._sent.items()]
        requests = [self._comm.Isend(parcel, rank) for rank, parcel in parcels]
        for mine, place in zip(*self._own, strict=True):
            found[place] = field[mine]
        for rank, places in self._got.items():
            if len(places) == 1:
                self._comm.Recv(found[places[0]], rank)
                continue
            ends = np.cumsum([place.stop - place.start for place in places])
            parcel = np.empty((ends[-1], field.shape[1]), field.dtype)
            self._comm.Recv(parcel, rank)
            for place, rows in zip(places, np.split(parcel, ends[:-1]), strict=True):
                found[place] = rows
        for request in requests:
            request.Wait()
        return found


def _overlaps(low, high, first, last):
    """Yield number, first row and one past the last of what intervals low <= j < high, two arrays, share with one."""
    low, high = np.maximum(low, first), np.minimum(high, last)
    for number in np.flatnonzero(low < high):
        yield int(number), int(low[number]), int(high[number])


def _packed(field, parts):
    if len(parts) == 1:
        return np.ascontiguousarray(field[parts[0]])
    return np.concatenate([field[part] for part in parts])
