"""The ranks of a solver and what they tell each other: communicators that count.

Every grid, and every window of one, is dealt to as many ranks as it is worth: all, or the first few. So a rank has the
same number in every communicator here, and rows go point to point between any two layouts (`fetch`). A rank beyond has
no rows and takes no part; it hears of what was decided when it has rows again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from mpi4py import MPI

from app.errors import FailedElsewhere, InputError, described
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
        return self.of(range(size))

    def of(self, ranks):
        """Return a communicator of some ranks, in order. Collective over these."""
        group = self.Get_group()
        few = group.Incl(ranks)
        made = Communicator(self.plain().Create_group(few, ranks[-1]), self.traffic)
        group.Free()
        few.Free()
        return made

    def Isend(self, rows, dest, tag=0):
        """Count and send an array."""
        self.traffic.count(1, rows.nbytes)
        return super().Isend(rows, dest, tag)

    def Alltoallv(self, sent, received):
        """Count and exchange parts ``[array, counts]`` or ``[array, (counts, places)]``; own parts should be empty."""
        array, counts = sent
        counts = counts[0] if isinstance(counts, tuple) else counts
        self.traffic.all_to_alls += 1
        self.traffic.count(int(np.count_nonzero(counts)), int(np.sum(counts)) * array.itemsize)
        super().Alltoallv(sent, received)


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
        self._told = None  # communicator of rank 0, which tells, and those that are told
        if size < everybody.size:
            self.comm = everybody.first(size) if everybody.rank < size else None
            if everybody.rank == 0 or self.comm is None:
                self._told = everybody.of([0, *range(size, everybody.size)])

    def told(self, function, *arguments, summary=lambda result: result):
        """Let the first ranks call a function; the others get a summary of what rank 0 got.

        Collective; `function` over the first ranks. What goes wrong on rank 0 is raised on the others, too.

        Raises
        ------
        InputError
            On all ranks, if it does.
        """
        if self._told is None:
            return function(*arguments)
        result = told = failure = None
        if self.comm is not None:
            try:
                result = function(*arguments)
                told = summary(result)
            except Exception as error:
                failure = error
        refused = isinstance(failure, InputError)
        why = failure and (str(failure) if refused else f"on another rank: {described(failure)}")
        told, why, refused = self._told.bcast((told, why, refused))
        if why is not None:
            raise failure or (InputError if refused else FailedElsewhere)(why)
        return told if self.comm is None else result

    def destroy(self):
        """Free what was made here. Collective."""
        for comm in (self._told, self.comm):
            if comm is not None and comm is not self.everybody:
                comm.Free()
