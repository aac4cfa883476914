"""Folders of a user whose home is missing or read-only, or whose current folder has been removed."""

import os
import stat
from contextlib import contextmanager
from itertools import count
from pathlib import Path


def private_folder():
    """Return a temporary folder that lasts, and that only this user can write.

    Caches contain code, so other users must not be able to write there. Raises OSError if no folder for temporary files
    is writable.
    """
    import tempfile

    for number in count():
        folder = Path(tempfile.gettempdir(), f"elastic-contact-{os.getuid()}-{number}")
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            return folder


def ensure_home():
    """Set HOME if the system does not know this user, as in some containers.

    Without a home Open MPI crashes, matplotlib raises an error, and numba writes to a folder called ``~``.
    """
    if os.path.expanduser("~") == "~":  # noqa: PTH111  Path.expanduser raises an error
        os.environ["HOME"] = str(private_folder())


def ensure_matplotlib_folder():
    """Set MPLCONFIGDIR if matplotlib's own folder is not writable.

    Otherwise every process prints a warning and searches all fonts.
    """
    if os.environ.get("MPLCONFIGDIR"):
        return
    folder = Path(os.environ.get("XDG_CONFIG_HOME") or "~/.config", "matplotlib").expanduser()
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    if not os.access(existing, os.W_OK):
        os.environ["MPLCONFIGDIR"] = str(private_folder() / "matplotlib")


@contextmanager
def existing_folder():
    """Leave the current folder during a ``with`` block if it has been removed; PETSc does not work there."""
    try:
        os.getcwd()  # noqa: PTH109
    except OSError:
        here = os.open(".", os.O_RDONLY)
        try:
            os.chdir("/")
            yield
        finally:
            os.fchdir(here)
            os.close(here)
    else:
        yield
