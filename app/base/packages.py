"""One-line errors of missing or incompatible packages.

Debian's packages are compiled for numpy 1 and do not load with numpy 2, which pip may have installed in addition. numpy
then prints a long notice and a traceback for each module of such a package.
"""

import io
import os
import platform
import sys
from contextlib import redirect_stderr, suppress
from functools import partial
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path

from app.base.mpi import single_host_variables, temporary_environment

# Package -> what to install for it: by apt-get, from conda-forge, as wheels, and by pip otherwise.
_SOURCES = {
    "mpi4py": ("python3-mpi4py", "mpi4py", "mpich", "mpich"),  # pip's mpi4py has no MPI library
    "petsc4py": (
        "python3-petsc4py-real",
        "'petsc=*=real*' petsc4py",
        "dolfinx-solver-real",
        "petsc petsc4py",
    ),
    "h5py": ("python3-h5py-mpi", "'h5py=*=mpi*'", "h5py", "h5py"),
    "pyfftw": ("python3-pyfftw", "pyfftw", "pyfftw", "pyfftw"),
}
_COMPILED = {"h5py", "matplotlib", "numba", "petsc4py", "scipy"}


class MissingPackageFinder:
    """Last import finder: its error says how to install a package."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Raise `PackageMissing` for a package of `_SOURCES`."""
        if name == "petsc4py":
            import_module("app.base.mpi").MPI  # noqa: B018  reports a missing MPI library, too
        if name in _SOURCES and name != "mpi4py":
            _raise(missing(name))


class CompiledPackageFinder:
    """First import finder: it reports compiled packages that do not fit numpy."""

    _loading = False  # a package's own imports are part of its import

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        """Find a compiled package, and make its loader check it."""
        if cls._loading or name.partition(".")[0] not in _COMPILED:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = partial(cls._load, name, spec.loader.exec_module)
        return spec

    @classmethod
    def _load(cls, name, exec_module, module):
        """Import a module; replace errors of a wrong numpy by one line."""
        if name == "petsc4py":
            import_module("app.base.mpi").MPI  # noqa: B018  in a wheel, petsc4py needs the library that mpi4py loads
        cls._loading, printed, error = True, io.StringIO(), None
        try:
            # h5py and petsc4py start MPI.
            with redirect_stderr(printed), temporary_environment(single_host_variables(os.environ)):
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


def missing(name):
    """Return the error of a missing package, with the command that installs all missing ones here.

    If mpi4py itself is installed, `name` "mpi4py" means that the MPI library is missing.
    """
    from app.base.errors import PackageMissing

    names = [other for other in _SOURCES if other == name or PathFinder.find_spec(other) is None]
    shown = ["an MPI library" if other == "mpi4py" else other for other in names]
    return PackageMissing(f"not installed: {', '.join(shown)}. {how_to_get(*names)}", name=name)


def how_to_get(*names):
    """Return the command that installs packages of `_SOURCES` for this Python."""
    pip = f"{sys.executable} -m pip install"
    if "/usr/lib/python3/dist-packages" in sys.path and Path("/usr/bin/apt-get").exists():
        command, column = "apt-get install", 0
    elif Path(sys.prefix, "conda-meta").exists():
        command, column = "conda install -c conda-forge", 1
    elif sys.platform == "linux" and platform.machine() == "x86_64" and sys.version_info >= (3, 12):
        command, column = pip, 2
    else:
        command, column = pip, 3
    what = " ".join(_SOURCES[name][column] for name in names)
    note = "compiles PETSc; see" if column == 3 and "petsc4py" in names else "other ways:"
    return f"Install by: {command} {what} ({note} docs/install.md)"


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
    """Raise an error, or in a command print it and exit."""
    main = sys.modules.get("__main__")
    name = getattr(getattr(main, "__spec__", None), "name", None) or ""
    if name.startswith("app.") and not hasattr(main, "main"):
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    raise error from None


def install():
    """Put both import finders of this module on ``sys.meta_path``, once."""
    if MissingPackageFinder not in sys.meta_path:
        sys.meta_path[:] = [CompiledPackageFinder, *sys.meta_path, MissingPackageFinder]
