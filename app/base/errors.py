"""Exception classes, errors on several MPI ranks, and numbers in messages."""

import re
import socket
import sys
import warnings
from numbers import Real

_LONG_WORD = re.compile(r"\S{72,}")
MAX_WORD, MAX_PATH, MAX_MESSAGE = 60, 255, 4000  # characters


def shorten(text, longest=MAX_WORD):
    """Shorten a text to its beginning and its end."""
    return text if len(text) <= longest else f"{text[: longest - 18]}...{text[-15:]}"


class InputError(ValueError):
    """Invalid input of the user.

    The message says what is wrong, where, and what is allowed. Long words and long messages are shortened
    automatically. A long text with blanks counts as several words, so shorten such a text by `shorten`.
    """

    def __init__(self, message: object = "") -> None:
        def shorter(word):
            return shorten(word[0], MAX_PATH if "/" in word[0] else MAX_WORD)

        super().__init__(shorten(_LONG_WORD.sub(shorter, str(message)), MAX_MESSAGE))

    def _render_traceback_(self):
        """Return the lines that IPython shows: only frames of the user."""
        package = __name__.partition(".")[0]
        last = self.__traceback__
        while (
            last.tb_next and last.tb_next.tb_frame.f_globals.get("__name__", "").partition(".")[0] != package
        ):
            last = last.tb_next
        last.tb_next = None
        shell = sys.modules["IPython"].get_ipython()
        return shell.InteractiveTB.structured_traceback(type(self), self, self.__traceback__, tb_offset=1)


class PackageError(ImportError, InputError):
    """A Python package that cannot be imported."""


class PackageMissing(ModuleNotFoundError, PackageError):
    """A Python package that is not installed."""


class NoteWarning(UserWarning):
    """Warning about a doubtful solution or surface."""


class OtherRankError(RuntimeError):
    """Error raised because another rank had an unexpected exception (a bug)."""


def check_type(name, value, kind, what):
    """Raise InputError unless argument `name` has the type `kind`."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: is {type(value).__name__}; must be {what}")


def is_number(value):
    """Return whether a value is a real number, not a boolean."""
    return isinstance(value, float) or (isinstance(value, Real) and not isinstance(value, bool))


def plain_number(value):
    """Return a scalar of another library as a number of Python; other values unchanged.

    Such scalars are a Decimal, a Fraction, and arrays without dimensions, of numpy or of xarray. A masked value stays.
    """
    if type(value).__name__ in ("Decimal", "Fraction"):  # without an import that would slow down each start
        return float(value)
    if getattr(value, "shape", None) != () or not hasattr(value, "item"):
        return value
    return value[()] if hasattr(value, "mask") else value.item()


def to_float(value):
    """Convert a number or its text to a float; raise TypeError for booleans."""
    if type(value).__name__ in ("bool", "bool_"):  # the latter is numpy's, which this module does not import
        raise TypeError(f"{value}: must be a number, not a boolean")
    return float(value)


def format_exact(number):
    """Format a number with as many digits as its exact value needs.

    Examples
    --------
    >>> format_exact(0.5), format_exact(-1.0), format_exact(0.1 + 0.2)
    ('0.5', '-1', '0.30000000000000004')
    """
    text = f"{number:g}"
    return text if float(text) == number or number != number else repr(float(number))


def format_distinct(number, other, digits=3):
    """Format a number so that it differs from the text of `other`.

    The result has at least `digits` significant digits, and more if `other` would otherwise look the same.

    Examples
    --------
    >>> format_distinct(0.012345, 0.02), format_distinct(0.50001, 0.5), format_distinct(0.5, 0.5)
    ('0.0123', '0.50001', '0.5')
    """
    for count in range(digits, 18):
        if f"{number:.{count}g}" != f"{other:.{count}g}":
            return f"{number:.{count}g}"
    return f"{number:.{digits}g}"


def format_message(error):
    """Return the message of an exception on one line."""
    return " ".join(str(error).split()) or type(error).__name__


def format_error(error):
    """Return the type and the message of an exception on one line."""
    name, text = type(error).__name__, format_message(error)
    return name if text == name else f"{name}: {text}"


def format_yaml_error(error, content):
    """Return the line in `content`, and the cause, of a YAML error."""
    mark = getattr(error, "problem_mark", None)
    line = f", line {min(mark.line + 1, len(content.splitlines()))}" if mark else ""
    return f"{line}: {getattr(error, 'problem', None) or str(error).splitlines()[0]}"


def call_collectively(comm, function, *args, only_root=False):
    """Call a function on every rank; raise an error on all ranks.

    Collective over the mpi4py communicator `comm`; `function` itself must not be collective. A ValueError, OSError or
    MemoryError on any rank becomes an InputError on all ranks. The message names the host if the error occurred on some
    hosts only. Any other exception is a bug: its rank raises it unchanged, and the other ranks raise OtherRankError.

    Parameters
    ----------
    only_root : bool
        Only rank 0 calls the function, and broadcasts the result.
    """
    result = complaint = mistake = None
    try:
        if comm.rank == 0 or not only_root:
            result = function(*args)
    except (ValueError, OSError, MemoryError) as error:
        complaint = format_message(error)
    except Exception as error:
        mistake, complaint = error, (format_error(error),)
    if only_root:
        result, complaint = comm.bcast((result, complaint))
        complaints = [complaint]
    else:
        complaints = comm.allgather(complaint)
    if mistake is not None:
        raise mistake
    for complaint in complaints:
        if isinstance(complaint, tuple):
            raise OtherRankError(f"on another rank: {complaint[0]}")
    if not any(complaint is not None for complaint in complaints):
        return result
    hosts = comm.allgather(socket.gethostname())
    message, host = next(pair for pair in zip(complaints, hosts, strict=False) if pair[0] is not None)
    on_some_hosts = len(set(hosts)) > 1 and complaints.count(message) < len(hosts) and not only_root
    raise InputError(f"host {host}: {message}" if on_some_hosts else message)


def check_equal_on_ranks(comm, value, what):
    """Raise InputError if a value, called `what`, differs between ranks. Collective."""
    if len(set(comm.allgather(repr(value)))) > 1:
        raise InputError(f"{what}: not the same on all ranks")


def is_first_rank():
    """Return whether this is rank 0; True if MPI is not running."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi is None or not mpi.Is_initialized() or mpi.Is_finalized() or mpi.COMM_WORLD.rank == 0


def warn_caller(message, category=RuntimeWarning):
    """Issue a warning that points to the line of the user's program."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "app":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


def warn_notes(notes):
    """Issue a NoteWarning for each note on rank 0."""
    for note in notes if is_first_rank() else ():
        warn_caller(note, NoteWarning)
