"""Errors of one line for packages that are missing, or compiled for another numpy.

A package compiled for numpy 1 does not load with numpy 2, as pip may install beside Debian's packages. numpy then
prints a long notice and a traceback for each of its modules.
"""

import io
import os
import sys
from contextlib import redirect_stderr, suppress
from functools import partial
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path

from app.base.mpi import single_host_variables, temporary_environment

HOW_TO_GET = {
    "petsc4py": "Debian: apt-get install python3-petsc4py-real, for Debian's own python3 or a venv of it with "
    "--system-site-packages; conda-forge: conda install petsc4py; "
    "elsewhere: pip install petsc petsc4py, which compiles PETSc (docs/install.md)",
    "h5py": "Debian: apt-get install python3-h5py-mpi; conda-forge: conda install 'h5py=*=mpi*'; "
    "elsewhere: pip install h5py, with which ranks write in turn (docs/install.md)",
}
_COMPILED = {"h5py", "matplotlib", "mpi4py_fft", "numba", "petsc4py", "scipy"}


class Missing:
    """The last of Python's finders: a missing package is an error that says how to get it."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Raise `PackageMissing` for these packages; find nothing."""
        if name in HOW_TO_GET:
            from app.base.errors import PackageMissing

            _refuse(PackageMissing(f"{name} is not installed. {HOW_TO_GET[name]}", name=name))


class Compiled:
    """The first of Python's finders: a package that does not load with this numpy is one error."""

    _loading = False  # a package's own imports are part of its import

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        """Find these packages as usual, and check how they load."""
        if cls._loading or name.partition(".")[0] not in _COMPILED:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = partial(cls._load, name, spec.loader.exec_module)
        return spec

    @classmethod
    def _load(cls, name, exec_module, module):
        cls._loading, printed, error = True, io.StringIO(), None
        try:
            # h5py, mpi4py_fft and petsc4py start MPI.
            with redirect_stderr(printed), temporary_environment(single_host_variables(os.environ)):
                exec_module(module)
                if name == "scipy" and "numpy" in printed.getvalue().lower():
                    import_module("scipy.linalg")  # scipy itself only warns, its compiled parts fail
        except (ImportError, AttributeError, RuntimeError, ValueError) as failure:
            if "numpy" not in f"{failure} {printed.getvalue()}".lower():
                raise
            error = mismatch(name.partition(".")[0])
        finally:
            cls._loading = False
            if error is None and printed.getvalue():
                with suppress(OSError):  # a full disk, or nobody who reads
                    sys.stderr.write(printed.getvalue())
        if error is not None:
            _refuse(error)


def mismatch(name):
    """Return the error of a package that was compiled for another numpy."""
    import numpy

    from app.base.errors import PackageError

    package = PathFinder.find_spec(name).submodule_search_locations[0]
    folder, of_numpy = (str(Path(place).parent) for place in (package, *numpy.__path__))
    remedy = "install releases of both that fit (docs/install.md)"
    others = [place for place in sys.path if place != of_numpy]
    if (
        sys.prefix != sys.base_prefix
        and of_numpy.startswith(sys.prefix)
        and PathFinder.find_spec("numpy", others)
    ):
        remedy = "remove that numpy (pip uninstall numpy), and install what needs it in another environment"
    text = f"{name} in {folder} does not work with numpy {numpy.__version__} in {of_numpy}: {remedy}"
    return PackageError(text, name=name)


def _refuse(error):
    """Raise an error; a command whose imports fail prints it instead, and exits with status 2."""
    main = sys.modules.get("__main__")
    name = getattr(getattr(main, "__spec__", None), "name", None) or ""
    if name.startswith("app.") and not hasattr(main, "main"):
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    raise error from None


def install():
    """Put both finders in their places, once."""
    if Missing not in sys.meta_path:
        sys.meta_path[:] = [Compiled, *sys.meta_path, Missing]
