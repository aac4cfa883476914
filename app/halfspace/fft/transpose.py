"""The all-to-all between slabs of rows and columns dealt to the ranks, a group of columns at a time.

Ranks that share memory (`app.parallel.shared_memory`) send nothing: each works on its columns where the others
keep them.
"""

from __future__ import annotations

import itertools

import numpy as np

from app.halfspace import events
from app.halfspace.fft.strips import STRIP

_GROUP_BYTES = 1 << 22  # what a rank sends at once, at most about


def deal_columns(columns, row_counts, comm):
    """Split columns into groups, each dealt to all ranks; the same in all precisions. Not collective.

    Parameters
    ----------
    columns : int
    row_counts : sequence of int
        Rows of each rank.
    comm : mpi4py communicator or None
        The ranks; None: this one alone.

    Returns
    -------
    list of ColumnGroup
    """
    if comm is None:
        return [ColumnGroup(0, columns, 1, 0, row_counts)]
    column = max(row_counts) * np.dtype(complex).itemsize
    batches = comm.size * STRIP  # all ranks busy, with no batch half empty
    width = max(1, _GROUP_BYTES // (column * batches)) * batches
    edges = [*range(0, columns, width), columns]
    return [ColumnGroup(a, b, comm.size, comm.rank, row_counts) for a, b in itertools.pairwise(edges)]


class ColumnGroup:
    """Columns [start, stop) dealt to `size` ranks, and the all-to-all that deals them.

    On either side lie the strips of one rank after those of the other. What a rank would send to itself stays there.
    """

    def __init__(self, start, stop, size, rank, row_counts):
        per_rank = [(stop - start) // size + (r < (stop - start) % size) for r in range(size)]
        self.edges = [int(edge) for edge in start + np.concatenate([[0], np.cumsum(per_rank)])]
        self.mine = slice(self.edges[rank], self.edges[rank + 1])
        row_edges = np.concatenate([[0], np.cumsum(row_counts)])
        self.row_ranges = [(int(a), int(b)) for a, b in itertools.pairwise(row_edges)]
        self._columns, self._rows, self.rank = per_rank[rank], row_counts[rank], rank
        starts = self._rows * (np.array(self.edges[:-1]) - start)
        sent = np.array(per_rank) * self._rows
        got = np.array(row_counts) * self._columns
        sent[rank] = got[rank] = 0
        self._by_column = sent, starts
        self._by_row = got, np.concatenate([[0], np.cumsum(got)[:-1]])
        self.heights, self.places = np.array(row_counts), self._by_row[1]
        self.to_receive = int(got.sum())

    def part(self, transformed):
        """What is dealt, in the array of all groups."""
        return transformed[self._rows * self.edges[0] : self._rows * self.edges[-1]]

    def own(self, part):
        """What this rank has of its own columns."""
        first = self._rows * (self.mine.start - self.edges[0])
        return part[first : first + self._rows * self._columns]

    def pieces(self, transformed):
        """First column of each rank, one past its last, and the strips that are sent to it."""
        return [
            (a, b, transformed[self._rows * a : self._rows * b]) for a, b in itertools.pairwise(self.edges)
        ]

    def deal(self, comm, part, received):
        """Get the columns of this rank: the strips with the rows of rank q, for each rank q. Collective."""
        own = self.own(part)
        if comm is None:
            return [own]
        self.fetch(comm, part, received)
        spans = zip(*self._by_row, strict=True)
        return [
            own if rank == self.rank else received[start : start + count]
            for rank, (count, start) in enumerate(spans)
        ]

    def fetch(self, comm, part, received):
        """Receive what others have of the columns of this rank. Collective."""
        with events.alltoall:
            comm.Alltoallv([part, self._by_column], [received, self._by_row])

    def give_back(self, comm, part, received):
        """Send back what `fetch` got. Collective."""
        with events.alltoall:
            comm.Alltoallv([received, self._by_row], [part, self._by_column])


class Exchange:
    """The columns of this rank, in between rows of a product and rows again. Of one rank, which has all rows.

    Collective.

    Parameters
    ----------
    groups : list of ColumnGroup
    transformed : ndarray of complex
        Strips of the rows here.

    Attributes
    ----------
    memory : int
        Bytes beside those of the rows.
    """

    memory = 0

    def __init__(self, groups, transformed):
        self._groups, self._parts = groups, [group.part(transformed) for group in groups]
        self._columns = [
            (own, *self._others(own, group), group.heights, group.rank)
            for group, own in (
                (group, group.own(part)) for group, part in zip(groups, self._parts, strict=True)
            )
        ]

    def _others(self, own, group):
        return own, group.places

    def each(self):
        """Iterate over what `app.halfspace.fft.strips.convolve_columns` works on, of each group, to the end.

        Columns are at hand until the next ones are asked for; then their rows are back where they were.
        """
        return self._columns


class SentExchange(Exchange):
    """Columns are sent, and sent back."""

    def __init__(self, groups, transformed, comm):
        self._comm = comm
        self._received = np.zeros(max(group.to_receive for group in groups), transformed.dtype)
        self.memory = self._received.nbytes
        super().__init__(groups, transformed)

    def _others(self, own, group):
        return self._received, group.places

    def each(self):
        """See `Exchange.each`."""
        for columns, group, part in zip(self._columns, self._groups, self._parts, strict=True):
            group.fetch(self._comm, part, self._received)
            yield columns
            group.give_back(self._comm, part, self._received)


class SharedExchange(Exchange):
    """Columns stay in the memory of all ranks; these wait for each other before and after."""

    def __init__(self, groups, transformed, comm, storage):
        self._comm = comm
        self._all = storage.all.view(transformed.dtype)
        self._starts = storage.starts[: comm.size] // transformed.itemsize
        super().__init__(groups, transformed)

    def _others(self, own, group):
        return self._all, self._starts + group.heights * group.mine.start

    def each(self):
        """See `Exchange.each`."""
        with events.alltoall:
            self._comm.exchange_barrier()
        yield from self._columns
        with events.alltoall:
            self._comm.exchange_barrier()
