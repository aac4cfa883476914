"""Find missing packages, and the command that installs them for this Python."""

import os
import sys
from importlib.machinery import PathFinder
from pathlib import Path

# Package -> what to install for it: by apt-get, from conda-forge, as wheels, and by pip otherwise.
SOURCES = {
    "mpi4py": ("python3-mpi4py", "mpi4py", "mpich", "mpich"),  # pip's mpi4py has no MPI library
    "petsc4py": (
        "python3-petsc4py-real",
        "'petsc=*=real*' petsc4py",
        "dolfinx-solver-real",
        "petsc petsc4py",
    ),
    "h5py": ("python3-h5py python3-h5py-mpi", "'h5py=*=mpi*'", "h5py", "h5py"),
    "pyfftw": ("python3-pyfftw", "pyfftw", "pyfftw", "pyfftw"),
}


def is_installed(name):
    """Return whether a package with code is installed."""
    spec = PathFinder.find_spec(name)
    return spec is not None and spec.origin is not None


def missing(name):
    """Return the error for a missing package.

    The message has the command that installs all missing packages.

    If mpi4py itself is installed, `name` "mpi4py" means that the MPI library is missing.
    """
    from app.base.errors import PackageMissing

    names = [other for other in SOURCES if other == name or not is_installed(other)]
    shown = ["an MPI library" if other == "mpi4py" else other for other in names]
    return PackageMissing(f"not installed: {', '.join(shown)}. {how_to_get(*names)}", name=name)


def how_to_get(*names):
    """Return the command that installs packages of `SOURCES`."""
    pip = f"{sys.executable} -m pip install"
    if "/usr/lib/python3/dist-packages" in sys.path and Path("/usr/bin/apt-get").exists():
        command, column = "apt-get install", 0
    elif Path(sys.prefix, "conda-meta").exists():
        command, column = "conda install -c conda-forge", 1
    elif sys.platform == "linux" and os.uname().machine == "x86_64" and sys.version_info >= (3, 12):
        command, column = pip, 2
    else:
        command, column = pip, 3
    what = " ".join(SOURCES[name][column] for name in names)
    note = "compiles PETSc; see" if column == 3 and "petsc4py" in names else "other ways:"
    return f"Install by: {command} {what} ({note} docs/install.md)"
