"""FFTW plans whose addresses compiled loops can execute.

The FFTW library comes from the package pyFFTW, which itself is not imported, to save 0.07 s.
"""

import ctypes
import weakref
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

# If pyFFTW is missing, its import raises how to get it.
_PACKAGE = PathFinder.find_spec("pyfftw") or import_module("pyfftw").__spec__
_FILE = PathFinder.find_spec("pyfftw.pyfftw", _PACKAGE.submodule_search_locations).origin
_PREFIXES = {"float64": "fftw", "float32": "fftwf"}
_ESTIMATE = 1 << 6  # FFTW_ESTIMATE of fftw3.h
_CACHE_LINE = 64  # bytes


@intrinsic
def execute(typing_context, function, plan):
    """Execute an FFTW plan in compiled code.

    `function` is the address of FFTW's ``void execute(void *plan)``, `plan` the address of the plan. If you change this
    function, clear numba's cache, because numba recompiles callers only if their own files change.
    """

    def generate(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        function_pointer = ir.FunctionType(ir.VoidType(), [pointer]).as_pointer()
        function, plan = arguments
        builder.call(builder.inttoptr(function, function_pointer), [builder.inttoptr(plan, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@cache
def _load_library(dtype):
    """Return FFTW's library for a precision, and its prefix: ``fftw`` or ``fftwf``."""
    if dtype not in _PREFIXES:
        raise ValueError(f"dtype {dtype}: must be one of {', '.join(_PREFIXES)}")
    library, prefix = ctypes.CDLL(_FILE), _PREFIXES[dtype]
    getattr(library, f"{prefix}_destroy_plan").argtypes = [ctypes.c_void_p]
    return library, prefix


def aligned(shape, dtype):
    """Return zeros that start at a cache line."""
    count = int(np.prod(shape)) * np.dtype(dtype).itemsize
    data = np.zeros(count + _CACHE_LINE, np.uint8)
    start = -data.ctypes.data % _CACHE_LINE
    return data[start : start + count].view(dtype).reshape(shape)


class FFTW:
    """Plans of FFTW in one precision: addresses, valid with this object."""

    def __init__(self, dtype):
        self._library, self._prefix = _load_library(dtype.name)
        self.execute = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{self._prefix}_execute"))

    def plans(self, cells, spectrum, length):
        """Return FFTW plans from `cells` to `spectrum` and back.

        Each row of `cells`, real or complex, is a sequence of `length` entries; its transform is a row of `spectrum`.
        FFTW estimates the plans and does not measure them, so they are the same in every process.
        """
        source, target = (
            (ctypes.c_void_p(a.ctypes.data), None, 1, a.strides[0] // a.itemsize) for a in (cells, spectrum)
        )
        head = (1, ctypes.byref(ctypes.c_int(length)), len(cells))
        forward, backward = (*head, *source, *target), (*head, *target, *source)
        if np.iscomplexobj(cells):
            return self._plan("dft", *forward, -1), self._plan("dft", *backward, 1)
        return self._plan("dft_r2c", *forward), self._plan("dft_c2r", *backward)

    def _plan(self, kind, *arguments):
        planner = getattr(self._library, f"{self._prefix}_plan_many_{kind}")
        planner.restype = ctypes.c_void_p
        plan = planner(*arguments, _ESTIMATE)
        if plan is None:
            raise RuntimeError(f"FFTW cannot plan {kind}")
        weakref.finalize(self, getattr(self._library, f"{self._prefix}_destroy_plan"), plan)
        return plan
