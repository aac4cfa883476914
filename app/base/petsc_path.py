"""Where petsc4py is. Debian keeps it in PETSc's own folder, off Python's path. No part of app/ is needed.

``PETSC_DIR``, and ``PETSC_ARCH`` where there is one, name the PETSc to use, as PETSc itself reads them: Debian's with
integers of 64 bits, or one of your own with petsc4py in it. Otherwise it is what Python finds, and then Debian's.
"""

import glob
import importlib.util
import os
import sys

DEBIAN = "/usr/lib/petscdir/petsc3.*/*-real"


def find(environment=os.environ):
    """Put the folder of petsc4py on Python's path, unless it is there. Not collective."""
    named = environment.get("PETSC_DIR")
    if named:
        _add(os.path.join(named, environment.get("PETSC_ARCH", "")), first=True)
    if importlib.util.find_spec("petsc4py") is None:
        for folder in sorted(glob.glob(DEBIAN), reverse=True):
            _add(folder)


def _add(folder, first=False):
    for place in ("lib", "lib/python3/dist-packages"):
        path = os.path.join(folder, place)
        if os.path.isdir(os.path.join(path, "petsc4py")) and path not in sys.path:
            sys.path.insert(0 if first else len(sys.path), path)


find()  # also at the start of Python in .venv, which executes this file
