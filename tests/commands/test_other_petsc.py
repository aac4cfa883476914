"""Every method on Debian's other builds of PETSc: for debugging, where nothing may be left, and with long integers."""

import os
from pathlib import Path

import petsc4py
import pytest
from processes import run

PROGRAM = """
import sys, warnings

import app, petsc4py  # in this order: app finds petsc4py

petsc4py.init([sys.argv[0], "-malloc_dump", "-objects_dump"])
from app import ContactProblem, Grid, Material, solve

grid = Grid.from_domain(24, 24, (-10, 10, -6, 6))
hertz = ContactProblem(grid, Material.combined(82000, 0.28), lambda x, y: x**2 / 600 + y**2 / 326)
for method in ("fast", "norm", "mg_v11", "fmg_v11"):
    for loading in ({"approach": 0.1}, {"load": 70000.0}):
        assert solve(hertz, method=method, **loading).converged, method
for kind in ("tao", "snesvi"):
    assert solve(hertz, approach=0.1, options={"lcp_type": kind}).converged, kind
images = ContactProblem(grid, Material.combined(82000, 0.28), lambda x, y: x**2 / 600 + y**2 / 326, periodic=True)
for options in ({}, {"lcp_precision": "double", "lcp_cells_per_rank": 1}, {"lcp_nested": "false"}):
    for loading in ({"approach": 0.05}, {"load": 70000.0}, {"load": 1e9}):
        assert solve(images, method="primal", options=options, **loading).converged, options

from petsc4py import PETSc

print("solved with integers of", 8 * PETSc.IntType().itemsize, "bits")
"""


def debug_library():
    """Folder of the debug build beside the PETSc that petsc4py is made for, or None."""
    parents = Path(petsc4py.__file__).resolve().parents
    folder = next((parent for parent in parents if parent.name.endswith("-real")), None)
    if folder is None:
        return None
    library = folder.with_name(f"{folder.name}-debug") / "lib"
    return library if library.is_dir() else None


@pytest.mark.ranks(None, 2)
def test_nothing_is_left_and_nothing_locked_is_written(ranks, tmp_path):
    library = debug_library()
    if library is None:
        pytest.skip("no debug build of PETSc (run/setup --dev)")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    path = f"{library}:{os.environ.get('LD_LIBRARY_PATH', '')}"
    done = run(program, ranks=ranks, timeout=180, env={"LD_LIBRARY_PATH": path})
    assert done.returncode == 0, done.stderr
    assert "solved" in done.stdout
    assert "never freed" not in done.stdout + done.stderr
    assert " bytes " not in done.stdout + done.stderr, done.stdout[:2000]


@pytest.mark.ranks(None, 2)
def test_integers_of_64_bits(ranks, tmp_path):
    folders = sorted(Path("/usr/lib/petscdir").glob("petsc64-3.*/*-real"))
    if not folders:
        pytest.skip("no PETSc with integers of 64 bits (run/setup --int64)")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    done = run(program, ranks=ranks, timeout=180, env={"PETSC_DIR": str(folders[-1]), "PETSC_ARCH": ""})
    assert done.returncode == 0, done.stderr
    assert "solved with integers of 64 bits" in done.stdout
