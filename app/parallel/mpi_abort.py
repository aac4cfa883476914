"""How several ranks end when one of them fails: those that wait for it would wait for ever.

MPI has no way to call ranks back from a collective call, so the rank that has failed ends them. Where all ranks have
failed, each ends by itself.
"""

from __future__ import annotations

import sys
import time
from contextlib import suppress

from app.base.errors import format_error
from app.base.mpi import MPI

TIMEOUT = 3.0  # s; of a rank that has met an error, until it believes that the others have not

_PLACE = MPI.Comm.Create_keyval(delete_fn=lambda comm, key, place: place.Free())
_shared = MPI.COMM_SELF  # where those meet that share the solver which this process has used last
_open = []  # those of solvers of several ranks that are not closed
_hooks = []  # of ours, to know them


def shutdown_comm(comm):
    """Return a communicator of the same ranks for `barrier_with_timeout` only.

    Collective when first asked for; freed with `comm`.
    """
    if comm.size == 1:
        return MPI.COMM_SELF
    if comm.Get_attr(_PLACE) is None:
        comm.Set_attr(_PLACE, comm.Dup())
    return comm.Get_attr(_PLACE)


def barrier_with_timeout(place):
    """Whether all ranks of a meeting place call this within the time of patience. Collective, if they do."""
    farewell = place.Ibarrier()
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        if MPI.Request.Test(farewell):
            return True
        time.sleep(0.01)
    return False


def abort_all(status):
    """End the other ranks, which may wait for this one, and this one with them if there are any. Not collective."""
    flush()
    if MPI.COMM_WORLD.size > 1:
        time.sleep(0.2)  # Open MPI 5 drops what it has not passed on yet
        MPI.COMM_WORLD.Abort(status)


def flush():
    """Write what is printed so far. Not collective."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()


def abort_on_exception(comm):
    """Let an exception that nobody catches end the ranks of this communicator, as long as no other one is shared.

    Collective when first called for it. The others wait for this rank wherever it fails, in a solver or between two
    calls of one. As long as there is an `AbortGroup`, so do those of solvers of a single rank. Caught exceptions end
    nothing, nor do those of a notebook or at a prompt.

    Returns
    -------
    mpi4py communicator
        The same.
    """
    global _shared
    _shared = shutdown_comm(comm)
    if comm.size > 1 and sys.excepthook not in _hooks:
        _hooks.append(_after(sys.excepthook))
        sys.excepthook = _hooks[-1]
    return comm


class AbortGroup:
    """As long as it is not destroyed the ranks of a communicator wait for each other. Collective when first made."""

    def __init__(self, comm):
        self.place = shutdown_comm(comm)
        _open.append(self)

    def destroy(self):
        """They do no longer, but for an exception that is on its way: nobody may catch it. Not collective."""
        global _shared
        _open.remove(self)
        if sys.exc_info()[0] is not None:
            _shared = self.place


def _after(previous):
    """A `sys.excepthook` that does what the previous one did, then ends what waits for this rank."""

    def end(kind, error, trace):
        previous(kind, error, trace)
        at_a_prompt = hasattr(sys, "ps1") or sys.flags.inspect
        places = [_shared, *(one.place for one in reversed(_open))]
        place = next((place for place in places if place != MPI.COMM_NULL and place.size > 1), None)
        if at_a_prompt or place is None or barrier_with_timeout(place):
            return
        rank = MPI.COMM_WORLD.rank
        with suppress(OSError):
            print(f"error: rank {rank}: {format_error(error)}; all ranks are ended", file=sys.stderr)
        abort_all(1)

    return end
