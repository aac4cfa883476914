"""Start-up of a command on all ranks, and the one way to end it.

``run(main)`` reads the options, starts PETSc, calls `main` and turns what happens into an exit status: 0 done, 2 bad
input (one line on standard error, from one rank), 3 not converged, 130 interrupted, 1 anything unexpected (a line after
its traceback, with the rank if it is not the same on all).
Whatever happens on whatever ranks, all of them end.
"""

from __future__ import annotations

import os
import platform
import re
import signal
import socket
import sys
import tempfile
import threading
import traceback
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from app import __version__
from app.base.errors import InputError, OtherRankError, call_collectively, format_error, format_message
from app.base.memory import check_address_space, set_malloc_option
from app.base.packages import HOW_TO_GET, numpy_mismatch
from app.cli import streams

# mallopt's numbers, names in the environment and values: freed work arrays are made anew all the time, and their pages,
# but for huge arrays', need not be found again.
_MALLOC = {
    -1: ("MALLOC_TRIM_THRESHOLD_", 2**31 - 1),
    -2: ("MALLOC_TOP_PAD_", 2**24),
    -3: ("MALLOC_MMAP_THRESHOLD_", 2**26),
}


def start(argv):
    """Read all options and start PETSc. Collective over all ranks; once per process.

    Returns
    -------
    app.cli.option_sources.ParsedOptions

    Raises
    ------
    InputError
        If options cannot be read, PETSc does not accept those it needs at its start, or petsc4py does not load.
    """
    _keep_pages(os.environ)
    folder_is_gone = _leave_removed_folder()
    if not {"", os.getcwd()} & set(sys.path):  # noqa: PTH109
        sys.path.append("")  # where users have parts of their own; behind ours, whatever a folder holds
    from app.base.mpi import MPI
    from app.cli import option_sources
    from app.parallel import mpi_abort

    comm = MPI.COMM_WORLD
    mpi_abort.shutdown_comm(comm)
    call_collectively(comm, _refuse, folder_is_gone)
    _check_programs(comm)
    words = call_collectively(comm, option_sources.startup_args, argv, only_root=True)
    import petsc4py

    handlers = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGQUIT)}
    with _errors_of_petsc() as said:
        try:
            petsc4py.init(words)
            from petsc4py import PETSc
        except (ImportError, ValueError) as error:  # it is of another Python, numpy or MPI
            if "numpy" in str(error):
                raise numpy_mismatch("petsc4py") from None
            place = petsc4py.__path__[0]
            raise InputError(
                f"{place} does not load: {format_message(error)}. {HOW_TO_GET['petsc4py']}"
            ) from None
        except Exception:
            raise InputError(f"PETSc does not start: {said()}") from None
    for number, handler in handlers.items():  # PETSc would abort, also where nohup ignores the signal
        signal.signal(number, handler)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc would abort; see `streams.print_output`
    call_collectively(comm, check_address_space)
    if not PETSc.Options().hasName("options_left"):  # a debug build would list those of a refused command
        PETSc.Options().setValue("options_left", "no")
    given = call_collectively(comm, option_sources.parse_options, argv, only_root=True)
    for name, text in given.database_options.items():
        PETSc.Options().setValue(name, text or None)
    if "log_view" in given.petsc_options and not PETSc.Log.isActive():
        PETSc.Log.begin()
    for line in given.overridden():
        warn(line)
    return given


def _keep_pages(environment):
    """Let malloc keep what is freed, as far as the environment does not say how it is to be."""
    for option, (name, value) in _MALLOC.items():
        if name not in environment:
            set_malloc_option(option, value)


def _leave_removed_folder():
    """Whether the current folder is gone; MPI and PETSc would complain each in its own way."""
    try:
        os.getcwd()  # noqa: PTH109
    except OSError:
        os.chdir("/")
        return "the current folder has been removed"


def _check_programs(comm):
    """Refuse hosts with different programs; they may not even do the same steps. Collective."""
    own = f"{__version__} on Python {platform.python_version()}"
    if len(found := set(comm.allgather(own))) > 1:
        raise InputError(f"ranks run different programs: {'; '.join(sorted(found))}")


def _refuse(complaint):
    if complaint:
        raise InputError(complaint)


@contextmanager
def _errors_of_petsc():
    """Keep what PETSc says on standard error; if all is well it is printed at the end.

    Yields a function that returns it as one line without the frame that PETSc puts around it.
    """
    sys.stderr.flush()
    with tempfile.TemporaryFile() as kept:
        before = os.dup(2)
        os.dup2(kept.fileno(), 2)

        def said():
            kept.seek(0)
            lines = re.findall(r"PETSC ERROR: (.*)", kept.read().decode(errors="replace"))
            return ": ".join(line for line in lines[1:3] if not line.startswith("#"))

        try:
            yield said
            kept.seek(0)
            with suppress(OSError):
                os.write(before, kept.read())
        finally:
            os.dup2(before, 2)
            os.close(before)


def print_output(text):
    """Print on standard output, as long as somebody reads it. Not collective: only rank 0 prints."""
    if _rank() == 0:
        streams.print_output(text)


def warn(message):
    """Print a warning. Not collective: only rank 0 prints."""
    if _rank() == 0:
        streams.print_error(f"warning: {message}")


def note(message):
    """Print a note on standard error. Not collective: only rank 0 prints."""
    if _rank() == 0:
        streams.print_error(f"note: {message}")


def peak_memory():
    """Largest memory of all ranks together so far [bytes]. Collective."""
    import resource

    from app.base.mpi import MPI

    return MPI.COMM_WORLD.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)


def _rank():
    from app.base.mpi import MPI

    return MPI.COMM_WORLD.rank


def run(main, argv=None):
    """Start, call ``main(given)``, leave with its exit status. Does not return.

    Parameters
    ----------
    main : callable
        Takes the options, `app.cli.option_sources.ParsedOptions`; returns the exit status (None for 0).
    argv : list of str, optional
        Default: ``sys.argv``.
    """
    streams.reopen_closed()
    if find_spec("mpi4py") is None:  # no rank knows of the others; mpiexec ends them
        where = f"host {socket.gethostname()}: {sys.executable} has no mpi4py"
        streams.print_error(
            f"error: {where}; . run/env brings the right Python, and run/mpi brings it to all hosts"
        )
        sys.exit(2)
    if "--version" in (argv or sys.argv)[1:]:
        streams.print_output(__version__)
        sys.exit(0)
    status, complaint, trace = 0, None, ""
    argv = ["-help" if word in ("-h", "--help") else word for word in (sys.argv if argv is None else argv)]
    try:
        given = start(argv)
        status = main(given) or 0
        write_logs(given.petsc_options)
    except InputError as error:
        status, complaint = 2, format_message(error)
    except MemoryError as error:
        status, complaint = 2, f"not enough memory: {format_message(error)}"
    except KeyboardInterrupt:
        from app.parallel import mpi_abort

        streams.print_error("interrupted")
        mpi_abort.abort_all(status := 130)
    except BaseException as error:
        status, complaint, trace = 1, format_error(error), traceback.format_exc().rstrip()
        if isinstance(error, OtherRankError):
            trace = ""
    # Outside the except blocks: no traceback holds a Mat any more that PETSc would destroy too late.
    if complaint is not None:
        _end(status, complaint, trace)
    sys.exit(status)


def write_logs(petsc_options):
    """End PETSc and write its logs, if it is to write some into files. Collective over all ranks.

    PETSc does not notice a full disk, so it writes into memory here.

    Parameters
    ----------
    petsc_options : dict of str to str
        See `app.cli.option_sources.ParsedOptions`.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    logs = {"log_view": r"(?:ascii)?:([^:,]+)(?::\w*:?(append)?)?", "citations": "(.+)()"}
    logs = {
        name: pattern for name, pattern in logs.items() if re.search(pattern, petsc_options.get(name, ""))
    }
    if not logs or not hasattr(os, "memfd_create"):
        return
    from mpi4py import MPI
    from petsc4py import PETSc

    comm, opened = MPI.COMM_WORLD, []

    def in_memory(match):
        file = os.memfd_create("log")
        opened.append((file, match[1], "ab" if match[2] else "wb"))
        start, end = (place - match.start() for place in match.span(1))
        return f"{match[0][:start]}/proc/self/fd/{file}{match[0][end:]}"

    def write():
        for file, name, mode in opened:
            text = Path(f"/proc/self/fd/{file}").read_bytes()
            for other, shown, _ in opened:
                text = text.replace(b"/proc/self/fd/%d" % other, shown.encode())
            try:
                with Path(name).open(mode) as log:
                    log.write(text)
            except OSError as error:
                raise InputError(f"{name}: cannot be written: {error.strerror}") from None

    for name, pattern in logs.items():
        text = re.sub(pattern, in_memory, petsc_options[name]) if comm.rank == 0 else ""
        PETSc.Options().setValue(name, comm.bcast(text))
    PETSc._finalize()
    call_collectively(comm, write, only_root=True)


def _end(status, complaint, trace):
    """Print what is wrong once and end all ranks, several of them without coming back.

    Collective, if the other ranks have something to complain of, too; if they go on, they are ended. PETSc is not
    finalised: it would destroy objects in an order that errors have left different on different ranks, and wait for
    ever.

    Parameters
    ----------
    trace : str
        Where a mistake of the program is, on the rank that has met it; printed first.
    """
    from app.base.mpi import MPI
    from app.parallel import mpi_abort

    comm = MPI.COMM_WORLD
    together = mpi_abort.barrier_with_timeout(mpi_abort.shutdown_comm(comm))
    # Of several complaints that with a place in the program is told.
    told = comm.allgather((not trace, complaint)) if together else [(not trace, complaint)]
    if not together or told.index(min(told)) == comm.rank:
        if trace:
            streams.print_error(trace)
        where = f"rank {comm.rank}: " if len(set(told)) > 1 or not together else ""
        streams.print_error(f"error: {where}{complaint}")
    if comm.size == 1:
        return
    if not together:
        mpi_abort.abort_all(status)
    mpi_abort.flush()
    # The last resort, if MPI does not end either.
    last = threading.Timer(mpi_abort.TIMEOUT, os._exit, (status,))
    last.daemon = True
    last.start()
    _finalize()
    os._exit(status)


def _finalize():
    """Finalise MPI without holding Python's lock, for the timer's sake."""
    import ctypes

    from app.base.mpi import MPI

    ctypes.CDLL(MPI.__file__).MPI_Finalize()
