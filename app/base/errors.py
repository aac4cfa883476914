"""The one way to refuse something, on one rank or on all of them at once."""

from __future__ import annotations

import re
import socket
import sys
import warnings

_LONG_WORD = re.compile(r"\S{72,}")  # that of a quotation, with quotes and a colon, is shorter
_LONGEST_PATH, _LONGEST_MESSAGE = 255, 4000  # characters


def shorten(text, longest=60):
    """Shorten a text for a message to its beginning and its end. Not collective."""
    return text if len(text) <= longest else f"{text[: longest - 18]}...{text[-15:]}"


def _shorten_word(word):
    return shorten(word[0], _LONGEST_PATH) if "/" in word[0] else shorten(word[0])


class InputError(ValueError):
    """The user asked for something that cannot be done; the message says what, where and what is allowed.

    Long words and long messages are shortened. Quote a text with blanks by `shorten`.
    """

    def __init__(self, message=""):
        super().__init__(shorten(_LONG_WORD.sub(_shorten_word, str(message)), _LONGEST_MESSAGE))


class PackageError(ImportError, InputError):
    """A package does not load; the message says what to do."""


class PackageMissing(ModuleNotFoundError, PackageError):
    """A package is not installed; the message says how to get it."""


class OtherRankError(RuntimeError):
    """Another rank has met a mistake of the program; the message says which."""


def format_exact(number):
    """Write a number so that it differs from every other one. Not collective.

    Examples
    --------
    >>> format_exact(0.5), format_exact(-1.0), format_exact(0.1 + 0.2)
    ('0.5', '-1', '0.30000000000000004')
    """
    text = f"{number:g}"
    return text if float(text) == number or number != number else repr(float(number))


def format_distinct(number, other, digits=3):
    """Write a number with few digits, but enough to tell it from another one. Not collective.

    Examples
    --------
    >>> format_distinct(0.012345, 0.02), format_distinct(0.50001, 0.5), format_distinct(0.5, 0.5)
    ('0.0123', '0.50001', '0.5')
    """
    texts = [f"{number:.{count}g}" for count in range(digits, 18)]
    others = (f"{other:.{count}g}" for count in range(digits, 18))
    return next((mine for mine, its in zip(texts, others, strict=True) if mine != its), texts[0])


def format_message(error):
    """Text of an exception on one line; its type if it says nothing. Not collective."""
    return " ".join(str(error).split()) or type(error).__name__


def format_error(error):
    """Type and text of an exception on one line. Not collective."""
    name, text = type(error).__name__, format_message(error)
    return name if text == name else f"{name}: {text}"


def format_yaml_error(error, content):
    """Line of a text that is no YAML, and what is wrong there, to stand behind the text's name. Not collective."""
    mark = getattr(error, "problem_mark", None)
    line = f", line {min(mark.line + 1, len(content.splitlines()))}" if mark else ""
    return f"{line}: {getattr(error, 'problem', None) or str(error).splitlines()[0]}"


def call_collectively(comm, function, *args, only_root=False):
    """Call ``function(*args)`` on every rank; if it fails on any, raise InputError on all.

    Collective over the mpi4py communicator `comm`; `function` itself must not be. ValueError, OSError and MemoryError
    are the user's to hear of, whichever rank meets them; anything else is a mistake of the program and raised as it is.
    What only some ranks meet is told with the name of their host, if there are several.

    Parameters
    ----------
    only_root : bool
        Only rank 0 calls, and tells the others what it got.
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
    for told in complaints:
        if isinstance(told, tuple):
            raise OtherRankError(f"on another rank: {told[0]}")
    if complaints.count(None) == len(complaints):
        return result
    hosts = comm.allgather(socket.gethostname())
    message, host = next(pair for pair in zip(complaints, hosts, strict=False) if pair[0] is not None)
    alone = len(set(hosts)) > 1 and complaints.count(message) < len(hosts) and not only_root
    raise InputError(f"host {host}: {message}" if alone else message)


def check_equal_on_ranks(comm, value, what):
    """Refuse what is not the same on all ranks, which would wait for each other.

    Collective over the mpi4py communicator `comm`.

    Parameters
    ----------
    value : object
        Compared by its `repr`.
    what : str
        For the message.

    Raises
    ------
    InputError
    """
    if len(set(comm.allgather(repr(value)))) > 1:
        raise InputError(f"{what}: not the same on all ranks")


def warn_caller(message):
    """Give a RuntimeWarning where the program is called from, by whatever way through its modules. Not collective."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "app":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, RuntimeWarning, stacklevel=level)
