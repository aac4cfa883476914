"""Start-up and the one way to fail.

``run(main)`` starts PETSc on the command line, calls `main` and turns what happens into an exit status:
0 done, 2 bad input (one line on standard error, from one rank), 3 not converged, 130 interrupted, 1 anything
unexpected (traceback); in both the whole job ends, because the other ranks may wait for this one for ever.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import re
import shlex
import signal
import sys
import traceback
from pathlib import Path

import petsc4py
from mpi4py import MPI

# Options that PETSc looks up only while solving or at the end, or never marks as used.
_READ_LATE = re.compile(
    r"options_left|options_view|citations|checkstack|get_total_flops|nox"
    r"|(\w+_)?(ksp|snes|tao)_converged_reason|(\w+_)?(ksp|pc|mat|vec|snes|tao)_view\w*"
)


OPTION_FILES = "-options_file", "-options_file_yaml"


class InputError(Exception):
    """The user asked for something that cannot be done; the message says what, where and what is allowed."""


def start(argv):
    """Initialise PETSc with the options of `argv`. Collective; once per process.

    Raises
    ------
    InputError
        If an option file cannot be read or is not one.
    """
    for before, word in itertools.pairwise(argv):
        if before in OPTION_FILES:
            option_names(word, before)
        elif not (_is_option(before) or _is_option(word)):
            raise InputError(f"{word}: neither an option nor the value of one")
    if argv[-1] in OPTION_FILES:
        raise InputError(f"{argv[-1]}: a file name must follow")
    petsc4py.init(argv)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc would abort; see `say`
    try:
        from petsc4py import PETSc  # noqa: F401
    except Exception as error:
        raise InputError(f"PETSc does not accept the options: {petsc_message(error)}") from error


def _is_option(word):
    return re.match("--?[A-Za-z]", word) is not None


def option_names(path, flag="-options_file"):
    """Names of the options in a file, each with its dash; those in groups of a YAML file are left out.

    Not collective. PETSc reads option files on the first rank, and leaves the others waiting if it finds a mistake.

    Parameters
    ----------
    path : str
    flag : str
        One of `OPTION_FILES`.

    Raises
    ------
    InputError
        If the file cannot be read or is not an option file.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"option file {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"option file {path}: is not a text file") from None
    if flag == "-options_file_yaml" or path.endswith((".yml", ".yaml")):
        return _names_in_yaml(path, text)
    names = []
    for number, line in enumerate(text.splitlines(), 1):
        try:
            words = shlex.split(line, comments=True)
        except ValueError as error:
            raise InputError(f"option file {path}, line {number}: {error}") from None
        if not words:
            continue
        if not _is_option(words[0]) or len(words) > 2 or _is_option(words[-1]) != (len(words) == 1):
            raise InputError(
                f"option file {path}, line {number}: {line.strip()}: needed: -option, or -option value"
            )
        names.append(words[0])
    return names


def _names_in_yaml(path, text):
    import yaml

    try:
        content = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise InputError(f"option file {path}: {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"option file {path}: needed: a line 'option: value' for each option")
    return [f"-{name}" for name in content]


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
    return [name for name in unused if not _READ_LATE.fullmatch(name)]


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


def say(text):
    """Print on standard output, as long as somebody reads it. Not collective: only rank 0 prints."""
    if MPI.COMM_WORLD.rank == 0:
        try:
            print(text, flush=True)
        except BrokenPipeError:
            # `| head` has had enough: what is computed is still wanted.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        status = _end_all(130)
    except BaseException:
        traceback.print_exc()
        status = _end_all(1)
    # Outside the except blocks: no traceback holds a Mat any more that PETSc would destroy too late.
    sys.exit(status)


def _end_all(status):
    """End the other ranks, which may wait for this one; return the status. Not collective."""
    sys.stderr.flush()
    sys.stdout.flush()
    if MPI.COMM_WORLD.size > 1:
        MPI.COMM_WORLD.Abort(status)
    return status
