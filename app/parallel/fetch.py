"""Redistribution of rows from one layout to another, point to point."""

import numpy as np

from app.parallel.slabs import none_if_single


class Fetch:
    """Exchange of rows, with at most one message per pair of ranks.

    Parameters
    ----------
    have : Slabs
        Layout in which the rows are before the exchange; it may have fewer ranks than `comm`.
    want : sequence of (first, last)
        Pairs of integer arrays with an entry for each rank of `comm`: the rank wants the rows ``first <= j < last`` of
        each pair, one pair after the other. Row numbers outside the grid mean rows of a periodic grid, counted modulo
        its period.
    comm : mpi4py communicator or None
        Communicator of all ranks that take part; None if this rank has all rows.
    """

    def __init__(self, have, want, comm=None):
        self._comm, self.have = none_if_single(comm), have
        self._sources, self._targets = {}, {}  # by rank: slices of rows to send, and of wanted rows to fill
        self.rows = 0  # number of rows that this rank wants
        for first, last in want:
            if self._comm is None:
                self._plan_serial(int(np.max(first)), int(np.max(last)))
            else:
                self._plan(*(np.broadcast_to(rows, comm.size) for rows in (first, last)))
        rank = 0 if self._comm is None else have.rank
        self._own = self._sources.pop(rank, []), self._targets.pop(rank, [])
        everything = [slice(0, have.local)]
        self.unchanged = self._own == (everything, everything) and self.rows == have.local
        self.unchanged &= not (self._sources or self._targets)
        self.unchanged |= not (self.rows or have.local)

    def _plan(self, first, last):
        """Plan messages that bring each rank r the rows first[r] to last[r]-1."""
        ny, rank = self.have.ny, self.have.rank
        starts, ends = self.have.bounds(len(first))
        nonempty = last > first
        low, high = (first[nonempty].min(), last[nonempty].max()) if nonempty.any() else (0, 0)
        for shift in range(low // ny * ny, high, ny):  # one period after the other
            offset = shift + starts[rank]
            for other, a, b in _overlaps(first, last, offset, ends[rank] + shift):
                self._sources.setdefault(other, []).append(slice(a - offset, b - offset))
            offset = first[rank] - self.rows
            for other, a, b in _overlaps(starts + shift, ends + shift, first[rank], last[rank]):
                self._targets.setdefault(other, []).append(slice(a - offset, b - offset))
        self.rows += max(int(last[rank] - first[rank]), 0)

    def _plan_serial(self, first, last):
        """Plan the copies on a single rank; this avoids slow small arrays."""
        ny = self.have.ny
        for shift in range(first // ny * ny, last, ny) if last > first else ():
            a, b = max(first, shift), min(last, shift + ny)
            self._sources.setdefault(0, []).append(slice(a - shift, b - shift))
            self._targets.setdefault(0, []).append(slice(self.rows + a - first, self.rows + b - first))
        self.rows += max(last - first, 0)

    def __call__(self, field, out=None):
        """Fetch the wanted rows of a field. Collective.

        Return `out`, shape (rows wanted, columns), or a new array if `out` is None. If each rank already has exactly
        the rows that it wants, return the field itself, without a copy.
        """
        if self.unchanged:
            return field
        result = np.empty((self.rows, field.shape[1]), field.dtype) if out is None else out
        requests = []
        for rank, rows in self._sources.items():
            parcel = field[rows[0]] if len(rows) == 1 else np.concatenate([field[k] for k in rows])
            requests.append(self._comm.Isend(np.ascontiguousarray(parcel), rank))
        for source, target in zip(*self._own, strict=True):
            result[target] = field[source]
        for rank, targets in self._targets.items():
            if len(targets) == 1:
                self._comm.Recv(result[targets[0]], rank)
                continue
            ends = np.cumsum([target.stop - target.start for target in targets])
            parcel = np.empty((ends[-1], field.shape[1]), field.dtype)
            self._comm.Recv(parcel, rank)
            for target, rows in zip(targets, np.split(parcel, ends[:-1]), strict=True):
                result[target] = rows
        for request in requests:
            request.Wait()
        return result


def _overlaps(low, high, first, last):
    """Yield index, start and end of each overlap with an interval.

    The arrays `low` and `high` are starts and ends of many intervals; each may overlap the interval [first, last).
    """
    low, high = np.maximum(low, first), np.minimum(high, last)
    for index in np.flatnonzero(low < high):
        yield int(index), int(low[index]), int(high[index])
