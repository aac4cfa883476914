"""Peak memory of set-up and solve over what is estimated: ``python tests/peak.py CELLS METHOD``, on any ranks.

A method is a name, or options ``a=1,b=2``; with ``periodic:`` before it, on a periodic patch. Prints a line of JSON:
doubles per cell measured on all ranks, and estimated. One method in a process: Open MPI has malloc keep what is freed.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, Material
from app.memory import doubles_per_cell


def problem(n, periodic):
    """Waves, as many as asperities on a rough surface."""
    rng = np.random.default_rng(1)
    waves = list(zip(*rng.integers(1, 20, (2, 40)), rng.uniform(0, 2 * np.pi, 40), strict=True))

    def gap(x, y):
        return sum(1e-3 * np.cos(np.pi * (k * x + m * y) + phase) / np.hypot(k, m) for k, m, phase in waves)

    return ContactProblem(
        Grid.from_domain(n, n, (-1, 1, -1, 1)), Material.combined(82000, 0.28), gap, periodic=periodic
    )


def solve(n, method, periodic):
    """Set up and solve once; return what is estimated."""
    options = dict(pair.split("=") for pair in method.split(",")) if "=" in method else {}
    name = None if options or method == "default" else method
    with ContactSolver(problem(n, periodic), name, options) as solver:
        if "lcp_type" in options:  # TAO, SNESVI
            solver.solve(approach=solver.touching + 0.002)
        else:
            solver.solve(mean_pressure=50)
        return doubles_per_cell(solver.settings, periodic)


def status(name):
    """Memory of this process by /proc [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) * 1024


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    n, word = int(sys.argv[1]), sys.argv[2]
    periodic, method = word.startswith("periodic:"), word.removeprefix("periodic:")
    for small in (32, 96):  # loads all there is to be loaded
        solve(small, method, periodic)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = status("VmRSS")
    estimated = solve(n, method, periodic)
    taken = MPI.COMM_WORLD.allreduce(status("VmHWM") - before)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({"method": word, "measured": taken / 8 / n**2, "estimated": estimated}))
