"""Folders of a user whose home is missing or read-only, or whose current folder has been removed."""

import os
import stat
from contextlib import contextmanager, suppress
from pathlib import Path


def private_folder():
    """Return a temporary folder that only this user can write, the same one in each process if possible.

    Caches contain code, so other users must not be able to write there. Raises OSError if no folder for temporary files
    is writable.
    """
    import tempfile

    name = f"elastic-contact-{os.getuid()}-"
    for number in range(3):  # others may have taken a name
        folder = Path(tempfile.gettempdir(), f"{name}{number}")
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            return folder
    return Path(tempfile.mkdtemp(prefix=name))


def ensure_home():
    """Set HOME if the system does not know this user, as in some containers.

    Without a home Open MPI crashes, matplotlib raises an error, and numba writes to a folder called ``~``.
    """
    if os.path.expanduser("~") == "~":  # noqa: PTH111  Path.expanduser raises an error
        with suppress(OSError):
            os.environ["HOME"] = str(private_folder())


def ensure_matplotlib_folder():
    """Set MPLCONFIGDIR if matplotlib's own folder is not writable.

    Otherwise every process prints a warning and searches all fonts.
    """
    if os.environ.get("MPLCONFIGDIR"):
        return
    config = os.path.expanduser(os.environ.get("XDG_CONFIG_HOME") or "~/.config")  # noqa: PTH111
    with suppress(OSError):
        folder = Path(config, "matplotlib")
        folder.mkdir(parents=True, exist_ok=True)  # as matplotlib does
        if os.access(folder, os.W_OK):
            return
    with suppress(OSError):
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
