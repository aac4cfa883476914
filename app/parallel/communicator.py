"""What the ranks of a solver tell each other: communicators that count, and ranks that wait to be told.

Which ranks share a grid: `app.parallel.rank_groups`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from app.base.errors import InputError, OtherRankError, format_error
from app.base.mpi import MPI
from app.base.petsc import log_messages, log_reduction, to_input_error


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

    Attributes
    ----------
    shares_memory : bool
        Whether ranks of one machine may, see `app.parallel.shared_memory`.
    """

    shares_memory = True

    def __new__(cls, comm=None, traffic=None):  # noqa: D102
        self = super().__new__(cls, comm)
        self.traffic = traffic or Traffic()
        return self

    def plain(self):
        """Return it as others know it, who ask for the type. Not collective."""
        return MPI.Intracomm(self)

    @cached_property
    def node(self):
        """Communicator of the ranks on this machine. Collective when first asked for."""
        return self.plain().Split_type(MPI.COMM_TYPE_SHARED)

    @cached_property
    def single_node(self):
        """Whether all ranks are on one machine. Collective when first asked for."""
        return self.node.size == self.size

    def Free(self):
        """Free it, and what was made of it. Collective."""
        if "node" in vars(self):
            self.node.Free()
        super().Free()

    def first(self, size):
        """Return a communicator of the first `size` ranks. Collective over these."""
        return self.of(range(size))

    def of(self, ranks):
        """Return a communicator of some ranks, in order. Collective over these."""
        group = self.Get_group()
        few = group.Incl(ranks)
        made = Communicator(self.plain().Create_group(few, ranks[-1]), self.traffic)
        made.shares_memory = self.shares_memory
        if vars(self).get("single_node"):
            made.single_node = True
        group.Free()
        few.Free()
        return made

    def Isend(self, rows, dest, tag=0):
        """Count and send an array."""
        self.traffic.count(1, rows.nbytes)
        return super().Isend(rows, dest, tag)

    def bcast_or_raise(self, known=None):
        """Return what rank 0 tells; if that is a `Failure`, raise it on the others. Collective."""
        told = self.bcast(known)
        if isinstance(told, Failure) and self.rank > 0:
            raise (InputError if told.refused else OtherRankError)(told.why)
        return told

    def exchange_barrier(self):
        """Count and wait for all, who read and write shared memory: an all-to-all that sends nothing. Collective."""
        self.traffic.all_to_alls += 1
        self.Barrier()

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
for _name in ("Allreduce", "Allgatherv", "Gatherv", "allreduce", "allgather", "bcast", "gather"):
    setattr(Communicator, _name, _counted(_name))


class Failure:
    """What has gone wrong on some ranks, for those that wait for them."""

    def __init__(self, error):
        error = to_input_error(error)
        self.refused = isinstance(error, InputError)
        self.why = str(error) if self.refused else f"on another rank: {format_error(error)}"


class propagate_errors:
    """A block on rank 0 of a communicator, whose other ranks wait in `tell`, and hear if it fails. Not collective.

    Parameters
    ----------
    comm : Communicator or None
        None: nobody waits.
    """

    def __init__(self, comm):
        self._comm = comm

    def __enter__(self):
        """Begin."""

    def __exit__(self, _, error, __):
        """End."""
        if error is not None and self._comm is not None:
            self._comm.bcast_or_raise(Failure(error))
