"""Peak memory of set-up and solve over what is estimated: ``python tests/peak.py CELLS METHOD [PRESSURE [HARDNESS]]``.

On any ranks. A method is a name, or options ``a=1,b=2``; with ``periodic:`` before it, on a periodic patch; ``film`` is
the default method on a thin rubber layer. PRESSURE is
the mean one: 50, the default, is 8% contact, 600 is 55%; ``ball:20000``: of a ball, in a window; ``spots:1``: of
many asperities, 0.05% contact, whose array of heights is not counted. Prints a line of JSON: doubles per cell
measured on all ranks, and estimated.

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
from app.base.memory import HARDNESS, LISTS, PERIODIC_LISTS, WHOLE_SHAPE, doubles_per_cell, set_malloc_option
from app.multigrid import solver_cache


def spots(n):
    """Heights of 32 x 32 asperities, made without work arrays of their size."""
    rng, gap, side = np.random.default_rng(1), np.empty((n, n)), n // 32
    for j in range(0, n, side):
        for i in range(0, n, side):
            part = gap[j : j + side, i : i + side]
            y, x = np.ogrid[: part.shape[0], : part.shape[1]]
            y0, x0, height = side * rng.random(), side * rng.random(), rng.exponential()
            part[...] = 0.5 * ((x - x0) ** 2 + (y - y0) ** 2) * (2 / n) ** 2 - 1e-3 * height
    gap.flags.writeable = False
    return gap


def problem(n, periodic, kind="", hardness=None, film=False):
    """Waves, as many as asperities on a rough surface; or a ball, or spots."""
    rng = np.random.default_rng(1)
    waves = list(zip(*rng.integers(1, 20, (2, 40)), rng.uniform(0, 2 * np.pi, 40), strict=True))

    def gap(x, y):
        if kind == "ball":
            return (x**2 + y**2) / 2
        return sum(1e-3 * np.cos(np.pi * (k * x + m * y) + phase) / np.hypot(k, m) for k, m, phase in waves)

    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    material = Material.layer(1000.0, 0.5, 0.03) if film else Material.combined(82000, 0.28)
    gap = spots(n) if kind == "spots" else gap
    return ContactProblem(grid, material, gap, periodic=periodic, hardness=hardness)


def solve(problem, method, pressure):
    """Set up and solve once; return what is estimated."""
    options = dict(pair.split("=") for pair in method.split(",")) if "=" in method else {}
    name = None if options or method in ("default", "film") else method
    with ContactSolver(problem, name, options) as solver:
        if "lcp_type" in options:  # SNESVI
            solver.solve(approach=solver.touching + 0.002)
        else:
            solver.solve(mean_pressure=pressure)
        doubles = doubles_per_cell(solver.settings, problem.periodic, problem.hardness is not None)
        listed = LISTS + PERIODIC_LISTS * bool(problem.grid.periodic) + WHOLE_SHAPE * (not problem.by_rows)
        listed += HARDNESS * (problem.hardness is not None)
        return doubles if "exact_product" in vars(solver.hierarchy.target) else listed


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
    kind, _, pressure = pressure.rpartition(":")
    pressure, what = float(pressure), (periodic, kind, hardness, method == "film")
    for small in (32, 352):  # loads all there is to be loaded
        solve(problem(small, *what), method, pressure)
    large = problem(n, *what)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = status("VmRSS")
    estimated = solve(large, method, pressure)
    taken = MPI.COMM_WORLD.allreduce(status("VmHWM") - before)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({"method": word, "measured": taken / 8 / n**2, "estimated": estimated}))
