"""Find petsc4py, which Debian keeps in PETSc's folder, not on Python's path.

The variables ``PETSC_DIR`` and ``PETSC_ARCH`` choose the PETSc, as for PETSc itself. Without them, petsc4py is the one
that Python finds, or else Debian's. This file imports nothing from app/, because the Python of .venv executes it when
it starts.
"""

import glob
import importlib.util
import os
import sys

DEBIAN = "/usr/lib/petscdir/petsc3.*/*-real"


def find(environment=os.environ):
    """Put the folder of petsc4py on Python's path."""
    folder = environment.get("PETSC_DIR")
    if folder:
        _add(os.path.join(folder, environment.get("PETSC_ARCH", "")), first=True)
    if importlib.util.find_spec("petsc4py") is None:
        for folder in sorted(glob.glob(DEBIAN), reverse=True):
            _add(folder)


def _add(folder, first=False):
    for inside in ("lib", "lib/python3/dist-packages"):
        path = os.path.join(folder, inside)
        if os.path.isdir(os.path.join(path, "petsc4py")) and path not in sys.path:
            sys.path.insert(0 if first else len(sys.path), path)


find()
