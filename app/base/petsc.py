"""What petsc4py 3.18 lacks, by PETSc's own C functions; each with the release that ends the need, if there is one.

- Counters of messages and reductions for -log_view (none yet).

And what newer releases do otherwise: `TAO_REASONS`, `restricts_by_transpose`, `unwrap_errors`.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import re
import signal
import sys
import threading
import traceback
from contextlib import contextmanager, nullcontext, suppress
from functools import cache, wraps

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.base.memory import set_malloc_option
from app.base.mpi import MPI

_M_MMAP_MAX = -4
TAO_REASONS = getattr(PETSc.TAO, "ConvergedReason", None) or PETSc.TAO.Reason


@cache
def _library():
    library, handle = ctypes.CDLL(PETSc.__file__), ctypes.c_void_p  # libpetsc's symbols resolve through it
    for name, arguments in {
        "MatRestrict": [handle, handle, handle],
        "MatSetOperation": [handle, ctypes.c_int, handle],
        "PetscOptionsUsed": [handle, ctypes.c_char_p, ctypes.POINTER(ctypes.c_int)],
    }.items():
        function = getattr(library, name)  # library[name] is another one each time
        function.argtypes, function.restype = arguments, ctypes.c_int
    return library


def call(name, *arguments):
    """Call a function of PETSc's own library. Collective as that.

    Raises
    ------
    PETSc.Error
    """
    if code := getattr(_library(), name)(*arguments):
        raise PETSc.Error(code)


@cache
def return_large_arrays():
    """Let malloc return large arrays, which SuperLU_DIST, a part of many a PETSc, keeps it from. Not collective."""
    with suppress(ValueError):  # of a text that is no number
        set_malloc_option(_M_MMAP_MAX, int(os.environ.get("MALLOC_MMAP_MAX_", 65536)))


def _ignore_closed_pipes():
    """Restore Python's treatment of SIGPIPE, on which PETSc aborts; its end restores the system's, which kills."""
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


_ignore_closed_pipes()


@atexit.register
def _finalize():
    """End PETSc while Python still runs: objects that programs keep at module level call their contexts."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # closed, or its reader is gone
            stream.flush()
    PETSc._finalize()  # does nothing if it has ended
    _ignore_closed_pipes()  # Python writes once more


@atexit.register  # functions run in reverse order: before `_finalize`
def _forget_last_exception():
    """Free what the frames of an uncaught exception hold."""
    error, seen = getattr(sys, "last_value", None), set()
    while error is not None and id(error) not in seen:  # what `unwrap_errors` raises goes round
        seen.add(id(error))
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__
    collect_garbage()


def collect_garbage(comm=PETSc.COMM_SELF):
    """Free what Python has forgotten, as of a solve that was interrupted: PETSc keeps it until somebody asks.

    Collective over the PETSc communicator `comm`, whose ranks wait for each other.
    """
    with suppress(AttributeError):  # a petsc4py that frees at once
        PETSc.garbage_cleanup(comm)


_ONE_AT_A_TIME = threading.RLock()


def synchronized(function):
    """Let threads wait for each other: PETSc's state, such as the database that is active, is the process's."""

    @wraps(function)
    def alone(*args, **kwargs):
        with _ONE_AT_A_TIME:
            return function(*args, **kwargs)

    return alone


def mpi_comm(comm):
    """The mpi4py communicator that is meant: by petsc4py's, or by None, which is all ranks. Not collective.

    Raises
    ------
    InputError
        If it is something else, or this rank is none of its ranks.
    """
    if comm is None:
        return MPI.COMM_WORLD
    if isinstance(comm, PETSc.Comm):
        comm = comm.tompi4py()
    if isinstance(comm, MPI.Comm) and comm == MPI.COMM_NULL:
        raise InputError("comm: this rank is none of its ranks; only those may make a solver")
    if not isinstance(comm, MPI.Intracomm):
        raise InputError(f"comm: is {type(comm).__name__}; needed: a communicator of mpi4py or petsc4py")
    return comm


@cache
def _counter(name):
    try:
        return ctypes.c_double.in_dll(_library(), name)
    except ValueError:  # a PETSc that does not log
        return ctypes.c_double()


def log_messages(count, size):
    """Count messages and their bytes for -log_view, as PETSc does its own. Not collective."""
    _counter("petsc_isend_ct").value += count
    _counter("petsc_isend_len").value += size


def log_reduction():
    """Count a reduction for -log_view. Not collective."""
    _counter("petsc_allreduce_ct").value += 1


# Errors that say that types do not go together: unsupported, wrong argument or state, method missing, unknown type, no
# factorisation
_WRONG_CHOICES = (56, 60, 62, 73, 75, 83, 86, 92)


def error_message(error):
    """What a PETSc.Error says, on one line and without its stack. Not collective."""
    noise = ("error code", "See ", "#")
    entries = re.sub(r"\n(?!\[\d+\] )\s*", " ", str(error)).splitlines()  # some have several lines
    lines = (line.split("] ", 1)[-1] if line.startswith("[") else line for line in entries)
    told = [line.strip() for line in lines if "() " not in line and not line.startswith(noise)]
    said = told[-1] if told else " ".join(str(error).split())
    return f"what is written in Python has no {said}" if re.fullmatch(r"method \w+\(\)", said) else said


def _original(error):
    """Return what an error of PETSc's was caused by: newer petsc4py wraps what callbacks raise, also PETSc's errors."""
    while isinstance(error, PETSc.Error) and error.__cause__ is not None:
        error = error.__cause__
    return error


def to_input_error(error):
    """InputError in place of an error of PETSc's that says that solvers do not go together. Not collective."""
    inner = _original(error)
    if isinstance(inner, PETSc.Error) and inner.ierr in _WRONG_CHOICES:
        return InputError(f"solver options: {error_message(inner)}")
    return error


@contextmanager
def unwrap_errors():
    """Let what a Python callback raises leave the block as it was; newer petsc4py wraps it in an error of PETSc's."""
    try:
        yield
    except PETSc.Error as error:
        raise_unwrapped(error)


@contextmanager
def _without_collection():
    """Collect no garbage inside the block. Not collective."""
    collects = gc.isenabled()
    try:
        gc.disable()
        yield
    finally:
        if collects:
            gc.enable()


# A context in which PETSc may call Python. petsc4py formats texts while an exception of Python is set. Since Python
# 3.12 garbage may be collected then. A callback of a weak reference fails because of the exception, which is lost, and
# petsc4py crashes.
callback_context = _without_collection if sys.version_info >= (3, 12) else nullcontext


def raise_unwrapped(error):
    """Raise what a Python callback has raised in place of an error of PETSc's, if there is such. Not collective."""
    original = _original(error)
    if original is error:
        raise error
    raise original from None


@cache
def restricts_by_transpose():
    """Whether PETSc takes a square restriction for an interpolation and multiplies by its transpose. Not collective.

    Vectors of replicated grids are as long as those of the next finer grid on some numbers of ranks.
    """

    class Asked:
        transposed = False

        def mult(self, mat, x, y):
            y.set(0)

        def multTranspose(self, mat, x, y):
            self.transposed = True
            y.set(0)

    asked = Asked()
    mat = PETSc.Mat().createPython((1, 1), asked, comm=PETSc.COMM_SELF)
    mat.setUp()
    x, y = mat.createVecs()
    call("MatRestrict", mat.handle, x.handle, y.handle)
    for part in (x, y, mat):
        part.destroy()
    return asked.transposed


_MATOP_GETINFO, _MAT_INFO_BYTES = 15, 10 * 8


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
def _no_entries(mat, kind, info):
    ctypes.memset(info, 0, _MAT_INFO_BYTES)
    return 0


def report_no_entries(mat):
    """Let a Mat of type python answer ``getInfo``: no entries are stored. Not collective.

    petsc4py passes the question on to no context (none yet).
    """
    call("MatSetOperation", mat.handle, _MATOP_GETINFO, ctypes.cast(_no_entries, ctypes.c_void_p))


def check_cells(grid):
    """Refuse a grid with more cells than PETSc's integers can number. Not collective.

    Raises
    ------
    InputError
    """
    most = np.iinfo(PETSc.IntType).max
    if grid.n > most:
        raise InputError(
            f"grid {grid.nx},{grid.ny}: this PETSc can number {most} cells; one with integers of 64 bits more "
            "(docs/install.md)"
        )


class Resources:
    """Objects with a ``destroy``, and a communicator: freed in reverse order, once. Collective."""

    def __init__(self):
        return_large_arrays()  # the first of all that a solver does
        self._parts, self.comm = [], None

    def add(self, part):
        """Take a part, if it is one."""
        if part is not None:
            self._parts.append(part)

    def remove(self, part):
        """Free a part now."""
        self._parts.remove(part)
        part.destroy()

    def free(self):
        """Free all that is left, unless PETSc or MPI has ended."""
        if PETSc.Sys.isFinalized() or MPI.Is_finalized():
            return
        while self._parts:
            self._parts.pop().destroy()
        collect_garbage()
        if self.comm is not None:
            self.comm.Free()
            self.comm = None
