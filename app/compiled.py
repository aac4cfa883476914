"""Compiled loops: kept on disk, and compiled by one process at a time, however many ranks begin at once.

numba keeps what it has compiled beside the source, or in the user's cache where the source cannot be written to, or in
``NUMBA_CACHE_DIR``. If none of these will do, a folder of the user's in the temporary one has to.
"""

from __future__ import annotations

import fcntl
import os
import stat
import tempfile
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path

import numba
import numpy as np
from llvmlite.binding import set_option
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.options import DefaultOptions
from numba.core.runtime import rtsys

from app.errors import InputError

# Whether rows overlap is asked at run time, and eight such questions are LLVM's limit for vector instructions: too few
# for a loop that makes three rows of five.
set_option("", "-runtime-memory-check-threshold=32")
tell = None  # a command's: called once, when something has to be compiled or waited for

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
        dispatcher.compile = _one_at_a_time(dispatcher, dispatcher.compile)
        return dispatcher

    return decorate


class _Cache(FunctionCache):
    def load_overload(self, signature, context):
        """Load a function without numba's tables of all types, which take 0.1 s and only compiling needs."""
        if not hasattr(self, "_load_overload"):  # should numba change
            return super().load_overload(signature, context)
        rtsys.initialize(context)  # memory for arrays
        return self._load_overload(signature, context)


def folder_of(function):
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


def _one_at_a_time(dispatcher, compile_):
    """Let one process load or compile a function at a time: numba's cache may mix up types that two save at once."""
    name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}.lock"

    @wraps(compile_)
    def compile_alone(signature):
        with global_compiler_lock, _locked(Path(dispatcher.stats.cache_path, name)):
            try:
                return compile_(signature)
            except OSError:  # It cannot be kept, on a full disk, but is there.
                return compile_(signature)

    return compile_alone


@contextmanager
def _locked(path):
    lock = None
    with suppress(OSError):  # a file system without locks
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.open("a")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _tell()
            fcntl.flock(lock, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if lock is not None:
            lock.close()


def _tell():
    global tell
    say, tell = tell, None
    if say is not None:
        say()


class _Compiling(event.Listener):
    def on_start(self, event):
        """Say that something is compiled."""
        _tell()

    def on_end(self, event):
        """Say nothing."""


event.register("numba:compile", _Compiling())
