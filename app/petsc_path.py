"""Where petsc4py is. Debian keeps it in PETSc's own folder, off Python's path. No part of app/ is needed.

``PETSC_DIR``, and ``PETSC_ARCH`` where there is one, name the PETSc to use, as PETSc itself reads them: Debian's with
integers of 64 bits, or one of your own with petsc4py in it. Otherwise it is what Python finds, and then Debian's.
"""

import glob
import importlib.util
import os
import sys

DEBIAN = "/usr/lib/petscdir/petsc3.*/*-real"
HOW_TO_GET = {
    "petsc4py": "Debian: apt-get install python3-petsc4py-real, for Debian's own python3 or a venv of it with "
    "--system-site-packages; conda-forge: conda install petsc4py; "
    "elsewhere: pip install petsc petsc4py, which compiles PETSc (docs/install.md)",
    "h5py": "Debian: apt-get install python3-h5py-mpi; conda-forge: conda install 'h5py=*=mpi*'; "
    "elsewhere: pip install h5py, with which ranks write in turn (docs/install.md)",
}


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


class Missing:
    """The last of Python's finders: for what pip does not install by itself one line says how to get it."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Refuse these, know nothing of anything else."""
        if name in HOW_TO_GET:
            from app.errors import PackageMissing

            raise PackageMissing(f"{name} is not installed. {HOW_TO_GET[name]}", name=name)


find()  # also at the start of Python in .venv, which executes this file
if __name__ == "app.petsc_path":
    sys.meta_path.append(Missing)
