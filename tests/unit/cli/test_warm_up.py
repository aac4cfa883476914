"""Compilation before the first solve."""

import pytest
from processes import run

MATRIX = """
import sys
import warnings
from itertools import product

import numpy as np

from app.base import numba_cache
from app.cli.warm_up import compile_loops

warnings.simplefilter("ignore")
load, needed = numba_cache.LockedCache.load_overload, set()

def load_overload(cache, signature, context):
    needed.add((cache._impl.filename_base, str(signature)))
    return load(cache, signature, context)

numba_cache.LockedCache.load_overload = load_overload
compile_loops()
compiled = frozenset(needed)

from app import ContactProblem, ContactSolver, Cylinder, Grid, Material, Paraboloid, solve, stress

from app.base.mpi import MPI

comm = MPI.COMM_WORLD
plain, shape = Material.from_contact_modulus(1e5), Paraboloid(9, 7)
bodies = {"plain": plain, "coated": Material.coated((2e5, 1e5), (0.3, 0.3), thickness=0.05)}
bodies["thick"], bodies["film"] = Material.layer(1e5, 0.3, 1), Material.layer(1e5, 0.5, 0.03)
patches = False, True, "x", "y"

def problem(cells, periodic, body="plain", shape=shape, **more):
    grid = Grid.from_domain(*cells, (-1, 1, -1, 1))
    return ContactProblem(grid, bodies[body], shape, periodic=periodic, **more)

def check(words, function):
    before = len(needed - compiled)
    function()
    if len(needed - compiled) > before:
        print(*words, *sorted(needed - compiled))

def hole(x, y):
    return np.where(x**2 + y**2 < 0.01, np.nan, x**2 / 18 + y**2 / 14)

for periodic, body, hardness in product(patches, bodies, (None, 2000)):
    for loading in {"load": 1500}, {"approach": 0.005}:
        if not (body in ("thick", "film") and "approach" in loading and hardness is not None):
            words = periodic, body, hardness, loading
            check(words, lambda: solve(problem((48, 48), periodic, body, hardness=hardness), **loading))
for periodic, hardness, precision in product(patches, (None, 2000), ("single", "double")):
    one, options = problem((640, 640), periodic, hardness=hardness), {"lcp_precision": precision}
    check((periodic, hardness, precision, 640), lambda: solve(one, load=1500, options=options))
if comm.size > 1:  # what follows is done by one rank, or as above
    sys.exit()
field = np.full((48, 48), 2000)
for periodic, hardness in product(patches, (None, 2000, field)):
    for options in {"lcp_nested": False}, {"lcp_prolongation": "copy"}, {"lcp_window": 0}, {"lcp_precision": "double"}:
        one = problem((48, 48), periodic, hardness=hardness)
        check((periodic, hardness, options), lambda: solve(one, load=1500, options=options))
for periodic in patches:
    for method in "norm", "fmg_v11", "mg_v01", "fmg_fft", "fmg_lift":
        check((periodic, method), lambda: solve(problem((80, 48), periodic), load=1500, method=method))
    check((periodic, "holes"), lambda: solve(problem((48, 48), periodic, shape=hole), load=1500))
    if periodic != "x":
        line = problem((48, 1), periodic or "y", shape=Cylinder(9))
        check((periodic, "line"), lambda: solve(line, load=1500))
    for hardness in None, 2000:
        one = ContactSolver(problem((48, 48), periodic, hardness=hardness))
        path = one.path(load=[500, 1500, 700], stiffness=True)
        check((periodic, hardness, "path"), lambda: [s.count_patches() for s in path])
    for body, nu in ("plain", 0.3), ("coated", None):
        one = solve(problem((48, 48), periodic, body), load=1500)
        check((periodic, body, "stress"), lambda: stress(one, poisson_ratio=nu).maximum())
"""


def test_a_warmed_up_machine_compiles_nothing():
    command = "-m", "app.solve", "--warm-up"
    run(*command, timeout=300)
    again = run(*command)
    assert again.stdout == "all loops are compiled\n"
    assert not again.stderr


@pytest.mark.ranks(None, 2)
def test_no_option_needs_another_loop(ranks, tmp_path):
    """On one rank and several; after run/setup no solve waits for a compilation."""
    program = tmp_path / "matrix.py"
    program.write_text(MATRIX)
    done = run(program, ranks=ranks, timeout=300)
    assert done.returncode == 0, done.stderr
    assert not done.stdout, done.stdout
