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
from llvmlite.binding import parse_bitcode, set_option
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.options import DefaultOptions
from numba.core.runtime import rtsys

from app.errors import InputError

# Releases of numba with an inside as it is used here; any other loads in its own way, half a second slower.
_KNOWN = (0, 56) <= numba.version_info.short <= (0, 68)
# Whether rows overlap is asked at run time, and eight such questions are LLVM's limit for vector instructions: too few
# for a loop that makes three rows of five.
set_option("", "-runtime-memory-check-threshold=32")
tell = None  # a command's: called once, when something has to be compiled or waited for

# Nothing, of the types that loops are called with: fields, one that may only be read, as Vecs give, masks, and rows.
FIELD, MASK, ROW = np.zeros((0, 1)), np.zeros((0, 1), bool), np.zeros(0)
FIXED = FIELD.view()
FIXED.flags.writeable = False


def njit(makes_arrays=False, **options):
    """``numba.njit`` with the cache, and without counting who refers to an array. Not collective.

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
        with suppress(AttributeError):  # should numba change: then every rank compiles for itself
            dispatcher._cache = _OneAtATime(dispatcher._cache, makes_arrays)
            dispatcher.compile = dispatcher._cache.let_go_after(dispatcher.compile)
        return dispatcher

    return decorate


def folder_of(function):
    """Folder that keeps, or would keep, what is compiled of a Python function; or None. Not collective."""
    with suppress(RuntimeError, AttributeError):  # no locator available; should numba change
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


def _tell():
    global tell
    say, tell = tell, None
    if say is not None:
        say()


def _load_to_run(cache, signature, context):
    """Load a function to be called, without what only compiling others needs: a third of the start of a solve.

    That is numba's knowledge of all types and functions, and the intermediate code of this one.
    """
    if not _KNOWN:
        return cache.load_overload(signature, context)
    codegen = context.codegen()
    if codegen._library_class is JITCodeLibrary:
        codegen._library_class = _Library
    rtsys.initialize(context)  # memory for arrays; from numba 0.57 on left to what is not loaded here
    return cache._load_overload(signature, context)


class _Library(JITCodeLibrary):
    """Machine code; the intermediate code beside it is looked at when another function wants it."""

    _unread = None

    @classmethod
    def _unserialize(cls, codegen, state):
        name, kind, data = state
        if kind != "object":
            return super()._unserialize(codegen, state)
        self = codegen.create_library(name)
        machine_code, self._unread = data
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        return self

    def get_pointer_to_function(self, name):
        """Return the address of a function in the machine code."""
        if self._unread is None:
            return super().get_pointer_to_function(name)
        return self._codegen._engine.get_function_address(name)

    def _get_module_for_linking(self):
        if self._unread is not None:
            self._shared_module, self._unread = parse_bitcode(self._unread), None
            self._codegen._engine._load_defined_symbols(self._shared_module)
        return super()._get_module_for_linking()


@contextmanager
def _no_environments(result):
    """Let what is kept of a function not refer to the modules of numba that it was made from.

    They would all be imported with it. Only a function that Python objects occur in asks for them.
    """
    if not _KNOWN:
        yield
        return
    kind, name = type(result), "_find_referenced_environments"
    find = getattr(kind, name)
    setattr(kind, name, lambda self: [found for found in find(self) if found.consts])
    try:
        yield
    finally:
        setattr(kind, name, find)


class _OneAtATime:
    """The cache of a function: who finds nothing in it compiles while the others wait, and they load it then."""

    def __init__(self, cache, makes_arrays):
        self._cache, self._lock = cache, None
        key = cache._index_key  # which does not look at options
        cache._index_key = lambda signature, codegen: (*key(signature, codegen), makes_arrays)

    def __getattr__(self, name):
        return getattr(self._cache, name)

    def load_overload(self, signature, context):
        """Load what has been compiled; None leaves it to the caller, who comes back with `save_overload`."""
        found = _load_to_run(self._cache, signature, context)
        if found is not None:
            return found
        _tell()
        with suppress(OSError):  # a file system without locks
            self._lock = Path(self._cache.cache_path, f"{self._cache._impl.filename_base}.lock").open("a")  # noqa: SIM115
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        return self._cache.load_overload(signature, context)

    def save_overload(self, signature, result):
        """Keep what has been compiled."""
        with suppress(OSError), _no_environments(result):  # OSError: a full disk
            self._cache.save_overload(signature, result)

    def let_go_after(self, compile_):
        """Return a function that compiles and lets go of the lock, also when it is interrupted."""

        @wraps(compile_)
        def compile_and_let_go(signature):
            try:
                return compile_(signature)
            finally:
                self._release()

        return compile_and_let_go

    def _release(self):
        if self._lock is not None:
            self._lock.close()
            self._lock = None
