"""Standard input, output and error that may be closed, full or unread; neither MPI nor PETSc is needed."""

from __future__ import annotations

import os
import re
import sys

# What Python calls an option, and the option in brackets. Bounds keep the search linear in the text.
_ALSO = re.compile(r"\b\w{1,60}=\S{0,80} \((-[^()]*)\)")


def reopen_closed():
    """Open what of the three is closed; to be called first: the next file opened would take its place. Not collective.

    A result file in the place of standard error would receive the messages of every library.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


def print_output(text):
    """Print on standard output as long as that can be done; no reason to fail. Not collective."""
    try:
        print(text, flush=True)
    except OSError as error:
        # What is computed is still wanted. `| head` has had enough; a full disk is worth a word.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            print_error(f"warning: standard output: {error.strerror}")


def print_error(line):
    """Print a line on standard error, if there is anybody to read it, options by their own names. Not collective.

    Messages are of what Python calls, too: ``level='plane' (-surface_level plane)``, of which the option is printed.
    """
    try:
        print(_ALSO.sub(r"\1", line), file=sys.stderr, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
