"""Hertz's contact by norm.opts on several ranks: ``mpiexec -n 3 python tests/mpi_norm.py RESULT.npz``.

Writes what `test_norm` compares with one rank: for every grid the counts and the load, and a pressure.
"""

import sys

import numpy as np
from mpi4py import MPI
from running import solve

from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.problems.hertz import Hertz

APPROACH = 0.1091
SMALL = 45, 37
COUNTS = {32: (5, 73), 64: (7, 122), 128: (8, 176), 256: (9, 250)}  # active set and CG iterations


def hertz(nx, ny=None):
    """The problem of Sec. 5.1."""
    grid = Grid.from_domain(nx, ny or nx, (-10.0, 10.0, -6.0, 6.0))
    return Hertz(grid, Material(82000.0, 0.28), rx=300.0, ry=163.0)


def main(path):
    comm = MPI.COMM_WORLD
    found = {}
    for n in COUNTS:
        solution = solve(hertz(n), APPROACH)
        outcome = solution.outcome
        found[str(n)] = outcome.iterations, outcome.inner_iterations, solution.load
    rows = comm.gather(solve(hertz(*SMALL), APPROACH, lcp_rtol=1e-12).pressure)
    if comm.rank == 0:
        np.savez(path, pressure=np.vstack(rows), **found)


if __name__ == "__main__":
    main(sys.argv[1])
