"""Time of many small problems by `solve_many`, on one process and on several, and its overhead.

``python -m benchmarks.many --count 1000 --cells 128``. The surfaces are self-affine, pressed on a plane. The reference
is the sum of the times of `ContactSolver.solve` alone, on a solver that is set up already.
"""

import argparse
import time
import warnings

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface, solve_many
from app.base.errors import NoteWarning
from app.io.table import format_text

MATERIAL = Material.combined(80000.0, 0.3)


def rough_surfaces(grid, count):
    """Return heights of `count` surfaces of 1 mm x 1 mm; their shortest waves are four cells [mm]."""
    side = grid.nx * grid.dx
    surfaces = (
        SelfAffineSurface(0.8, side / 8, 4 * grid.dx, (side, side), seed, rms_slope=0.1)
        for seed in range(count)
    )
    return [surface.height(grid.x(), grid.y()) for surface in surfaces]


def time_parts(grid, surfaces, pressure):
    """Return the seconds of set-up, of all updates, and of all solves, on one solver."""
    started, updates, solves = time.perf_counter(), 0.0, 0.0
    problems = [ContactProblem(grid, MATERIAL, surfaces=[heights]) for heights in surfaces]
    with ContactSolver(problems[0]) as solver:
        setup = time.perf_counter() - started
        for problem in problems:
            started = time.perf_counter()
            solver.update(problem)
            updated = time.perf_counter()
            solver.solve(mean_pressure=pressure)
            updates += updated - started
            solves += time.perf_counter() - updated
    return setup, updates, solves


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=128, help="in each direction")
    parser.add_argument("--count", type=int, default=1000, help="number of surfaces")
    parser.add_argument("--pressure", type=float, default=100.0, help="mean pressure [N/mm2]")
    parser.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    given = parser.parse_args()
    warnings.simplefilter("ignore", NoteWarning)
    grid = Grid.from_domain(given.cells, given.cells, (0.0, 1.0, 0.0, 1.0))
    surfaces = rough_surfaces(grid, given.count)
    time_parts(grid, surfaces[:1], given.pressure)  # compiles, and fills caches
    setup, updates, solves = time_parts(grid, surfaces, given.pressure)
    rows = [
        {"what": what, "seconds": seconds}
        for what, seconds in (("set-up", setup), ("updates", updates), ("solves alone", solves))
    ]
    for processes in given.processes:
        started = time.perf_counter()
        table = solve_many(
            surfaces, None, processes, mean_pressure=given.pressure, grid=grid, material=MATERIAL
        )
        seconds = time.perf_counter() - started
        name = f"solve_many, {processes} process{'es'[: 2 * (processes > 1)]}"
        rows.append({"what": name, "seconds": seconds, "converged": int(table["converged"].sum())})
    for row in rows:
        row["ms each"] = 1e3 * row["seconds"] / given.count
        row["over solves alone"] = (
            f"{100 * (row['seconds'] / solves - 1):+.0f}%" if "converged" in row else ""
        )
    print(format_text(rows, formats={"seconds": ".2f", "ms each": ".2f"}))


if __name__ == "__main__":
    main()
