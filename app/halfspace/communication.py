"""The ranks of a solver and what they tell each other: communicators that count, and rows that change place.

Every grid, and every window of one, is dealt to as many ranks as it is worth: all, or the first few. So a rank has the
same number in every communicator here, and rows go point to point between any two layouts. A rank beyond has no rows
and takes no part; it hears of what was decided when it has rows again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from mpi4py import MPI

from app.errors import InputError
from app.halfspace.grid import Slabs
from app.petsc import log_messages, log_reduction

# A grid is worth another rank if that saves more than talking costs. Inside a machine that is so from this many cells
# a rank on, where a step of CG takes about 0.3 ms; between machines it is found by measuring the latency.
_CELLS_INSIDE = 8192
# A step waits for some 12 messages, and does 1e-9 s of work for a cell and a logarithm.
_CELLS_PER_SECOND = 4e8
_BYTES_PER_SECOND = 5e8  # sent in a solve for a second that a core computes, as replayed (docs/scaling.md)
_TRIAL_BYTES = 1 << 18  # that a rank sends, but a page to each other one at least
_TRIALS, _TRIAL_SECONDS = 6, 0.005  # at most; so long together, but for the first, which opens connections


@dataclass
class Traffic:
    """What a rank has sent so far; what all-to-alls leave where it is does not count."""

    messages: int = 0  # point to point, and in all-to-alls
    message_bytes: int = 0
    all_to_alls: int = 0
    small_collectives: int = 0  # reductions, broadcasts, gathers

    def since(self, before):
        """Return what has been added since a `copy`. Not collective."""
        return Traffic(*(getattr(self, f.name) - getattr(before, f.name) for f in fields(self)))

    def copy(self):
        """Return the counts as they are now. Not collective."""
        return self.since(Traffic())

    def count(self, messages, size):
        """Count messages and all of their bytes, for -log_view too. Not collective."""
        self.messages += messages
        self.message_bytes += size
        log_messages(messages, size)


class Communicator(MPI.Intracomm):
    """An mpi4py communicator that counts what goes through it.

    Parameters
    ----------
    comm : mpi4py communicator
        The same one, not another with its ranks.
    traffic : Traffic, optional
        Where to count.
    """

    def __new__(cls, comm=None, traffic=None):  # noqa: D102
        self = super().__new__(cls, comm)
        self.traffic = traffic or Traffic()
        return self

    def plain(self):
        """Return it as others know it, who ask for the type. Not collective."""
        return MPI.Intracomm(self)

    @cached_property
    def machine(self):
        """Communicator of the ranks on this machine. Collective when first asked for."""
        return self.plain().Split_type(MPI.COMM_TYPE_SHARED)

    @cached_property
    def near(self):
        """How many ranks are on the machine of rank 0, up to the first that is not. Collective when first asked for."""
        if self.machine.size == self.size:
            return self.size
        ours, here = self.Get_group(), self.machine.Get_group()
        [place] = MPI.Group.Translate_ranks(ours, [0], here)
        ours.Free()
        here.Free()
        return self.allgather(place != MPI.UNDEFINED).index(False)

    @cached_property
    def latency(self):
        """Seconds that a reduction takes between machines, about. Collective when first asked for, and the same there.

        0 on one machine, which is not measured, so that runs can be repeated.
        """
        if self.near == self.size:
            return 0.0
        last, slowest, found = np.zeros(1), np.zeros(1), []
        while len(found) < _TRIALS and sum(found[1:]) < _TRIAL_SECONDS:
            started = time.perf_counter()
            self.Allreduce(last, slowest, MPI.MAX)
            last[0] = time.perf_counter() - started
            found += [float(slowest[0])][: bool(slowest[0])]  # of the trial before
        return min(found)

    @cached_property
    def byte_seconds(self):
        """Seconds for a byte that a rank sends, while all send to all. Collective when first asked for."""
        part = max(_TRIAL_BYTES // self.size, 4096)
        counts, times = np.full(self.size, part), []
        sent, got = np.zeros((2, part * self.size), np.uint8)
        for _ in range(_TRIALS):
            started = time.perf_counter()
            self.Alltoallv([sent, counts], [got, counts])
            times.append(time.perf_counter() - started)
        slowest = np.empty(_TRIALS)
        self.Allreduce(np.array(times), slowest, MPI.MAX)
        return max(slowest.min() - self.latency, 0.0) / sent.size

    def Free(self):
        """Free it, and what was made of it. Collective."""
        if "machine" in vars(self):
            self.machine.Free()
        super().Free()

    def first(self, size):
        """Return a communicator of the first `size` ranks. Collective over these."""
        group = self.Get_group()
        few = group.Incl(range(size))
        made = Communicator(self.plain().Create_group(few, size), self.traffic)
        group.Free()
        few.Free()
        return made

    def Isend(self, rows, dest, tag=0):
        """Count and send an array."""
        self._count_message(rows, dest)
        return super().Isend(rows, dest, tag)

    def Sendrecv(self, rows, dest, **others):
        """Count and send an array, and receive one."""
        self._count_message(rows, dest)
        return super().Sendrecv(rows, dest, **others)

    def Alltoallv(self, sent, received):
        """Count and exchange parts ``[array, counts]`` or ``[array, (counts, places)]``; own parts should be empty."""
        array, counts = sent
        counts = counts[0] if isinstance(counts, tuple) else counts
        self.traffic.all_to_alls += 1
        self.traffic.count(int(np.count_nonzero(counts)), int(np.sum(counts)) * array.itemsize)
        super().Alltoallv(sent, received)

    def _count_message(self, rows, dest):
        if dest != MPI.PROC_NULL:
            self.traffic.count(1, rows.nbytes)


def _counted(name):
    plain, alone = getattr(MPI.Intracomm, name), _ALONE.get(name)

    def method(self, *arguments, **named):
        self.traffic.small_collectives += 1
        log_reduction()
        if alone and self.size == 1:
            return alone(arguments[0])
        return plain(self, *arguments, **named)

    method.__name__, method.__doc__ = name, f"Count and do ``{name}``."
    return method


# What one rank tells itself needs no pickle.
_ALONE = {"allreduce": lambda found: found, "bcast": lambda found: found} | dict.fromkeys(
    ("allgather", "gather"), lambda found: [found]
)
for _name in ("Allreduce", "Allgatherv", "Gatherv", "Scatterv", "allreduce", "allgather", "bcast", "gather"):
    setattr(Communicator, _name, _counted(_name))


class Ranks:
    """All ranks of a solver, and the first few of them for each grid that is not worth more.

    Collective.

    Parameters
    ----------
    comm : mpi4py communicator
    cells : int
        That a rank gets at least; 0: by the latency between machines.
    """

    def __init__(self, comm, cells=0):
        self.comm = comm if isinstance(comm, Communicator) else Communicator(comm)
        self.size, self.rank = comm.size, comm.rank
        self.near, self.least = (1, 0) if cells else (self.comm.near, _worth_a_machine(self.comm))
        self.cells = cells or _worth_a_rank(self.comm)
        self._made = {}

    def number(self, grid):
        """How many ranks a grid is worth, see `worth`. Not collective."""
        return worth(grid, self.size, self.cells, self.near, self.least)

    def deal(self, grid, size=None):
        """Deal the rows of a grid to the first `size` ranks. Collective over these, when it is their first grid.

        Returns
        -------
        slabs : Slabs
        comm : Communicator or None
            None if all rows are here, or none.
        """
        slabs = self.slabs(grid, size)
        return slabs, self.first(slabs.size)

    def slabs(self, grid, size=None):
        """Those of `deal`. Not collective."""
        size = size or self.number(grid)
        return Slabs(grid.ny, size, self.rank, aligned(grid.ny, size))

    def first(self, size):
        """Communicator of the first ranks; None if this is the only one, or none of them. Collective over these."""
        if size == 1 or self.rank >= size:
            return None
        if size == self.size:
            return self.comm
        if size not in self._made:
            self._made[size] = self.comm.first(size)
        return self._made[size]

    def destroy(self):
        """Free the communicators made here. Collective."""
        for size in sorted(self._made):
            self._made.pop(size).Free()


def worth(grid, size, cells, near=1, least=0):
    """How many of `size` ranks a grid is worth: all, those of the first machine, or a power of two. Not collective.

    Each has so many cells at least, and a row; of the first `near` ranks, which are on one machine, `_CELLS_INSIDE`.
    More of them, on several machines, are more than `least`. Coarser grids, and windows, are never worth more.
    """
    most, inside = (min(grid.n // each, grid.ny) for each in (cells, _CELLS_INSIDE))
    number = size if most >= size else _power_of_two(most)
    if number > max(near, least):
        return number
    return near if inside >= near else _power_of_two(inside)


def _power_of_two(most):
    return 1 << (max(most, 1).bit_length() - 1)


def worth_solving(grid, comm, cells=0):
    """How many ranks should solve on a target grid: all, or the first machine's, if it is not worth another.

    Collective over `comm`, a `Communicator`. All if `cells` per rank are asked for.
    """
    near = comm.size if cells else comm.near
    if near < comm.size:
        known = grid, comm.size, _worth_a_rank(comm), near
        # What another machine costs is asked last, as it takes longest.
        if worth(*known) <= near or worth(*known, _worth_a_machine(comm)) <= near:
            return near
    return comm.size


def aligned(ny, size):
    """Rows that slabs should start at multiples of: the largest power of two that costs next to no balance.

    Not collective. Slabs of a grid and of the next coarser one then mostly fit.
    """
    block = 1
    while 32 * block * size <= ny:
        block *= 2
    return block


def _worth_a_rank(comm):
    """Cells from which on a rank pays that is on any machine. Collective when first asked for."""
    return max(_CELLS_INSIDE, 1 << round(np.log2(max(_CELLS_PER_SECOND * comm.latency, 1.0))))


def _worth_a_machine(comm):
    """Ranks from which on more machines pay: it takes less to send what they share than it saves to compute it.

    Collective when first asked for. With b s for a byte, r bytes for a s of computing: b r / P < 1 / near - 1 / P.
    """
    return 0 if comm.near == comm.size else comm.near * (1 + _BYTES_PER_SECOND * comm.byte_seconds)


class Team:
    """The first ranks, that share the grids of a problem, and the others, who wait to be told what is found.

    Collective.

    Parameters
    ----------
    everybody : Communicator
    size : int

    Attributes
    ----------
    comm : Communicator or None
        Of the first ranks; None on the others.
    """

    def __init__(self, everybody, size):
        self.everybody, self.comm = everybody, everybody
        if size < everybody.size:
            self.comm = everybody.first(size) if everybody.rank < size else None

    def told(self, function, *arguments, summary=lambda result: result):
        """Let the first ranks call a function; the others get a summary of what rank 0 got.

        Collective; `function` over the first ranks.

        Raises
        ------
        InputError
            On all ranks, if it does.
        """
        if self.comm is self.everybody:
            return function(*arguments)
        result = told = refused = None
        if self.comm is not None:
            try:
                result = function(*arguments)
                told = summary(result)
            except InputError as error:
                refused = error
        told, why = self.everybody.bcast((told, refused and str(refused)))
        if why is not None:
            raise refused or InputError(why)
        return told if self.comm is None else result

    def destroy(self):
        """Free what was made here. Collective."""
        if self.comm is not None and self.comm is not self.everybody:
            self.comm.Free()


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
        self._comm, self.have = comm if comm is not None and comm.size > 1 else None, have
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
        MPI.Request.Waitall(requests)
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
