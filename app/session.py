"""Start-up and the one way to fail.

``run(main)`` starts PETSc on the command line, calls `main` and turns what happens into an exit status:
0 done, 2 bad input (one line on standard error, from one rank), 3 not converged, 1 anything unexpected
(traceback; the whole job ends, because the other ranks may wait for this one for ever).
"""

from __future__ import annotations

import ctypes
import itertools
import os
import re
import sys
import traceback
from pathlib import Path

import petsc4py
from mpi4py import MPI

# Options that PETSc looks up only while solving or at the end, or never marks as used.
_READ_LATE = re.compile(
    r"options_(left|view)|log_|malloc|memory_view|info|help|version|citations|on_error|error_output|fp_trap|checkstack"
    r"|objects_dump|get_total_flops|python|skip_petscrc|nox"
    r"|(\w+_)?ksp_(view|converged_rea|converged_rate|error_if)|(\w+_)?(pc|mat|vec)_view"
)


class InputError(Exception):
    """The user asked for something that cannot be done; the message says what, where and what is allowed."""


def start(argv):
    """Initialise PETSc with the options of `argv`. Collective; once per process.

    Raises
    ------
    InputError
        If an option file cannot be read or is not one.
    """
    for flag, value in itertools.pairwise(argv):
        if flag in ("-options_file", "-options_file_yaml"):
            path = Path(value)
            if not path.is_file():
                raise InputError(f"option file {value}: no such file")
            if not os.access(path, os.R_OK):
                raise InputError(f"option file {value}: not readable")
    if argv[-1] in ("-options_file", "-options_file_yaml"):
        raise InputError(f"{argv[-1]}: a file name must follow")
    petsc4py.init(argv)
    try:
        from petsc4py import PETSc  # noqa: F401
    except Exception as error:
        raise InputError(f"PETSc does not accept the options: {petsc_message(error)}") from error


def petsc_message(error):
    """What a PETSc.Error says, on one line and without its stack."""
    noise = ("error code", "See ", "#")
    lines = (line.split("] ", 1)[-1] if line.startswith("[") else line for line in str(error).splitlines())
    told = [line.strip() for line in lines if "() " not in line and not line.startswith(noise)]
    return told[-1] if told else " ".join(str(error).split())


def unused_options():
    """Names of the options in PETSc's database that nobody has asked for so far. Not collective."""
    import numpy as np
    from petsc4py import PETSc

    lib = ctypes.CDLL(PETSc.__file__)  # libpetsc's symbols resolve through it
    count = (ctypes.c_int32 if np.dtype(PETSc.IntType).itemsize == 4 else ctypes.c_int64)()
    names, values = ctypes.POINTER(ctypes.c_char_p)(), ctypes.POINTER(ctypes.c_char_p)()
    lib.PetscOptionsLeftGet(None, ctypes.byref(count), ctypes.byref(names), ctypes.byref(values))
    unused = [names[i].decode() for i in range(count.value)]
    lib.PetscOptionsLeftRestore(None, ctypes.byref(count), ctypes.byref(names), ctypes.byref(values))
    return [name for name in unused if not _READ_LATE.match(name)]


def agree(comm, function, *args):
    """Call `function` on every rank; if it raises ValueError or OSError on any, raise InputError on all.

    Collective over the mpi4py communicator `comm`; `function` itself must not be.
    """
    result = complaint = None
    try:
        result = function(*args)
    except (ValueError, OSError) as error:
        complaint = str(error)
    for message in comm.allgather(complaint):
        if message is not None:
            raise InputError(message)
    return result


def warn(message):
    """Print a warning once. Not collective: only rank 0 prints."""
    if MPI.COMM_WORLD.rank == 0:
        print(f"warning: {message}", file=sys.stderr, flush=True)


def run(main, argv=None):
    """Start PETSc, call ``main()``, leave with its exit status. Does not return.

    Parameters
    ----------
    main : callable
        Returns the exit status (None for 0).
    argv : list of str, optional
        Default: ``sys.argv``.
    """
    status = 1
    try:
        start(sys.argv if argv is None else argv)
        status = main() or 0
    except InputError as error:
        # Raised alike on all ranks.
        if MPI.COMM_WORLD.rank == 0:
            print(f"error: {' '.join(str(error).split())}", file=sys.stderr, flush=True)
        status = 2
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException as error:
        traceback.print_exc()
        sys.stderr.flush()
        sys.stdout.flush()
        if MPI.COMM_WORLD.size > 1:
            MPI.COMM_WORLD.Abort(1)
        status = 130 if isinstance(error, KeyboardInterrupt) else 1
    # Outside the except blocks: no traceback holds a Mat any more that PETSc would destroy too late.
    sys.exit(status)
