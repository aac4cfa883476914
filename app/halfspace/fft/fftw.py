"""FFTW for compiled code: plans, and the function that executes them, as addresses.

How to plan what has been planned before is FFTW's *wisdom*: kept beside the compiled loops, for the next process.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path
from uuid import uuid4

import numpy as np
from llvmlite import ir
from mpi4py_fft import fftw
from numba import types
from numba.extending import intrinsic

from app.base.mpi import MPI
from app.base.numba_cache import cache_folder_of

_WISDOM_ONLY = 1 << 21  # FFTW_WISDOM_ONLY
_LARGEST = 250_000  # bytes of wisdom that are worth reading: 600 plans, in 5 ms


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


class _Library:
    """FFTW of one precision, with what earlier processes have learned. Not collective.

    Parameters
    ----------
    module : module
        Of mpi4py_fft, linked to this FFTW.
    name : str
        What its functions begin with.
    folder : Path or None
        Where wisdom is kept; None: nowhere. Rank 0 adds to it when its process ends.
    """

    def __init__(self, module, name, folder):
        self._library, self._name, self.learned = ctypes.CDLL(module.__file__), name, False
        # mpi4py_fft does the same before it plans: the first such call in a process forgets all plans.
        self.call("plan_with_nthreads", 1)
        self.destroy = getattr(self._library, f"{name}_destroy_plan")
        self.destroy.argtypes = [ctypes.c_void_p]
        self.execute = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{name}_execute"))
        self._file = folder and Path(folder, f"{name}.wisdom")
        if self._file is not None:
            self._read()
            if MPI.COMM_WORLD.rank == 0:
                atexit.register(self.keep)

    def call(self, function, *arguments):
        """Call one of its functions, without the precision in its name."""
        return getattr(self._library, f"{self._name}_{function}")(*arguments)

    def plan(self, kind, *arguments):
        """Plan transforms as estimated, or as it is known from before; the last argument is for flags to be added."""
        planner = getattr(self._library, f"{self._name}_plan_many_{kind}")
        planner.restype = ctypes.c_void_p
        plan = planner(*arguments, fftw.FFTW_ESTIMATE | _WISDOM_ONLY)
        if plan is None:
            self.learned = True
            plan = planner(*arguments, fftw.FFTW_ESTIMATE)
        if plan is None:
            raise RuntimeError(f"FFTW cannot plan {kind}")
        return plan

    def _read(self):
        """Add the wisdom in the file, unless it is of another FFTW or processor, or of nobody."""
        self.call("import_wisdom_from_filename", os.fsencode(self._file))

    def keep(self):
        """Write what is new, with what others have learned meanwhile; too much is forgotten altogether."""
        if not self.learned:
            return
        self._read()
        mine = self._file.with_suffix(f".{uuid4().hex}")  # no number of a process: hosts may share the folder
        with suppress(OSError):
            if self.call("export_wisdom_to_filename", os.fsencode(mine)):
                if mine.stat().st_size > _LARGEST:
                    self._file.unlink(missing_ok=True)
                else:
                    mine.replace(self._file)
        with suppress(OSError):
            mine.unlink(missing_ok=True)


@cache
def _library(name):
    """FFTW for "float32" or "float64"."""
    known = {"float64": (fftw.fftw_xfftn, "fftw"), "float32": (fftw.fftwf_xfftn, "fftwf")}
    if name not in known:
        raise ValueError(f"dtype {name}: must be one of {', '.join(known)}")
    return _Library(*known[name], cache_folder_of(FFTW.plans))


class FFTW:
    """Plans as addresses that compiled code can execute, of the FFTW that mpi4py_fft is linked to."""

    def __init__(self, dtype):
        self._library = _library(dtype.name)
        self.execute = self._library.execute

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
        plans = (
            self._library.plan(kinds[0], *head, *there, *back, *signs[0]),
            self._library.plan(kinds[1], *head, *back, *there, *signs[1]),
        )
        for plan in plans:
            weakref.finalize(self, self._library.destroy, plan)
        return plans
