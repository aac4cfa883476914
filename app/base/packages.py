"""One-line errors for missing or incompatible packages.

Debian's packages are compiled for numpy 1. They do not load with numpy 2, which pip may have installed in addition.
numpy then prints a long notice and a traceback for each module of such a package.
"""

import io
import os
import sys
import warnings
from contextlib import contextmanager, redirect_stderr, suppress
from functools import partial
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path

from app.base import mpi, user_folder
from app.base.missing_packages import SOURCES, missing

_COMPILED = {"h5py", "matplotlib", "numba", "petsc4py", "scipy"}


class MissingPackageFinder:
    """Import finder asked last, whose error says how to install a package."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Raise `PackageMissing` for a package of `SOURCES`."""
        if name == "petsc4py":
            mpi.MPI  # noqa: B018  reports a missing MPI library, too
        if name in SOURCES and name != "mpi4py":
            _raise(missing(name))


class CompiledPackageFinder:
    """First import finder; reports packages compiled for another numpy."""

    _loading = False  # a package's own imports are part of its import

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        """Find a compiled package, with a loader that also checks it."""
        if cls._loading or name.partition(".")[0] not in _COMPILED:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.origin is None:  # a folder without code
            return MissingPackageFinder.find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = partial(cls._load, name, spec.loader.exec_module)
        return spec

    @classmethod
    def _load(cls, name, exec_module, module):
        """Import a module; shorten an error due to a wrong numpy."""
        if name == "petsc4py":
            mpi.MPI  # noqa: B018  in a wheel, petsc4py needs the library that mpi4py loads
        if name == "matplotlib":
            user_folder.ensure_matplotlib_folder()
        cls._loading, printed, error = True, io.StringIO(), None
        try:
            # h5py and petsc4py start MPI.
            changes = mpi.single_host_variables(os.environ)
            with (
                redirect_stderr(printed), mpi.temporary_environment(changes), _warnings_without_errors(),
                user_folder.existing_folder(),
            ):  # fmt: skip
                exec_module(module)
                if name == "scipy" and "numpy" in printed.getvalue().lower():
                    import_module("scipy.linalg")  # scipy itself only warns, its compiled parts fail
        except (ImportError, AttributeError, RuntimeError, ValueError) as failure:
            if "numpy" not in f"{failure} {printed.getvalue()}".lower():
                raise
            error = numpy_mismatch(name.partition(".")[0])
        finally:
            cls._loading = False
            if error is None and printed.getvalue():
                with suppress(OSError):  # a full disk or a closed pipe
                    sys.stderr.write(printed.getvalue())
        if error is not None:
            _raise(error)


@contextmanager
def _warnings_without_errors():
    """Let packages import deprecated modules even if the user has turned warnings into errors."""
    if not any(entry[0] == "error" for entry in warnings.filters):
        yield
        return
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        for kind in (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ImportWarning):
            warnings.simplefilter("ignore", kind)
        yield


def numpy_mismatch(name):
    """Return the error of a package that was compiled for another numpy."""
    import numpy

    from app.base.errors import PackageError

    package = PathFinder.find_spec(name).submodule_search_locations[0]
    folder, numpy_folder = (str(Path(path).parent) for path in (package, *numpy.__path__))
    remedy = "install releases of both that fit (docs/install.md)"
    other_folders = [path for path in sys.path if path != numpy_folder]
    in_venv = sys.prefix != sys.base_prefix and numpy_folder.startswith(sys.prefix)
    if in_venv and PathFinder.find_spec("numpy", other_folders):
        remedy = "remove that numpy (pip uninstall numpy), and install what needs it in another environment"
    text = f"{name} in {folder} does not work with numpy {numpy.__version__} in {numpy_folder}: {remedy}"
    return PackageError(text, name=name)


def _raise(error):
    """Raise an error; in commands, print it and exit."""
    main = sys.modules.get("__main__")
    name = getattr(getattr(main, "__spec__", None), "name", None) or ""
    if name.startswith("app.") and not hasattr(main, "main"):
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    raise error from None


def install():
    """Put this module's import finders on ``sys.meta_path``, once."""
    if MissingPackageFinder not in sys.meta_path:
        sys.meta_path[:] = [CompiledPackageFinder, *sys.meta_path, MissingPackageFinder]
