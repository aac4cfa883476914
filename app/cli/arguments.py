"""Parser, checks and exit statuses of commands with options like ``--jobs``."""

import argparse
import os
import re
import shutil
import signal
import sys
import time
from functools import wraps

from app import __version__
from app.base import units
from app.base.errors import InputError, format_message, shorten
from app.base.mpi import launched_rank
from app.cli import streams
from app.options import option_table

_ROOT_SECONDS = 2.0  # Time for rank 0 to print its error; then mpiexec ends the other ranks.
_NO_WORK = {"-h", "--help", "--version"}  # Options that any rank may have.


class Parser(argparse.ArgumentParser):
    """Argument parser raising InputError and accepting values like -1,2."""

    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        self.add_argument("--version", action="version", version=__version__)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message):
        """Raise InputError with a message like ``--jobs 0: must be ...``."""
        raise InputError(re.sub("^argument (-[^:]*): (?=.*: must be )", r"\1 ", message))


def argument_type(kind):
    """Return an argparse type from a `kind` of `app.options.option_table`.

    `kind` and the result convert the same texts to values. For other texts they raise errors with the same message.
    """

    def parse(text):
        try:
            return kind(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"{shorten(text)}: must be {error}") from None

    return parse


count, positive = argument_type(option_table.count), argument_type(option_table.positive)
length_unit = argument_type(units.unit)
cell_size = argument_type(
    option_table.lengths(option_table.pair_of_reals("DX,DY, two positive numbers [mm]", above=0))
)


def check_ranks(ranks):
    """Raise InputError if several ranks are asked for, but mpiexec is missing."""
    if ranks > 1 and not shutil.which("mpiexec"):
        raise InputError(f"--ranks {ranks}: there is no mpiexec on PATH")


def _refuse_ranks():
    """Raise InputError on one of several ranks of mpiexec, on rank 0 first.

    Otherwise each rank would do the whole work, and write the same files.
    """
    rank, size = launched_rank(os.environ)
    if size > 1:
        time.sleep(_ROOT_SECONDS * (rank > 0))
        raise InputError(f"mpiexec -n {size}: this command runs on one rank; start it without mpiexec")


def check_folder(folder):
    """Raise InputError unless the folder -o can be made or written to."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"-o {folder}: exists and is not a folder")
    if not folder.parent.is_dir():
        raise InputError(f"-o {folder}: folder {folder.parent} does not exist")
    if not os.access(folder if folder.exists() else folder.parent, os.W_OK):
        raise InputError(f"-o {folder}: cannot be written to")


def add_picture_options(add):
    """Add --title, --style and --format by a parser's ``add_argument``."""
    add("--title", metavar="TEXT", help="heading of pictures; default: that of the result, or its problem")
    look = "paper: 8.5 cm wide, letters of 8 pt, panels in one column, no heading; default: screen"
    add("--style", choices=("screen", "paper"), default="screen", help=look)
    add("--format", choices=("png", "pdf", "svg"), help="default: png; for paper both pdf and svg")


def picture_kinds(arguments):
    """Return the picture file suffixes that the command's options ask for."""
    kinds = ("pdf", "svg") if arguments.style == "paper" else ("png",)
    return (arguments.format,) if arguments.format else kinds


def command(main):
    """Decorate the ``main(argv)`` of a command.

    If the user makes an error, the decorated function prints one line and returns the status 2. SIGTERM acts like
    Ctrl-C: the status is 130 after either. A command started on several ranks of mpiexec is refused; a script may call
    ``main(argv)`` on one of its ranks. Exceptions other than InputError, OSError and MemoryError are bugs, and
    propagate.
    """

    @wraps(main)
    def wrapper(argv=None):
        streams.reopen_closed()
        previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            if argv is None and not _NO_WORK.intersection(sys.argv[1:]):
                _refuse_ranks()
            return main(argv)
        except (InputError, OSError, MemoryError) as error:
            streams.print_error(f"error: {format_message(error)}")
            return 2
        except KeyboardInterrupt:
            return 130
        finally:
            signal.signal(signal.SIGTERM, previous)

    return wrapper
