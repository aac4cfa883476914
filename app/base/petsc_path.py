"""Find petsc4py, which Debian keeps in PETSc's folder, not on Python's path.

The variables ``PETSC_DIR`` and ``PETSC_ARCH`` choose the PETSc, as for PETSc itself. Without them, petsc4py is the one
that Python finds, or else Debian's. This file imports nothing from app/, because the Python of .venv executes it when
it starts; and nothing that Python has not loaded then.
"""

import os
import sys
from importlib.machinery import PathFinder

DEBIAN = "/usr/lib/petscdir"


def find(environment=os.environ):
    """Put the folder of petsc4py on Python's path."""
    folder = environment.get("PETSC_DIR")
    if folder:
        _add(os.path.join(folder, environment.get("PETSC_ARCH", "")), first=True)
    if _finds_system_packages() and PathFinder.find_spec("petsc4py") is None:
        for release in _list(DEBIAN, "petsc3.", ""):
            for build in _list(release, "", "-real"):
                _add(build)


def _finds_system_packages():
    """Return whether this Python, or the one of its virtual environment, uses Debian's packages.

    Debian's petsc4py does not work with other packages, such as numpy and mpi4py from PyPI.
    """
    if sys.base_prefix != "/usr":
        return False
    try:
        with open(os.path.join(sys.prefix, "pyvenv.cfg"), encoding="utf-8") as file:
            return "include-system-site-packages = true" in file.read().lower()
    except OSError:
        return sys.prefix == sys.base_prefix


def _list(folder, start, end):
    try:
        names = sorted(os.listdir(folder), reverse=True)
    except OSError:
        return []
    return [os.path.join(folder, name) for name in names if name.startswith(start) and name.endswith(end)]


def _add(folder, first=False):
    for inside in ("lib", "lib/python3/dist-packages"):
        path = os.path.join(folder, inside)
        if os.path.isdir(os.path.join(path, "petsc4py")) and path not in sys.path:
            sys.path.insert(0 if first else len(sys.path), path)


find()
