"""FFTW for compiled code: plans, and the function that executes them, as addresses."""

from __future__ import annotations

import ctypes
import weakref
from functools import cache

import numpy as np
from llvmlite import ir
from mpi4py_fft import fftw
from numba import types
from numba.extending import intrinsic

_loaded = cache(ctypes.CDLL)  # each makes types of its own, which are freed only by collecting garbage


@intrinsic
def execute(typing_context, function, plan):
    """Call ``void function(void *plan)``; both are addresses.

    After a change here numba must be told to compile its callers anew: it looks at their own files only.
    """

    def generate(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        function_pointer = ir.FunctionType(ir.VoidType(), [pointer]).as_pointer()
        function, plan = arguments
        builder.call(builder.inttoptr(function, function_pointer), [builder.inttoptr(plan, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


class FFTW:
    """Plans as addresses that compiled code can execute, of the FFTW that mpi4py_fft is linked to."""

    def __init__(self, dtype):
        known = {"float64": (fftw.fftw_xfftn, "fftw"), "float32": (fftw.fftwf_xfftn, "fftwf")}
        if dtype.name not in known:
            raise ValueError(f"dtype {dtype.name}: must be one of {', '.join(known)}")
        module, name = known[dtype.name]
        self._library, self._name = _loaded(module.__file__), name
        # mpi4py_fft does the same before it plans: the first such call in a process forgets all plans.
        getattr(self._library, f"{name}_plan_with_nthreads")(1)
        self._destroy = getattr(self._library, f"{name}_destroy_plan")
        self._destroy.argtypes = [ctypes.c_void_p]
        self.execute = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{name}_execute"))

    def plans(self, cells, spectrum, length):
        """Plan the transforms of the rows of `cells` (real or complex) to `spectrum` and back."""
        there, back = (
            (ctypes.c_void_p(a.ctypes.data), None, 1, a.strides[0] // a.itemsize) for a in (cells, spectrum)
        )
        head = (1, ctypes.byref(ctypes.c_int(length)), len(cells))
        if np.iscomplexobj(cells):
            kinds, signs = ("dft", "dft"), ((-1,), (1,))
        else:
            kinds, signs = ("dft_r2c", "dft_c2r"), ((), ())
        return (
            self._plan(kinds[0], *head, *there, *back, *signs[0], fftw.FFTW_ESTIMATE),
            self._plan(kinds[1], *head, *back, *there, *signs[1], fftw.FFTW_ESTIMATE),
        )

    def _plan(self, kind, *arguments):
        planner = getattr(self._library, f"{self._name}_plan_many_{kind}")
        planner.restype = ctypes.c_void_p
        plan = planner(*arguments)
        if plan is None:
            raise RuntimeError(f"FFTW cannot plan {kind}")
        weakref.finalize(self, self._destroy, plan)
        return plan
