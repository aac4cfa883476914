"""Time of many small problems by `solve_many`, on one process and on several, and its overhead.

``python -m benchmarks.many --count 1000 --cells 128``. The surfaces are self-affine, pressed on a plane. The reference
is the sum of the times of `ContactSolver.solve` alone, on a solver that is set up already. CPU times, of all processes
together, vary less than times if other programs run.
"""

import argparse
import os
import time
import warnings

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface, solve_many
from app.base.errors import NoteWarning
from app.io.table import format_text

MATERIAL = Material.combined(80000.0, 0.3)


def rough_surfaces(grid, count):
    """Return heights of `count` surfaces of 1 mm x 1 mm; their shortest waves are four cells [mm]."""
    side = grid.sides[0]
    surfaces = (
        SelfAffineSurface(0.8, side / 8, 4 * grid.dx, (side, side), seed, rms_slope=0.1)
        for seed in range(count)
    )
    return [surface.height(grid.x(), grid.y()) for surface in surfaces]


class Clock:
    """Sums of times and of CPU times, each by its name [s]."""

    def __init__(self):
        self.rows = {}
        self._last = self._now()

    @staticmethod
    def _now():
        return time.perf_counter(), sum(os.times()[:4])  # with processes that have ended

    def add(self, what):
        """Add the times since the last call to those of `what`."""
        now = self._now()
        row = self.rows.setdefault(what, {"what": what, "seconds": 0.0, "CPU seconds": 0.0})
        for name, end, start in zip(("seconds", "CPU seconds"), now, self._last, strict=True):
            row[name] += end - start
        self._last = now


def time_parts(clock, grid, surfaces, pressure):
    """Time the set-up, all updates and all solves of one solver."""
    problems = [ContactProblem(grid, MATERIAL, surfaces=[heights]) for heights in surfaces]
    with ContactSolver(problems[0]) as solver:
        clock.add("set-up")
        for problem in problems:
            solver.update(problem)
            clock.add("updates")
            solver.solve(mean_pressure=pressure)
            clock.add("solves alone")


def time_all(grid, surfaces, pressure, counts):
    """Return rows of times: of the parts, and of `solve_many` on each number of processes."""
    clock = Clock()
    time_parts(clock, grid, surfaces, pressure)
    for processes in counts:
        name = f"solve_many, {processes} process{'es'[: 2 * (processes > 1)]}"
        table = solve_many(surfaces, None, processes, mean_pressure=pressure, grid=grid, material=MATERIAL)
        clock.add(name)
        clock.rows[name]["converged"] = int(table["converged"].sum())
    return list(clock.rows.values())


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=128, help="in each direction")
    parser.add_argument("--count", type=int, default=1000, help="number of surfaces")
    parser.add_argument("--pressure", type=float, default=100.0, help="mean pressure [N/mm2]")
    parser.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeat", type=int, default=1, help="runs; the shortest time of each part counts")
    given = parser.parse_args()
    warnings.simplefilter("ignore", NoteWarning)
    grid = Grid.from_domain(given.cells, given.cells, (0.0, 1.0, 0.0, 1.0))
    surfaces = rough_surfaces(grid, given.count)
    time_parts(Clock(), grid, surfaces[:1], given.pressure)  # compiles, and fills caches
    runs = [time_all(grid, surfaces, given.pressure, given.processes) for _ in range(given.repeat)]
    rows = runs[0]
    for row, *others in zip(*runs, strict=True):
        for name, unit in (("seconds", "ms each"), ("CPU seconds", "CPU ms each")):
            row[name] = min(run[name] for run in (row, *others))
            row[unit] = 1e3 * row[name] / given.count
    numbers = "seconds", "CPU seconds", "ms each", "CPU ms each"
    print(format_text(rows, formats=dict.fromkeys(numbers, ".2f")))


if __name__ == "__main__":
    main()
