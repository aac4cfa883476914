"""Communicators that count messages, and propagate errors to waiting ranks.

Every message between ranks goes through a `Communicator`. `app.parallel.rank_groups` chooses which ranks share a grid.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from app.base.errors import InputError, OtherRankError, format_error
from app.base.mpi import MPI
from app.base.petsc import log_messages, log_reduction, logged_reductions, to_input_error


@dataclass
class Traffic:
    """Counts of the messages that a rank has sent to other ranks."""

    messages: int = 0  # point to point, and in all-to-alls
    message_bytes: int = 0
    all_to_alls: int = 0
    small_collectives: int = 0  # reductions, broadcasts, gathers

    def since(self, before):
        """Return these message counts minus the counts `before`."""
        return Traffic(*(getattr(self, f.name) - getattr(before, f.name) for f in fields(self)))

    def copy(self):
        """Return a copy of these counts."""
        return self.since(Traffic())

    def count(self, messages, size):
        """Count messages that have `size` bytes in total."""
        self.messages += messages
        self.message_bytes += size
        log_messages(messages, size)


class Communicator(MPI.Intracomm):
    """Communicator of mpi4py that counts messages.

    `comm` is wrapped, not duplicated. The messages are counted in `traffic`, by default a new `Traffic`.
    """

    shares_memory = True  # Ranks of one node may use `app.parallel.shared_memory`.

    def __new__(cls, comm=None, traffic=None):  # noqa: D102
        self = super().__new__(cls, comm)
        self.traffic = traffic or Traffic()
        return self

    def count_traffic(self):
        """Return the counts until now; reductions are those of the whole process, PETSc's own included."""
        return replace(self.traffic, small_collectives=logged_reductions())

    def plain(self):
        """Return this communicator as `MPI.Intracomm`, for functions rejecting subclasses."""
        return MPI.Intracomm(self)

    @cached_property
    def node(self):
        """Communicator of the ranks on this node. Collective on first use."""
        return self.plain().Split_type(MPI.COMM_TYPE_SHARED)

    @cached_property
    def single_node(self):
        """True if all ranks are on one node. Collective on first use."""
        return self.node.size == self.size

    def Free(self):
        """Free the communicator and the node's communicator. Collective."""
        if "node" in vars(self):
            self.node.Free()
        super().Free()

    def subcomm(self, ranks):
        """Return a communicator of `ranks`. Collective over these ranks."""
        group = self.Get_group()
        subgroup = group.Incl(ranks)
        comm = Communicator(self.plain().Create_group(subgroup, ranks[-1]), self.traffic)
        comm.shares_memory = self.shares_memory
        if vars(self).get("single_node"):
            comm.single_node = True
        group.Free()
        subgroup.Free()
        return comm

    def Isend(self, rows, dest, tag=0):
        """Send an array, and count the message."""
        self.traffic.count(1, rows.nbytes)
        return super().Isend(rows, dest, tag)

    def bcast_or_raise(self, value=None):
        """Broadcast a value from rank 0, or raise its error. Collective.

        If rank 0 has met an error, it broadcasts a `_Failure` instead of a value, and the other ranks raise its error.
        """
        value = self.bcast(value)
        if isinstance(value, _Failure) and self.rank > 0:
            raise (InputError if value.refused else OtherRankError)(value.message)
        return value

    def exchange_barrier(self):
        """Wait for all ranks; count an all-to-all without messages. Collective."""
        self.traffic.all_to_alls += 1
        self.Barrier()

    def Alltoallv(self, sent, received):
        """Exchange data between all ranks, and count messages to others. Collective."""
        array, counts = sent
        counts = counts[0] if isinstance(counts, tuple) else counts
        self.traffic.all_to_alls += 1
        self.traffic.count(int(np.count_nonzero(counts)), int(np.sum(counts)) * array.itemsize)
        super().Alltoallv(sent, received)


# Results on a single rank, which need no pickling.
_SINGLE_RANK = {"allreduce": lambda value: value, "bcast": lambda value: value} | dict.fromkeys(
    ("allgather", "gather"), lambda value: [value]
)


def _counted(name):
    """Return a method that counts and calls a collective function of mpi4py."""
    collective, single_rank = getattr(MPI.Intracomm, name), _SINGLE_RANK.get(name)

    def method(self, *arguments, **named):
        self.traffic.small_collectives += 1
        log_reduction()
        if single_rank and self.size == 1:
            return single_rank(arguments[0])
        return collective(self, *arguments, **named)

    method.__name__, method.__doc__ = name, f"Count and call ``{name}``."
    return method


for _name in ("Allreduce", "Allgatherv", "Gatherv", "allreduce", "allgather", "bcast", "gather"):
    setattr(Communicator, _name, _counted(_name))


class _Failure:
    """Error of rank 0, in a broadcastable form."""

    def __init__(self, error):
        error = to_input_error(error)
        self.refused = isinstance(error, InputError)
        self.message = str(error) if self.refused else f"on another rank: {format_error(error)}"


class propagate_errors:
    """Context manager on rank 0 that sends an error to waiting ranks.

    The other ranks of `comm` wait in `bcast_or_raise`. If `comm` is None, no rank waits.
    """

    def __init__(self, comm):
        self._comm = comm

    def __enter__(self):
        """Enter the block."""

    def __exit__(self, _, error, __):
        """Broadcast the error, if the block has raised one."""
        if error is not None and self._comm is not None:
            self._comm.bcast_or_raise(_Failure(error))
