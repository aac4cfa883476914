"""Peak memory of set-up and solve over what is estimated: ``python tests/peak.py CELLS METHOD [PRESSURE [HARDNESS]]``.

On any ranks. A method is a name, or options ``a=1,b=2``; with ``periodic:`` before it, on a periodic patch; ``film`` is
the default method on a thin rubber layer. PRESSURE is
the mean one: 50, the default, is 8% contact, 600 is 55%; ``ball:20000``: of a ball, in a window. Prints a line of JSON:
doubles per cell measured on all ranks, and estimated.

Measured as on large grids, where malloc gives back what is freed, and nothing is small enough to be kept.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, Material
from app.base import numba_cache
from app.base.memory import doubles_per_cell, set_malloc_option
from app.multigrid import solver_cache


def problem(n, periodic, ball=False, hardness=None, film=False):
    """Waves, as many as asperities on a rough surface; or a ball."""
    rng = np.random.default_rng(1)
    waves = list(zip(*rng.integers(1, 20, (2, 40)), rng.uniform(0, 2 * np.pi, 40), strict=True))

    def gap(x, y):
        if ball:
            return (x**2 + y**2) / 2
        return sum(1e-3 * np.cos(np.pi * (k * x + m * y) + phase) / np.hypot(k, m) for k, m, phase in waves)

    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    material = Material.layer(1000.0, 0.5, 0.03) if film else Material.combined(82000, 0.28)
    return ContactProblem(grid, material, gap, periodic=periodic, hardness=hardness)


def solve(n, method, periodic, pressure, hardness):
    """Set up and solve once; return what is estimated."""
    ball, pressure = pressure.startswith("ball:"), float(pressure.removeprefix("ball:"))
    options = dict(pair.split("=") for pair in method.split(",")) if "=" in method else {}
    name = None if options or method in ("default", "film") else method
    with ContactSolver(problem(n, periodic, ball, hardness, method == "film"), name, options) as solver:
        if "lcp_type" in options:  # SNESVI
            solver.solve(approach=solver.touching + 0.002)
        else:
            solver.solve(mean_pressure=pressure)
        return doubles_per_cell(solver.settings, periodic, hardness is not None)


def status(name):
    """Memory of this process by /proc [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) * 1024


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    numba_cache.on_first_compile = lambda: print("compiling", file=sys.stderr)
    for option in (-1, -2, -3):  # M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD
        set_malloc_option(option, 65536)
    n, word, *more = int(sys.argv[1]), *sys.argv[2:]
    pressure, solver_cache.MAX_CACHED_CELLS = more[0] if more else "50", 0
    hardness = float(more[1]) if len(more) > 1 else None
    periodic, method = word.startswith("periodic:"), word.removeprefix("periodic:")
    for small in (32, 352):  # loads all there is to be loaded
        solve(small, method, periodic, pressure, hardness)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = status("VmRSS")
    estimated = solve(n, method, periodic, pressure, hardness)
    taken = MPI.COMM_WORLD.allreduce(status("VmHWM") - before)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({"method": word, "measured": taken / 8 / n**2, "estimated": estimated}))
