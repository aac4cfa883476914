"""Methods and the multigrid PC on other builds of PETSc: for debugging, where nothing may be left, or long integers."""

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
assert solve(hertz, approach=0.1, options={"lcp_type": "snesvi"}).converged
images = ContactProblem(grid, Material.combined(82000, 0.28), lambda x, y: x**2 / 600 + y**2 / 326, periodic=True)
for options in ({}, {"lcp_precision": "double", "lcp_cells_per_rank": 1}, {"lcp_nested": "false"}):
    for loading in ({"approach": 0.05}, {"load": 70000.0}, {"load": 1e9}):
        assert solve(images, method="primal", options=options, **loading).converged, options

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.parallel.slabs import Slabs
from app.halfspace.operator import InfluenceOperator
from app.base.petsc import calling_petsc

# The multigrid PC in a KSP of a user's own, for two contact sets, also after an interrupted cycle
comm = MPI.COMM_WORLD
slabs = Slabs(grid.ny, comm.size, comm.rank)
operator = InfluenceOperator(grid, hertz.material.kernel, slabs, comm if comm.size > 1 else None)
mat, plain, counts = operator.mat(), InfluenceOperator.SOR, []
p, b = mat.createVecs()
mine = {"pc_type": "python", "pc_python_type": "app.multigrid.ContactMG", "ksp_rtol": "1e-8"}
for name, text in mine.items():
    PETSc.Options("mine_").setValue(name, text)
for kind, interrupted in (("gmres", 7), ("cg", 3), ("richardson", 0)):
    ksp = PETSc.KSP().create(mat.comm)
    ksp.setOptionsPrefix("mine_")
    ksp.setOperators(mat)
    ksp.setType(kind)
    ksp.setFromOptions()
    for radius in (8, 4):
        inside = grid.x() ** 2 + grid.y(slabs.rows)[:, None] ** 2 < radius**2
        operator.mask[...] = inside
        mat.assemble()
        b.setArray((inside * (2 + grid.x())).reshape(-1))
        ksp.solve(b, p)
        assert ksp.getConvergedReason() > 0, kind
        counts.append(ksp.getIterationNumber())
    sweeps = []

    def stop(*arguments):
        sweeps.append(1)
        if len(sweeps) == interrupted:
            raise KeyboardInterrupt
        plain(*arguments)

    InfluenceOperator.SOR = stop
    try:
        with calling_petsc():
            ksp.solve(b, p)
        assert not interrupted
    except KeyboardInterrupt:
        ksp.reset()
        ksp.setOperators(mat)
        for vec in (p, b):
            vec.destroy()
        p, b = mat.createVecs()
        b.setArray((inside * (2 + grid.x())).reshape(-1))
    InfluenceOperator.SOR = plain
    ksp.solve(b, p)
    assert ksp.getIterationNumber() == counts[-1], kind
    ksp.destroy()
for part in (mat, p, b):
    part.destroy()
PETSc.garbage_cleanup()
assert len(set(comm.allgather(tuple(counts)))) == 1 and max(counts) < 40, counts

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


@pytest.mark.ranks(None, 2, 3)
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
