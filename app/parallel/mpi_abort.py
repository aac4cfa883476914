"""Abort all MPI ranks when one of them fails.

MPI cannot interrupt a rank in a collective call, so the other ranks would wait for a failed rank forever. So the failed
rank aborts all ranks. If all ranks have failed, each of them ends by itself.
"""

import sys
import time
from contextlib import suppress

from app.base.errors import format_error
from app.base.mpi import MPI

TIMEOUT = 3.0  # Seconds to wait for the other ranks before aborting them.

_SHUTDOWN = MPI.Comm.Create_keyval(delete_fn=lambda comm, key, shutdown: shutdown.Free())
_last_used = MPI.COMM_SELF  # Shutdown communicator of the last solver that this process has used.
_groups = []  # Groups of solvers that are not closed.
_hooks = []  # Exception hooks that this module has installed.


def shutdown_comm(comm):
    """Return a communicator of the same ranks for `barrier_with_timeout`.

    The communicator is separate from `comm`, so that its barrier cannot match other messages. The communicator is freed
    together with `comm`. Collective when first called for `comm`.
    """
    if comm.size == 1:
        return MPI.COMM_SELF
    if comm.Get_attr(_SHUTDOWN) is None:
        comm.Set_attr(_SHUTDOWN, comm.Dup())
    return comm.Get_attr(_SHUTDOWN)


def barrier_with_timeout(comm):
    """Return whether all ranks call this function within `TIMEOUT` seconds. Collective."""
    request = comm.Ibarrier()
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        if MPI.Request.Test(request):
            return True
        time.sleep(0.01)
    return False


def abort_all(status):
    """Abort all ranks, if several, with an exit status."""
    flush()
    if MPI.COMM_WORLD.size > 1:
        time.sleep(0.2)  # Open MPI 5 drops output that it has not forwarded yet.
        MPI.COMM_WORLD.Abort(status)


def flush():
    """Flush standard output and standard error."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()


def abort_on_exception(comm):
    """Make an uncaught exception on one rank abort all ranks of `comm`.

    Return `comm`. Collective when first called for `comm`. Caught exceptions abort no rank, nor do exceptions in a
    notebook or at Python's prompt.

    This holds until the function is called for another communicator. If `comm` then has `AbortGroup`s, it holds until
    all of them are destroyed.
    """
    global _last_used
    _last_used = shutdown_comm(comm)
    if comm.size > 1 and sys.excepthook not in _hooks:
        _hooks.append(_abort_after(sys.excepthook))
        sys.excepthook = _hooks[-1]
    return comm


class AbortGroup:
    """Ranks to abort after an uncaught exception, until `destroy`. Collective."""

    def __init__(self, comm):
        self.comm = shutdown_comm(comm)
        _groups.append(self)

    def destroy(self):
        """End the group; an exception that propagates still aborts its ranks."""
        global _last_used
        _groups.remove(self)
        if sys.exc_info()[0] is not None:
            _last_used = self.comm


def _abort_after(previous):
    """Return a `sys.excepthook` that calls `previous`, then aborts ranks."""

    def hook(kind, error, trace):
        previous(kind, error, trace)
        at_prompt = hasattr(sys, "ps1") or sys.flags.inspect
        comms = [_last_used, *(group.comm for group in reversed(_groups))]
        comm = next((comm for comm in comms if comm != MPI.COMM_NULL and comm.size > 1), None)
        if at_prompt or comm is None or barrier_with_timeout(comm):
            return
        with suppress(OSError):
            rank = MPI.COMM_WORLD.rank
            print(f"error: rank {rank}: {format_error(error)}; all ranks are ended", file=sys.stderr)
        abort_all(1)

    return hook
