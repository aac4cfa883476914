"""The search for petsc4py."""

import sys

import pytest

from app.base import petsc_path


@pytest.mark.parametrize("inside", ["lib", "lib/python3/dist-packages", "arch/lib"])
def test_petsc_dir_chooses_the_petsc(inside, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", sys.path[:])
    folder = tmp_path / inside
    (folder / "petsc4py").mkdir(parents=True)
    arch = "arch" if inside.startswith("arch") else ""
    petsc_path.find({"PETSC_DIR": str(tmp_path), "PETSC_ARCH": arch})
    assert sys.path[0] == str(folder)


def test_petsc_dir_without_petsc4py_is_ignored(tmp_path, monkeypatch):
    before = sys.path[:]
    petsc_path.find({"PETSC_DIR": str(tmp_path)})
    assert sys.path == before
