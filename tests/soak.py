"""Many solves of all kinds in one process: ``python tests/soak.py ROUNDS``. Prints what the process holds, as JSON.

A round is 19 solves: free and periodic, by approach and load, every strategy, gaps that change, paths, refining,
solvers that are closed and that are forgotten. What is held after the second round is held after the last one.
"""

import gc
import json
import re
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import scipy.optimize  # noqa: F401 - a search for a load may need it, sooner or later
from mpi4py import MPI
from petsc4py import PETSc

from app import ContactProblem, ContactSolver, Grid, Material, refine, solve

STEEL = Material.combined(82000, 0.28)
METHODS = {
    "snesvi": {"options": {"lcp_type": "snesvi"}},
    "norm": {"method": "norm"},
    "fmg_v11": {"method": "fmg_v11"},
}
SOLVES = 19  # in a round


def problem(number, n=24, periodic=False):
    """A wavy bowl, another one every time."""
    depth = 1e-3 * (1 + number % 7)
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    return ContactProblem(
        grid, STEEL, lambda x, y: (x**2 + y**2) / 40 + depth * np.cos(np.pi * (x + 2 * y)), periodic=periodic
    )


def a_round(number):
    """Solve in all ways."""
    for periodic in (False, True):
        here = problem(number, periodic=periodic)
        solve(here, load=100 + number)
        with ContactSolver(here) as solver:  # closed
            start = solver.solve(mean_pressure=20 + number)
            solver.stiffness(solver.solve(load=start.load * 1.01, start=start))
            for solution in solver.path(load=[50, 100]):
                solution.contact_patches()
        forgotten = ContactSolver(here)
        forgotten.solve(approach=forgotten.touching + 1e-4).gather()
    for how in METHODS.values():
        solver = ContactSolver(problem(number), **how)
        solver.solve(approach=solver.touching + 2e-4 * (1 + number % 3))
    gap = np.random.default_rng(number).random((30, 20 + number % 2))
    given = ContactProblem(Grid.from_domain(*gap.shape[::-1], (0, 1, 0, 1)), STEEL, gap)
    solve(given, load=10, options={"lcp_rtol": 1e-8})
    refine(problem(number, 12), until=0.5, load=100, stiffness=True)
    try:  # refused in the middle of a set-up
        ContactSolver(problem(number), options={"ksp_bogus": 1})
    except ValueError:
        pass


def held():
    """Resident memory [MiB], PETSc's objects, the lowest number free for a communicator, objects of this house."""
    gc.collect()
    with tempfile.TemporaryDirectory() as folder:  # PETSc tells by its log only
        viewer = PETSc.Viewer().createASCII(f"{folder}/log")
        if PETSc.Sys.getVersion() < (3, 22):  # which cannot show it twice, and stumbles over the viewer
            PETSc.Log.view(viewer)
        viewer.destroy()
        table = Path(folder, "log").read_text().partition("Object Type")[2]
    counts = re.findall(r"^ *[A-Z][A-Za-z ]+? +(\d+) +(\d+)$", table, re.MULTILINE)
    comm = MPI.COMM_WORLD.Dup()
    lowest = comm.py2f()
    comm.Free()
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20
    modules = [str(type(thing).__module__) for thing in gc.get_objects()]
    ours = sum(
        name.startswith("app.") and name != "app.base.numba_cache" for name in modules
    )  # loops are kept
    return {
        "memory": resident,
        "petsc": sum(int(made) - int(gone) for made, gone in counts),
        "communicator": lowest,
        "ours": ours,
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore", RuntimeWarning)
    PETSc.Log.begin()
    kept = PETSc.Vec().createSeq(1)  # to be seen among the objects
    rounds = int(sys.argv[1])
    for number in range(rounds):
        a_round(number)
        if number == 1:
            before = held()
    after = held()
    gc.disable()
    a_round(rounds)
    gc.set_debug(gc.DEBUG_SAVEALL)
    gc.collect()
    arrays = sum(thing.nbytes for thing in gc.garbage if isinstance(thing, np.ndarray))
    print(json.dumps({"solves": (rounds - 2) * SOLVES, "before": before, "after": after, "garbage": arrays}))
