"""FFTW plans for compiled code, as addresses.

FFTW's *wisdom*, its knowledge of earlier plans, is stored with the compiled loops for the next process.
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
_MAX_WISDOM = 250_000  # bytes: 600 plans, read in 5 ms


@intrinsic
def execute(typing_context, function, plan):
    """Call ``void function(void *plan)``; both are addresses.

    After a change here, clear numba's cache: it recompiles callers only if their own files change.
    """

    def generate(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        function_pointer = ir.FunctionType(ir.VoidType(), [pointer]).as_pointer()
        function, plan = arguments
        builder.call(builder.inttoptr(function, function_pointer), [builder.inttoptr(plan, pointer)])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


class _Library:
    """FFTW of one precision, with the wisdom of earlier processes.

    Parameters
    ----------
    module : module
        Module of mpi4py_fft that is linked to this FFTW.
    name : str
        Prefix of its functions.
    folder : Path or None
        Folder of the wisdom, if any. Rank 0 adds to it when its process ends.
    """

    def __init__(self, module, name, folder):
        self._library, self._name, self.learned = ctypes.CDLL(module.__file__), name, False
        # As in mpi4py_fft before it plans: the first such call in a process drops all plans.
        self.call("plan_with_nthreads", 1)
        self.destroy = getattr(self._library, f"{name}_destroy_plan")
        self.destroy.argtypes = [ctypes.c_void_p]
        self.execute = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{name}_execute"))
        self._file = folder and Path(folder, f"{name}.wisdom")
        if self._file is not None:
            self._read()
            if MPI.COMM_WORLD.rank == 0:
                atexit.register(self.save_wisdom)

    def call(self, function, *arguments):
        """Call a function by its name without the precision."""
        return getattr(self._library, f"{self._name}_{function}")(*arguments)

    def plan(self, kind, *arguments):
        """Plan transforms from wisdom, else by an estimate."""
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
        # This fails without harm if the wisdom is missing, or of another FFTW or processor.
        self.call("import_wisdom_from_filename", os.fsencode(self._file))

    def save_wisdom(self):
        """Save new wisdom, merged with that of other processes.

        Files that are too large are deleted.
        """
        if not self.learned:
            return
        self._read()
        temporary = self._file.with_suffix(
            f".{uuid4().hex}"
        )  # not a process number: hosts may share the folder
        with suppress(OSError):
            if self.call("export_wisdom_to_filename", os.fsencode(temporary)):
                if temporary.stat().st_size > _MAX_WISDOM:
                    self._file.unlink(missing_ok=True)
                else:
                    temporary.replace(self._file)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@cache
def _library(name):
    modules = {"float64": (fftw.fftw_xfftn, "fftw"), "float32": (fftw.fftwf_xfftn, "fftwf")}
    if name not in modules:
        raise ValueError(f"dtype {name}: must be one of {', '.join(modules)}")
    return _Library(*modules[name], cache_folder_of(FFTW.plans))


class FFTW:
    """FFTW plans as addresses that compiled code can execute."""

    def __init__(self, dtype):
        self._library = _library(dtype.name)
        self.execute = self._library.execute

    def plans(self, cells, spectrum, length):
        """Plan transforms of rows of `cells` to `spectrum` and back."""
        source, target = (
            (ctypes.c_void_p(a.ctypes.data), None, 1, a.strides[0] // a.itemsize) for a in (cells, spectrum)
        )
        head = (1, ctypes.byref(ctypes.c_int(length)), len(cells))
        if np.iscomplexobj(cells):
            kinds, signs = ("dft", "dft"), ((-1,), (1,))
        else:
            kinds, signs = ("dft_r2c", "dft_c2r"), ((), ())
        plans = (
            self._library.plan(kinds[0], *head, *source, *target, *signs[0]),
            self._library.plan(kinds[1], *head, *target, *source, *signs[1]),
        )
        for plan in plans:
            weakref.finalize(self, self._library.destroy, plan)
        return plans
