"""Command lines in the style of the shell (``--jobs 2``), and how these commands end. Not collective."""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import signal
import sys

from app.errors import InputError, one_line


class Parser(argparse.ArgumentParser):
    """Complains like everything else; takes -1,2 for a value."""

    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message):
        """Raise InputError."""
        raise InputError(message)


def count(text):
    """Kind of a command line argument: a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: not allowed; allowed: a whole number of at least 1")
    return int(text)


def seconds(text):
    """Kind of a command line argument: a positive number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: not allowed; allowed: a positive number")
    return value


def check_ranks(ranks):
    """Refuse several ranks where there is no mpiexec."""
    if ranks > 1 and not shutil.which("mpiexec"):
        raise InputError(f"--ranks {ranks}: there is no mpiexec on PATH")


def check_folder(folder):
    """Refuse a folder (-o) that cannot be written to; it may not exist yet."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"-o {folder}: exists and is not a folder")
    if not folder.parent.is_dir():
        raise InputError(f"-o {folder}: folder {folder.parent} does not exist")
    if not os.access(folder if folder.exists() else folder.parent, os.W_OK):
        raise InputError(f"-o {folder}: cannot be written to")


def interruptible(main, argv=None):
    """Call a command's ``main(argv)`` so that SIGTERM ends it like Ctrl-C; return its exit status."""
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return main(argv)
    except InputError as error:
        print(f"error: {one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    finally:
        signal.signal(signal.SIGTERM, previous)
