"""Errors of missing packages."""

import os
import sys
from types import SimpleNamespace

from app.base import missing_packages


def test_the_error_of_a_missing_package_has_the_command_for_this_python(monkeypatch, tmp_path):
    monkeypatch.setattr(missing_packages, "is_installed", lambda name: name == "pyfftw")
    for name in ("petsc4py", "h5py"):
        error = str(missing_packages.missing(name))
        assert error.startswith("not installed: an MPI library, petsc4py, h5py. Install by: ")
    monkeypatch.setattr(sys, "path", ["/usr/lib/python3/dist-packages"])
    assert "apt-get install python3-h5py python3-h5py-mpi (" in missing_packages.how_to_get("h5py")
    monkeypatch.setattr(sys, "path", [])
    for version, wheel in (((3, 12), sys.platform == "linux"), ((3, 11), False)):
        monkeypatch.setattr(sys, "version_info", version)
        monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(machine="x86_64"))
        text = missing_packages.how_to_get("petsc4py")
        assert ("dolfinx-solver-real" in text, "compiles PETSc" in text) == (wheel, not wheel)
    (tmp_path / "conda-meta").mkdir()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert "conda install -c conda-forge 'h5py=*=mpi*' (" in missing_packages.how_to_get("h5py")


def test_a_folder_without_code_is_no_package(monkeypatch, tmp_path):
    """Debian's python3-h5py-mpi without python3-h5py is such a folder."""
    (tmp_path / "h5py").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert not missing_packages.is_installed("h5py")
