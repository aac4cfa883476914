"""Start and end of a parallel command.

Exit statuses: 0 done, 2 bad input (one line on standard error), 3 not converged, 130 interrupted, 1 unexpected error (a
traceback, then a line with the error, and the rank if ranks differ). In each case all ranks end.
"""

import ctypes
import gc
import os
import platform
import re
import signal
import socket
import sys
import tempfile
import threading
import traceback
import warnings
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from app import __version__
from app.base.errors import (
    InputError,
    NoteWarning,
    OtherRankError,
    PackageMissing,
    call_collectively,
    format_error,
    format_message,
)
from app.base.memory import check_address_space, set_malloc_option
from app.base.missing_packages import how_to_get
from app.base.packages import numpy_mismatch
from app.cli import streams

# Option of mallopt -> environment variable that sets it, and our value. Work arrays are freed and allocated often;
# with these values malloc keeps their pages, except those of huge arrays.
_MALLOC = {
    -1: ("MALLOC_TRIM_THRESHOLD_", 2**31 - 1),
    -2: ("MALLOC_TOP_PAD_", 2**24),
    -3: ("MALLOC_MMAP_THRESHOLD_", 2**26),
}


def start(argv):
    """Start MPI and PETSc; return the command's options. Collective.

    Raises InputError if options cannot be read, PETSc refuses its start-up options, or petsc4py does not load.
    """
    keep_freed_pages(os.environ)
    folder_exists = True
    try:
        os.getcwd()  # noqa: PTH109
    except OSError:  # MPI and PETSc would complain
        os.chdir("/")
        folder_exists = False
    if not {"", os.getcwd()} & set(sys.path):  # noqa: PTH109
        sys.path.append("")  # after the program's own modules: users' modules in the current folder
    from app.base.mpi import MPI
    from app.cli import option_sources
    from app.parallel import mpi_abort

    comm = MPI.COMM_WORLD
    mpi_abort.shutdown_comm(comm)
    if not all(comm.allgather(folder_exists)):
        raise InputError("the current folder has been removed")
    programs = set(comm.allgather(f"{__version__} on Python {platform.python_version()}"))
    if len(programs) > 1:
        raise InputError(f"ranks run different programs: {'; '.join(sorted(programs))}")
    words = call_collectively(comm, option_sources.startup_args, argv, only_root=True)
    import petsc4py

    handlers = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGQUIT)}
    with _captured_petsc_errors() as petsc_errors:
        try:
            petsc4py.init(words)
            from petsc4py import PETSc
        except (ImportError, ValueError) as error:  # compiled for another Python, numpy or MPI
            if "numpy" in str(error):
                raise numpy_mismatch("petsc4py") from None
            folder, reason = petsc4py.__path__[0], format_message(error)
            raise InputError(f"{folder} does not load: {reason}. {how_to_get('petsc4py')}") from None
        except Exception:
            raise InputError(f"PETSc does not start: {petsc_errors()}") from None
    for number, handler in handlers.items():  # PETSc aborts, even where nohup ignores the signal
        signal.signal(number, handler)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc aborts; `streams.print_output` handles it
    call_collectively(comm, check_address_space)
    if not PETSc.Options().hasName("options_left"):  # a debug build would list options of a refused command
        PETSc.Options().setValue("options_left", "no")
    parsed = call_collectively(comm, option_sources.parse_options, argv, only_root=True)
    for name, text in parsed.database_options.items():
        PETSc.Options().setValue(name, text or None)
    if "log_view" in parsed.petsc_options and not PETSc.Log.isActive():
        PETSc.Log.begin()
    for line in parsed.overridden():
        warn(line)
    return parsed


@contextmanager
def imports_uncollected():
    """Switch garbage collection off in a ``with`` block.

    Objects that exist at its end are never collected. Collections of all imported objects would take as long as a
    small solve.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()


def keep_freed_pages(environment):
    """Make malloc keep freed pages, which saves time in later solves.

    Options of malloc that the environment sets are not changed.
    """
    for option, (name, value) in _MALLOC.items():
        if name not in environment:
            set_malloc_option(option, value)


@contextmanager
def _captured_petsc_errors():
    """Capture standard error during a ``with`` block.

    The captured text is printed after the block, if the block succeeds. Yield a function that returns PETSc's captured
    error message on one line.
    """
    sys.stderr.flush()
    with tempfile.TemporaryFile() as captured:
        stderr = os.dup(2)
        os.dup2(captured.fileno(), 2)

        def message():
            captured.seek(0)
            lines = re.findall(r"PETSC ERROR: (.*)", captured.read().decode(errors="replace"))
            return ": ".join(line for line in lines[1:3] if not line.startswith("#"))

        try:
            yield message
            captured.seek(0)
            with suppress(OSError):
                os.write(stderr, captured.read())
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


def print_output(text):
    """Print on standard output of rank 0."""
    if _rank() == 0:
        streams.print_output(text)


def warn(message):
    """Print a warning on standard error of rank 0."""
    if _rank() == 0:
        streams.print_error(f"warning: {message}")


def note(message):
    """Print a note on standard error of rank 0."""
    if _rank() == 0:
        streams.print_error(f"note: {message}")


def peak_memory():
    """Return the sum of the peak memory of all ranks [bytes]. Collective."""
    import resource

    from app.base.mpi import MPI

    return MPI.COMM_WORLD.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)


def _rank():
    from app.base.mpi import MPI

    return MPI.COMM_WORLD.rank


def run(main, argv=None):
    """Run a command and exit with its status. Collective.

    The function ``main(parsed_options)`` returns the exit status; None means 0. `argv` is by default ``sys.argv``.
    """
    streams.reopen_closed()
    warnings.simplefilter("ignore", NoteWarning)  # commands print notes
    if find_spec("mpi4py") is None:  # ranks cannot communicate; mpiexec ends them
        where = f"host {socket.gethostname()}: {sys.executable} has no mpi4py"
        streams.print_error(
            f"error: {where}; . run/env brings the right Python, and run/mpi brings it to all hosts"
        )
        sys.exit(2)
    if "--version" in (argv or sys.argv)[1:]:
        streams.print_output(__version__)
        sys.exit(0)
    status, message, trace = 0, None, ""
    argv = ["-help" if word in ("-h", "--help") else word for word in (sys.argv if argv is None else argv)]
    try:
        with imports_uncollected():
            parsed = start(argv)
        status = main(parsed) or 0
        write_logs(parsed.petsc_options)
    except InputError as error:
        status, message = 2, format_message(error)
        if isinstance(error, PackageMissing) and error.name == "mpi4py":  # ranks cannot communicate
            streams.print_error(f"error: {message}")
            sys.exit(status)
    except MemoryError as error:
        status, message = 2, f"not enough memory: {format_message(error)}"
    except KeyboardInterrupt:
        from app.parallel import mpi_abort

        streams.print_error("interrupted")
        mpi_abort.abort_all(status := 130)
    except BaseException as error:
        status, message = 1, format_error(error)
        trace = "" if isinstance(error, OtherRankError) else traceback.format_exc().rstrip()
    # Not in the except blocks, whose tracebacks would keep PETSc objects alive for too long.
    if message is not None:
        _end(status, message, trace)
    sys.exit(status)


def write_logs(petsc_options):
    """Finalize PETSc and write its logs to files. Collective.

    PETSc ignores a full disk. So it writes its logs to memory, and the program copies them to the files. Raises
    InputError if a file cannot be written.
    """
    patterns = {"log_view": r"(?:ascii)?:([^:,]+)(?::\w*:?(append)?)?", "citations": "(.+)()"}
    patterns = {name: text for name, text in patterns.items() if re.search(text, petsc_options.get(name, ""))}
    if not patterns or not hasattr(os, "memfd_create"):
        return
    from mpi4py import MPI
    from petsc4py import PETSc

    from app.io.files import report_write_errors

    comm, logs = MPI.COMM_WORLD, {}  # file in memory -> name and mode

    def redirect(match):
        memory = f"/proc/self/fd/{os.memfd_create('log')}"
        logs[memory] = match[1], "ab" if match[2] else "wb"
        first, last = (index - match.start() for index in match.span(1))
        return match[0][:first] + memory + match[0][last:]

    def write():
        for memory, (name, mode) in logs.items():
            content = Path(memory).read_bytes()
            for other, (shown, _) in logs.items():
                content = content.replace(other.encode(), shown.encode())
            with report_write_errors(name), Path(name).open(mode) as log:
                log.write(content)

    for name, pattern in patterns.items():
        text = re.sub(pattern, redirect, petsc_options[name]) if comm.rank == 0 else ""
        PETSc.Options().setValue(name, comm.bcast(text))
    PETSc._finalize()
    call_collectively(comm, write, only_root=True)


def _end(status, message, trace):
    """Print an error once and end all ranks.

    The traceback `trace` is printed first. Ranks that have not failed are aborted. PETSc is not finalized: after an
    error it would destroy objects in different order on different ranks, and deadlock.
    """
    from app.base.mpi import MPI
    from app.parallel import mpi_abort

    comm = MPI.COMM_WORLD
    together = mpi_abort.barrier_with_timeout(mpi_abort.shutdown_comm(comm))
    # Print the message of one rank, if possible one with a traceback.
    messages = comm.allgather((not trace, message)) if together else [(not trace, message)]
    if not together or messages.index(min(messages)) == comm.rank:
        if trace:
            streams.print_error(trace)
        where = f"rank {comm.rank}: " if len(set(messages)) > 1 or not together else ""
        streams.print_error(f"error: {where}{message}")
    if comm.size == 1:
        return
    if not together:
        mpi_abort.abort_all(status)
    mpi_abort.flush()
    # If MPI does not end either, exit after a timeout.
    timer = threading.Timer(mpi_abort.TIMEOUT, os._exit, (status,))
    timer.daemon = True
    timer.start()
    ctypes.CDLL(MPI.__file__).MPI_Finalize()  # releases Python's lock, for the timer
    os._exit(status)
