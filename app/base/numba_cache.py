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
from functools import wraps
from pathlib import Path

import numba
import numpy as np
from llvmlite.binding import set_option
from numba.core.caching import FunctionCache
from numba.core.options import DefaultOptions
from numba.core.runtime import rtsys

from app.base.errors import InputError

# Whether rows overlap is asked at run time, and eight such questions are LLVM's limit for vector instructions: too few
# for a loop that makes three rows of five.
set_option("", "-runtime-memory-check-threshold=32")
on_first_compile = None  # a command's: called once, when something has to be compiled or waited for

# Nothing, of the types that loops are called with: fields, one that may only be read, as Vecs give, and masks.
FIELD, MASK = np.zeros((0, 1)), np.zeros((0, 1), bool)
FIXED = FIELD.view()
FIXED.flags.writeable = False


def njit(makes_arrays=False, **options):
    """``numba.njit`` with the cache, and without counting references to arrays. Not collective.

    Each row that a loop looks at is an array to numba, and to count them took half of the time on small grids. Arrays
    live as long as the call, for the caller has them; so only functions that make some, or return one, need to count.
    """
    if hasattr(DefaultOptions, "_nrt"):  # should numba change: then all functions count
        options["_nrt"] = makes_arrays

    def decorate(function):
        try:
            dispatcher = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # numba: no locator available
            numba.config.CACHE_DIR = str(_own_folder())
            dispatcher = numba.njit(cache=True, **options)(function)
        dispatcher._cache = _Cache(function)
        dispatcher.compile = _unlocking(dispatcher.compile, dispatcher._cache)
        return dispatcher

    return decorate


class _Cache(FunctionCache):
    """Cache of a function: the process that finds nothing in it compiles while the others wait, and load it then.

    numba's own may mix up the types of a function that two processes save at once.
    """

    def __init__(self, function):
        super().__init__(function)
        where = f"{function.__qualname__}-{function.__code__.co_firstlineno}"
        self._lock = Path(self.cache_path, f"{function.__module__}.{where}.lock")
        self._locked = None

    def load_overload(self, signature, context):
        """Load what has been compiled; None leaves it to the caller, who calls `save_overload`, then `unlock`."""
        found = self._loaded(signature, context)
        if found is None:
            _tell()
            with suppress(OSError):  # a file system without locks
                self._locked = self._lock.open("a")
                fcntl.flock(self._locked, fcntl.LOCK_EX)
            found = self._loaded(signature, context)
        return found

    def _loaded(self, signature, context):
        """Load without numba's tables of all types, which take 0.1 s and only compiling needs."""
        if not hasattr(self, "_load_overload"):  # should numba change
            return super().load_overload(signature, context)
        rtsys.initialize(context)  # memory for arrays
        return self._load_overload(signature, context)

    def save_overload(self, signature, result):
        """Keep what has been compiled."""
        with suppress(OSError):  # a full disk
            super().save_overload(signature, result)

    def unlock(self):
        """Let others compile."""
        if self._locked is not None:
            self._locked.close()
            self._locked = None


def _unlocking(compile_, cache):
    """Return a function that compiles and unlocks the cache, also when it is interrupted."""

    @wraps(compile_)
    def compile_and_unlock(signature):
        try:
            return compile_(signature)
        finally:
            cache.unlock()

    return compile_and_unlock


def _tell():
    global on_first_compile
    say, on_first_compile = on_first_compile, None
    if say is not None:
        say()


def cache_folder_of(function):
    """Folder that keeps, or would keep, what is compiled of a Python function; or None. Not collective."""
    with suppress(RuntimeError):  # no locator available
        return Path(FunctionCache(function).cache_path)
    return None


def check_compiler():
    """Refuse an interpreter in the place of numba's compiler: some loops have no meaning there. Not collective."""
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set: the loops of this program work compiled only; unset it")


def _own_folder():
    """A folder in the temporary one that nobody else can have put anything into: what numba loads is executed."""
    folder = Path(tempfile.gettempdir(), f"numba-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    facts = folder.lstat()
    mine = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
    return folder if mine else tempfile.mkdtemp()
