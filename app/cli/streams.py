"""Printing on standard streams, which may be closed, full or not read."""

import os
import re
import sys

# A keyword argument and its option in parentheses. Bounds keep the search linear.
_KEYWORD_AND_OPTION = re.compile(r"\b\w{1,60}=\S{0,80} \((-[^()]*)\)")


def reopen_closed():
    """Reopen standard streams that are closed.

    Otherwise a file that is opened later could get the number of a stream.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets this number, the lowest free one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


def print_output(text):
    """Print on standard output; warn of full disks."""
    try:
        print(text, flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            print_error(f"warning: standard output: {error.strerror}")


def print_error(line):
    """Print a line on standard error; ignore failures.

    If a message names a keyword argument and its option, as in ``level='plane' (-surface_level plane)``, only the
    option is printed.
    """
    try:
        print(_KEYWORD_AND_OPTION.sub(r"\1", line), file=sys.stderr, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
