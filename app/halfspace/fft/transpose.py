"""Distributed transpose: from slabs of rows to columns dealt to ranks.

The transpose is done for one group of columns at a time. Ranks that share memory (`app.parallel.shared_memory`) send
nothing: each rank reads and writes its columns where the other ranks store them.
"""

import itertools

import numpy as np

from app.halfspace import events
from app.halfspace.fft.strips import STRIP

_GROUP_BYTES = 1 << 22  # sent by a rank at once, approximately


def deal_columns(columns, row_counts, comm):
    """Return all columns in `ColumnGroup`s, the same in single and double precision."""
    if comm is None:
        return [ColumnGroup(0, columns, 1, 0, row_counts)]
    column = max(row_counts) * np.dtype(complex).itemsize
    batches = comm.size * STRIP  # so that all ranks have full batches
    width = max(1, _GROUP_BYTES // (column * batches)) * batches
    edges = [*range(0, columns, width), columns]
    return [ColumnGroup(a, b, comm.size, comm.rank, row_counts) for a, b in itertools.pairwise(edges)]


class ColumnGroup:
    """Group of columns that are dealt to ranks by one all-to-all.

    The columns are `start` to `stop` - 1. In the buffers, strips are ordered by rank. Own columns are not moved.
    """

    def __init__(self, start, stop, size, rank, row_counts):
        per_rank = [(stop - start) // size + (r < (stop - start) % size) for r in range(size)]
        self.edges = [int(edge) for edge in start + np.concatenate([[0], np.cumsum(per_rank)])]
        self.columns = slice(self.edges[rank], self.edges[rank + 1])  # columns of this rank
        self.count = per_rank[rank]
        row_edges = np.concatenate([[0], np.cumsum(row_counts)])
        self.row_ranges = [(int(a), int(b)) for a, b in itertools.pairwise(row_edges)]
        self._rows, self.rank = row_counts[rank], rank
        sent = np.array(per_rank) * self._rows
        received = np.array(row_counts) * self.count
        sent[rank] = received[rank] = 0
        self._by_column = sent, self._rows * (np.array(self.edges[:-1]) - start)
        self._by_row = received, np.concatenate([[0], np.cumsum(received)[:-1]])
        self.heights, self.places = np.array(row_counts), self._by_row[1]
        self.to_receive = int(received.sum())

    def part(self, transformed):
        """Return this group's strips from `transformed`, the strips of all groups."""
        return transformed[self._rows * self.edges[0] : self._rows * self.edges[-1]]

    def own(self, part):
        """Return this rank's own columns in its `part`; they are not sent."""
        first = self._rows * (self.columns.start - self.edges[0])
        return part[first : first + self._rows * self.count]

    def pieces(self, transformed):
        """Return (first column, end column, strips) for each rank that owns columns."""
        spans = itertools.pairwise(self.edges)
        return [(a, b, transformed[self._rows * a : self._rows * b]) for a, b in spans]

    def deal(self, comm, part, received):
        """Exchange columns; return this rank's columns. Collective.

        The list has, for each rank, the strips of its rows in the columns of this rank.
        """
        own = self.own(part)
        if comm is None:
            return [own]
        self.fetch(comm, part, received)
        dealt = [received[start : start + count] for count, start in zip(*self._by_row, strict=True)]
        dealt[self.rank] = own
        return dealt

    def fetch(self, comm, part, received):
        """Receive this rank's columns from the other ranks. Collective."""
        with events.alltoall:
            comm.Alltoallv([part, self._by_column], [received, self._by_row])

    def send_back(self, comm, part, received):
        """Send back the columns that `fetch` received. Collective."""
        with events.alltoall:
            comm.Alltoallv([received, self._by_row], [part, self._by_column])


class Exchange:
    """Exchange of columns of `transformed`, before and after their convolution. Collective."""

    def __init__(self, groups, transformed, comm, storage):
        self._groups, self._comm, self._received = groups, comm, None
        self._parts = [group.part(transformed) for group in groups]
        shared = comm is not None and storage.all is not None
        if shared:
            starts = storage.starts[: comm.size] // transformed.itemsize
        elif comm is not None:
            self._received = np.zeros(max(group.to_receive for group in groups), transformed.dtype)
        self._columns = []
        for group, part in zip(groups, self._parts, strict=True):
            own = group.own(part)
            others, places = own if comm is None else self._received, group.places
            if shared:
                others, places = storage.all.view(own.dtype), starts + group.heights * group.columns.start
            self._columns.append((own, others, places, group.heights, group.rank))

    def each(self):
        """Yield arguments of `strips.convolve_columns` for each group.

        The iteration must be completed: the columns of a group are sent back when the next group is requested.
        """
        if self._comm is None:
            return self._columns
        return self._each_shared() if self._received is None else self._each_sent()

    def _each_sent(self):
        for columns, group, part in zip(self._columns, self._groups, self._parts, strict=True):
            group.fetch(self._comm, part, self._received)
            yield columns
            group.send_back(self._comm, part, self._received)

    def _each_shared(self):
        with events.alltoall:
            self._comm.exchange_barrier()
        yield from self._columns
        with events.alltoall:
            self._comm.exchange_barrier()
