"""Functions petsc4py 3.18 lacks, and workarounds for newer releases.

``restricts_by_transpose`` and ``calling_petsc`` hide differences between releases of petsc4py.
"""

import atexit
import ctypes
import gc
import locale
import os
import re
import signal
import sys
import threading
import traceback
from contextlib import suppress
from functools import cache, wraps
from typing import TypeVar

import numpy as np
from petsc4py import PETSc

from app.base.arithmetic import default_arithmetic
from app.base.errors import InputError
from app.base.memory import set_malloc_option
from app.base.mpi import MPI, check_running
from app.base.user_folder import existing_folder

_M_MMAP_MAX = -4


@cache
def _library():
    library, handle = ctypes.CDLL(PETSc.__file__), ctypes.c_void_p  # libpetsc's symbols resolve through it
    for name, arguments in {
        "MatRestrict": [handle, handle, handle],
        "MatSetOperation": [handle, ctypes.c_int, handle],
        "PetscOptionsUsed": [handle, ctypes.c_char_p, ctypes.POINTER(ctypes.c_int)],
    }.items():
        function = getattr(library, name)  # library[name] is a new object each time
        function.argtypes, function.restype = arguments, ctypes.c_int
    return library


def call(name, *arguments):
    """Call a C function of PETSc; raise PETSc.Error if it fails."""
    if code := getattr(_library(), name)(*arguments):
        raise PETSc.Error(code)


@cache
def return_large_arrays():
    """Let malloc return freed large arrays to the system.

    SuperLU_DIST, which is loaded with PETSc, prevents this. A ``MALLOC_MMAP_MAX_`` that the user has set remains valid.
    """
    with suppress(ValueError):  # a text that is no number
        set_malloc_option(_M_MMAP_MAX, int(os.environ.get("MALLOC_MMAP_MAX_", 65536)))


def _ignore_closed_pipes():
    """Restore Python's SIGPIPE handler; PETSc's would end the process."""
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


_ignore_closed_pipes()
check_running(PETSc)


@atexit.register
def _finalize():
    """Finalize PETSc before Python ends.

    PETSc's objects call Python code when they are destroyed, so Python must still run.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # closed
            stream.flush()
    if not MPI.Is_finalized():  # by the user's program
        with calling_petsc():
            PETSc._finalize()  # does nothing if it has ended
    _ignore_closed_pipes()  # Python writes once more


@atexit.register  # functions run in reverse order: before `_finalize`
def _forget_last_exception():
    """Free objects in the frames of an uncaught exception."""
    error, seen = getattr(sys, "last_value", None), set()
    while error is not None and id(error) not in seen:  # circular after `raise error.__cause__`
        seen.add(id(error))
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__
    collect_garbage()


def collect_garbage(comm=PETSc.COMM_SELF):
    """Free PETSc objects that interrupted solves left behind. Collective."""
    if PETSc.Sys.isFinalized() or MPI.Is_finalized():
        return
    with suppress(AttributeError):  # a petsc4py that frees at once
        PETSc.garbage_cleanup(comm)


_LOCK = threading.RLock()
_Function = TypeVar("_Function")


def synchronized(function: _Function) -> _Function:
    """Decorate a function so that one thread at a time runs it.

    The function runs in default arithmetic, and in a folder that exists.
    """

    @wraps(function)
    def locked(*args, **kwargs):
        with _LOCK, default_arithmetic(), existing_folder():
            return function(*args, **kwargs)

    return locked


def mpi_comm(comm):
    """Convert a communicator of petsc4py or mpi4py to mpi4py; None: all ranks.

    Raises InputError if `comm` is something else, or does not contain this rank.
    """
    check_running(MPI)
    check_running(PETSc)
    if comm is None:
        return MPI.COMM_WORLD
    if isinstance(comm, PETSc.Comm):
        comm = comm.tompi4py()
    if isinstance(comm, MPI.Comm) and comm == MPI.COMM_NULL:
        raise InputError("comm: this rank is none of its ranks; only those may make a solver")
    if not isinstance(comm, MPI.Intracomm):
        raise InputError(f"comm: is {type(comm).__name__}; must be a communicator of mpi4py or petsc4py")
    return comm


@cache
def _counter(name):
    try:
        return ctypes.c_double.in_dll(_library(), name)
    except ValueError:  # a PETSc without logging
        return ctypes.c_double()


def log_messages(count, size):
    """Add sent messages and their bytes to PETSc's counters for -log_view."""
    _counter("petsc_isend_ct").value += count
    _counter("petsc_isend_len").value += size


def log_reduction():
    """Add one reduction over ranks to PETSc's -log_view counter."""
    _counter("petsc_allreduce_ct").value += 1


def logged_reductions():
    """Return the number of this rank's reductions, broadcasts and gathers so far, PETSc's own included."""
    return int(sum(_counter(f"petsc_{kind}_ct").value for kind in ("allreduce", "gather")))


# PETSc's codes of errors of incompatible types: unsupported, wrong argument or state, missing method, unknown type, no
# factorisation
_INCOMPATIBLE = (56, 60, 62, 73, 75, 83, 86, 92)
_FILE_WRITE, _EXTERNAL_LIBRARY = 67, 76


def error_message(error):
    """Return a PETSc.Error's message without PETSc's stack."""
    noise = ("error code", "See ", "#")
    entries = re.sub(r"\n(?!\[\d+\] )\s*", " ", str(error)).splitlines()  # some have several lines
    lines = (line.split("] ", 1)[-1] if line.startswith("[") else line for line in entries)
    messages = [line.strip() for line in lines if "() " not in line and not line.startswith(noise)]
    message = messages[-1] if messages else " ".join(str(error).split())
    missing_method = re.fullmatch(r"method \w+\(\)", message)
    return f"what is written in Python has no {message}" if missing_method else message


def _unwrapped(error):
    """Return a callback's exception, unwrapped from newer petsc4py's PETSc.Error."""
    while isinstance(error, PETSc.Error) and error.__cause__ is not None:
        error = error.__cause__
    return error


def to_input_error(error, files=()):
    """Return an InputError if PETSc's `error` means incompatible solvers or a full disk, else `error`.

    PETSc does not name the file that it cannot write; it is one of the `files`.
    """
    inner = _unwrapped(error)
    if not isinstance(inner, PETSc.Error):
        return error
    message = error_message(inner)
    if inner.ierr == _FILE_WRITE or (inner.ierr == _EXTERNAL_LIBRARY and "H5" in message):
        return InputError(f"{' or '.join(files)}: cannot be written; is the disk full? {message}")
    return InputError(f"solver options: {message}") if inner.ierr in _INCOMPATIBLE else error


@cache
def _switch_locale():
    """Return a function that gives this thread another locale and returns the one before, and a neutral locale.

    In the neutral locale a number has a point and "I" is a capital "i". Texts stay in UTF-8 where the system can. The
    process's locale, which other threads use, does not change.
    """
    try:
        libc = ctypes.CDLL(None)
        create, switch = libc.newlocale, libc.uselocale
    except (AttributeError, OSError):  # another C library
        return lambda name: None, None
    create.argtypes, switch.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p), (ctypes.c_void_p,)
    create.restype = switch.restype = ctypes.c_void_p
    every = sum(1 << number for number in {locale.LC_CTYPE, locale.LC_NUMERIC})
    return switch, create(every, b"C.UTF-8", None) or create(every, b"C", None)


class calling_petsc:
    """Context manager for calls of PETSc that read options or call Python.

    PETSc reads numbers and compares words by the rules of the locale: "0.5" is no number in German, and "i" is not the
    small "I" in Turkish. So this thread has a neutral locale inside the block.

    Exceptions of Python callbacks are raised unwrapped. Newer petsc4py wraps these exceptions in PETSc.Error.

    Inside the block no garbage is collected, because petsc4py formats texts while an exception is set. Since Python
    3.12 garbage may be collected at that moment; then a callback of a weak reference fails, the exception is lost, and
    petsc4py crashes.
    """

    def __enter__(self):
        self._collects = gc.isenabled()
        gc.disable()
        switch, neutral = _switch_locale()
        self._locale = switch(neutral)

    def __exit__(self, kind, error, trace):
        _switch_locale()[0](self._locale)
        if self._collects:
            gc.enable()
        cause = _unwrapped(error)
        if cause is error:
            return
        error.__cause__ = None  # it is the context of its cause: a cycle would keep the frames of both
        try:
            raise cause from cause.__cause__
        finally:
            del cause, error, trace  # the exception refers to this frame


@cache
def restricts_by_transpose():
    """Return whether MatRestrict multiplies by the transpose of a square matrix.

    The answer depends on the release of PETSc. If the matrix is rectangular, all releases choose the matrix or its
    transpose by the sizes of the vectors. But if every rank has a copy of a coarse grid, its vectors may be as long as
    the next finer grid's, and the matrix is square.
    """
    mat = PETSc.Mat().createDense((2, 2), comm=PETSc.COMM_SELF)
    mat.setUp()
    mat.setValue(0, 1, 1.0)
    mat.assemble()
    x, y = mat.createVecs()
    x.setArray([0.0, 1.0])
    call("MatRestrict", mat.handle, x.handle, y.handle)
    return not y.getArray().any()


_MATOP_GETINFO, _MAT_INFO_BYTES = 15, 10 * 8


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
def _no_entries(mat, kind, info):
    ctypes.memset(info, 0, _MAT_INFO_BYTES)
    return 0


def report_no_entries(mat):
    """Make ``getInfo`` of a Mat of type python report zero stored entries."""
    call("MatSetOperation", mat.handle, _MATOP_GETINFO, ctypes.cast(_no_entries, ctypes.c_void_p))


def check_cells(grid):
    """Raise if a grid has more cells than PETSc's integers can number."""
    most = np.iinfo(PETSc.IntType).max
    if grid.n > most:
        what, advice = f"grid {grid.nx},{grid.ny}", "use a PETSc with 64-bit integers (docs/install.md)"
        raise InputError(f"{what}: this PETSc can number at most {most} cells; {advice}")


class Resources:
    """A solver's PETSc objects, destroyed in reverse order. Collective."""

    def __init__(self):
        return_large_arrays()
        self._parts, self.comm = [], None

    def add(self, part):
        """Add an object, which `free` will destroy."""
        self._parts.append(part)

    def remove(self, part):
        """Destroy an added object now, before `free`."""
        self._parts.remove(part)
        part.destroy()

    def free(self):
        """Destroy all objects and the communicator, if PETSc is still running."""
        if PETSc.Sys.isFinalized() or MPI.Is_finalized():
            return
        while self._parts:
            self._parts.pop().destroy()
        collect_garbage()
        if self.comm is not None:
            self.comm.Free()
            self.comm = None
