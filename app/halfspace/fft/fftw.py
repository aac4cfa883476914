"""FFTW plans whose addresses compiled loops can execute."""

import ctypes
import weakref
from functools import cache

import numpy as np
from llvmlite import ir
from mpi4py_fft import fftw
from numba import types
from numba.extending import intrinsic

_MODULES = {"float64": (fftw.fftw_xfftn, "fftw"), "float32": (fftw.fftwf_xfftn, "fftwf")}


@intrinsic
def execute(typing_context, function, plan):
    """Execute an FFTW plan in compiled code.

    `function` is the address of FFTW's ``void execute(void *plan)``, `plan` that of the plan. After a change of this
    function, clear numba's cache, because numba recompiles its callers only if their own files change.
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
    """Return FFTW's library for a precision, and its functions' prefix."""
    if dtype not in _MODULES:
        raise ValueError(f"dtype {dtype}: must be one of {', '.join(_MODULES)}")
    module, prefix = _MODULES[dtype]
    library = ctypes.CDLL(module.__file__)
    # As in mpi4py_fft before it plans: the first such call in a process drops all plans.
    getattr(library, f"{prefix}_plan_with_nthreads")(1)
    getattr(library, f"{prefix}_destroy_plan").argtypes = [ctypes.c_void_p]
    return library, prefix


class FFTW:
    """Maker of FFTW plans in one precision, for compiled code.

    The plans are addresses, valid as long as this object lives.
    """

    def __init__(self, dtype):
        self._library, self._prefix = _load_library(dtype.name)
        self.execute = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{self._prefix}_execute"))

    def plans(self, cells, spectrum, length):
        """Return plans of transforms from `cells` to `spectrum` and back.

        Each row of `cells`, real or complex, is a sequence of `length` entries; its transform is a row of `spectrum`.
        Plans are estimated, not measured, so that they are the same in every process.
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
        plan = planner(*arguments, fftw.FFTW_ESTIMATE)
        if plan is None:
            raise RuntimeError(f"FFTW cannot plan {kind}")
        weakref.finalize(self, getattr(self._library, f"{self._prefix}_destroy_plan"), plan)
        return plan
