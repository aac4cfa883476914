"""Compile loops by numba, and cache them on disk.

One process at a time compiles and saves a function. numba's cache is in the folder ``NUMBA_CACHE_DIR`` if it is set.
Otherwise the cache is in the folder of the source. If the source is read-only, its cache is read, and new code is saved
in the user's cache folder. If none of these folders is writable, new code is saved in a private folder for temporary
files. A damaged file of the cache counts as missing.

Times of solves are differences of `clock`, which stands still while loops are loaded or compiled.
"""

import atexit
import fcntl
import math
import os
import pickle
import sys
import threading
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial, wraps
from pathlib import Path
from types import FunctionType
from typing import NamedTuple

import numba
import numpy as np
from llvmlite.binding import ObjectFileRef, set_option
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.compiler import compile_result
from numba.core.runtime import rtsys

from app.base.errors import InputError, is_first_rank
from app.base.user_folder import private_folder

_MIN_REPORTED = 0.5  # shortest time of compilation that is printed [s]

# LLVM vectorises a loop only if it needs few run-time checks for overlapping rows: eight by default. A loop that makes
# three rows of five needs more.
set_option("", "-runtime-memory-check-threshold=32")


def _note(text):
    """Print a note on standard error of rank 0."""
    if is_first_rank():
        with suppress(OSError):  # standard error is closed
            print(f"note: {text}", file=sys.stderr, flush=True)


def announce_compilation():
    """Print on rank 0 that loops are compiled; `report_compilation` prints how long."""
    _note("compiling loops, once; this may take a minute")
    _times.reported = 0.0
    atexit.register(report_compilation)


on_first_compile = announce_compilation  # is called once, before the first loop is compiled or waited for


class _Times(threading.local):
    """Times of one thread [s]."""

    loading = 0.0  # in which the thread has loaded and compiled loops
    compiling = 0.0  # the part in which loops were compiled or waited for
    reported = math.inf  # part of `compiling` that has been printed; inf until the first announcement
    started = None  # when the outermost call began to load a loop
    missed = False  # whether that call has found a loop that is not in the cache


_times = _Times()


def clock():
    """Return a time [s] that stands still while loops are loaded or compiled."""
    return time.perf_counter() - _times.loading


def compile_seconds():
    """Return how long this thread has compiled loops; 0 if that was not long."""
    return _times.compiling if _times.compiling > _MIN_REPORTED else 0.0


def report_compilation():
    """Print how long loops were compiled since the last report, unless that was short."""
    if (seconds := _times.compiling - _times.reported) > _MIN_REPORTED:
        _note(f"compiling, once: {seconds:.3g} s")
        _times.reported = _times.compiling


def njit(makes_arrays=False, **options):
    """Compile by ``numba.njit``, with the cache, without counting references.

    Counting the references to each row took half of the time on small grids. Counting is not necessary, because the
    caller holds the arrays during the call. Functions that make or return arrays must count references; for them, set
    `makes_arrays`.

    A function is compiled once for calls from Python, and once for calls from other loops, which need no wrapper for
    Python. The wrapper takes a tenth of the time to compile, and most functions are called in only one of these ways.
    """
    options["_nrt"] = makes_arrays  # not a public option of numba
    options["no_cfunc_wrapper"] = True  # only functions called by address need this wrapper

    def compiled(function, cache_class, **more):
        dispatcher = numba.njit(**options, **more)(function)
        dispatcher.compile = _with_cache(dispatcher, cache_class)
        return dispatcher

    def decorate(function):
        dispatcher = compiled(function, MachineCodeCache)
        inner = cache(lambda: compiled(_renamed(function, "inner"), LockedCache, no_cpython_wrapper=True))
        dispatcher.get_call_template = lambda args, kws: inner().get_call_template(*unliteral(args, kws))
        dispatcher.get_overload = lambda signature: inner().get_overload(signature)
        return dispatcher

    return decorate


def _with_cache(dispatcher, cache_class):
    """Return a function that compiles with the cache, always unlocking it."""
    compile_, function = dispatcher.compile, dispatcher.py_func

    @wraps(compile_)
    def load_or_compile(signature):
        outermost = _times.started is None
        if outermost:
            _times.started, _times.missed = time.perf_counter(), False
        try:
            if not isinstance(dispatcher._cache, cache_class):  # the first time: most loops are never called
                with suppress(OSError):  # no folder is writable: compile without a cache
                    dispatcher._cache = _make_cache(function, cache_class)
            return compile_(signature)
        finally:
            if isinstance(dispatcher._cache, cache_class):
                dispatcher._cache.unlock()
            if outermost:
                seconds, _times.started = time.perf_counter() - _times.started, None
                _times.loading += seconds
                _times.compiling += seconds if _times.missed else 0.0

    return load_or_compile


def _make_cache(function, cache_class):
    """Return a function's cache, in a temporary folder if others are read-only."""
    try:
        return cache_class(function)
    except RuntimeError:  # numba finds no folder for its cache
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(private_folder() / "numba")
    try:
        return cache_class(function)
    finally:
        numba.config.CACHE_DIR = before


def unliteral(args, kws):
    """Return argument types without literals, which would each cost a compilation."""
    return tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()}


def _renamed(function, suffix):
    """Return a copy of a function with another name and cache."""
    copy = FunctionType(
        function.__code__, function.__globals__, f"{function.__name__}_{suffix}", function.__defaults__,
        function.__closure__,
    )  # fmt: skip
    copy.__module__, copy.__qualname__ = function.__module__, f"{function.__qualname__}_{suffix}"
    return copy


class _Memory:
    def __init__(self, array):
        self.array = array  # owns the memory
        address, _ = array.__array_interface__["data"]
        self.__array_interface__ = array.__array_interface__ | {"data": (address, False)}


def as_writable(array):
    """Return a read-only array as a writable array.

    This is for loops that do not write to the array; numba would compile these loops once more for read-only arrays.
    """
    return np.asarray(_Memory(array))


class CheckedFiles(IndexDataCacheFile):
    """Files of a function's cache, each with a checksum at its end.

    The checksum includes the file's name, the source and numba's version. A file with another checksum is damaged or
    belongs to something else, and counts as missing. `fallback` is a cache that is read if this one lacks the code.
    """

    def __init__(self, folder, name, source_stamp, fallback=None):
        super().__init__(folder, name, source_stamp)
        self._fallback = fallback

    def load(self, key):
        """Return the data of a key, or None."""
        found = super().load(key)
        return self._fallback.load(key) if found is None and self._fallback else found

    def _load_index(self):
        return self._read(self._index_path) or {}

    def _save_index(self, overloads):
        self._write(self._index_path, overloads)

    def _load_data(self, name):
        return self._read(self._data_path(name))

    def _save_data(self, name, data):
        self._write(self._data_path(name), data)

    def _checksum(self, path, content):
        owner = Path(path).name, self._version, self._source_stamp
        return zlib.crc32(content, zlib.crc32(repr(owner).encode())).to_bytes(4, "big")

    def _read(self, path):
        with suppress(Exception):  # a file that is missing, or data of another library's classes
            content = Path(path).read_bytes()
            if content[-4:] == self._checksum(path, content[:-4]):
                return pickle.loads(content)
        return None

    def _write(self, path, data):
        content = self._dump(data)
        with self._open_for_write(path) as file:
            file.write(content + self._checksum(path, content))


class LockedCache(FunctionCache):
    """numba's cache of a function, locked during compilation.

    Without the lock, two processes that save a function at the same time may corrupt the cache's index of types.
    """

    def __init__(self, function):
        super().__init__(function)
        locator = self._impl.locator
        files = partial(CheckedFiles, name=self._impl.filename_base, source_stamp=locator.get_source_stamp())
        source_folder, fallback = Path(function.__code__.co_filename).parent / "__pycache__", None
        if not os.environ.get("NUMBA_CACHE_DIR") and Path(self.cache_path) != source_folder:
            fallback = files(source_folder)
        self._cache_file = files(self.cache_path, fallback=fallback)
        place = f"{function.__qualname__}-{function.__code__.co_firstlineno}"
        self._lock = Path(self.cache_path, f"{function.__module__}.{place}.lock")
        self._locked = None

    def load_overload(self, signature, context):
        """Return compiled code from the cache, or None if it has none.

        If it has none, the cache is locked. The caller then compiles the function, and unlocks the cache.
        """
        global on_first_compile
        loaded = self._load(signature, context)
        if loaded is None:
            _times.missed = True
            callback, on_first_compile = on_first_compile, None
            if callback is not None:
                callback()
            with suppress(OSError):  # a file system without locks
                self._locked = self._lock.open("a")
                fcntl.flock(self._locked, fcntl.LOCK_EX)
            loaded = self._load(signature, context)
        return loaded

    def _load(self, signature, context):
        """Load compiled code without numba's tables of types, to save 0.1 s."""
        rtsys.initialize(context)  # allocator of arrays
        return self._load_overload(signature, context)

    def save_overload(self, signature, result):
        """Save compiled code in the cache."""
        with suppress(OSError):  # a full disk
            super().save_overload(signature, result)

    def unlock(self):
        """Release the lock, if this process holds it."""
        if self._locked is not None:
            self._locked.close()
            self._locked = None


class MachineCodeCache(LockedCache):
    """Cache of the machine code of a function that is called from Python only.

    numba's own cache also has code for other functions to link. Parsing it takes most of the time to load a function.
    """

    class _impl_class(CompileResultCacheImpl):
        def reduce(self, result):
            """Return the data to save, in numba's order."""
            match super().reduce(result):
                case ((name, "object", (machine_code, _)), *others, tuple(environments)) if _engine_of(
                    result.codegen
                ):
                    # Drop environments without constants: unpickling each one would import a module.
                    used = tuple(e for e in environments if e.consts)
                    return (name, "object", (machine_code, None)), *others, used
                case other:  # Another release of numba has another format; keep it.
                    return other

        def rebuild(self, context, saved):
            """Return a function from its machine code."""
            match saved:
                case (
                    (name, "object", (machine_code, None)),
                    description,
                    environment,
                    signature,
                    *_,
                    environments,
                ):
                    engine = _engine_of(context.codegen())
                case _:
                    return super().rebuild(context, saved)
            engine.add_object_file(ObjectFileRef.from_data(machine_code))
            library = LoadedLibrary(name, context.codegen(), engine.get_function_address)
            for other in environments:
                library.codegen.set_env(other.env_name, other)
            return compile_result(
                typing_context=context.typing_context,
                target_context=context,
                entry_point=context.get_executable(library, description, environment),
                signature=signature,
                objectmode=False,
                lifted=(),
                fndesc=description,
                library=library,
                environment=environment,
                referenced_envs=environments,
            )


class LoadedLibrary(NamedTuple):
    """Part of numba's library interface that a loaded function needs."""

    name: str
    codegen: object
    get_pointer_to_function: Callable


def _engine_of(codegen):
    """Return LLVM's execution engine, or None (not a public attribute)."""
    return getattr(getattr(codegen, "_engine", None), "_ee", None)


def check_compiler():
    """Raise if numba does not compile; some loops need compiled arithmetic."""
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set: the loops of this program work compiled only; unset it")
