"""Compiled loops: kept on disk, and compiled by one process at a time, however many ranks begin at once.

numba keeps what it has compiled beside the source, or in the user's cache where the source cannot be written to, or in
``NUMBA_CACHE_DIR``. If none of these will do, a folder of the user's in the temporary one has to.
"""

from __future__ import annotations

import fcntl
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

import numba

tell = None  # a command's: called once, when something has to be compiled or waited for


def njit(**options):
    """``numba.njit`` with the cache. Not collective."""

    def decorate(function):
        try:
            dispatcher = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # numba: no locator available
            numba.config.CACHE_DIR = str(_own_folder())
            dispatcher = numba.njit(cache=True, **options)(function)
        with suppress(AttributeError):  # should numba change: then every rank compiles for itself
            dispatcher._cache = _OneAtATime(dispatcher._cache)
        return dispatcher

    return decorate


def _own_folder():
    """A folder in the temporary one that nobody else can have put anything into: what numba loads is executed."""
    folder = Path(tempfile.gettempdir(), f"numba-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    facts = folder.lstat()
    mine = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
    return folder if mine else tempfile.mkdtemp()


def _tell():
    global tell
    say, tell = tell, None
    if say is not None:
        say()


class _OneAtATime:
    """The cache of a function: who finds nothing in it compiles while the others wait, and they load it then."""

    def __init__(self, cache):
        self._cache, self._lock = cache, None

    def __getattr__(self, name):
        return getattr(self._cache, name)

    def load_overload(self, signature, context):
        """Load what has been compiled; None leaves it to the caller, who comes back with `save_overload`."""
        found = self._cache.load_overload(signature, context)
        if found is not None:
            return found
        _tell()
        with suppress(OSError):  # a file system without locks
            self._lock = Path(self._cache.cache_path, f"{self._cache._impl.filename_base}.lock").open("a")  # noqa: SIM115
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        found = self._cache.load_overload(signature, context)
        if found is not None:
            self._release()
        return found

    def save_overload(self, signature, result):
        """Keep what has been compiled."""
        with suppress(OSError):  # a full disk
            self._cache.save_overload(signature, result)
        self._release()

    def _release(self):
        if self._lock is not None:
            self._lock.close()
            self._lock = None
