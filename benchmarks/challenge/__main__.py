"""Solve the loads that the tables lack; write tables, pictures and page (``run/challenge``)."""

import argparse
import csv
from pathlib import Path

from tqdm import tqdm

from app import ContactProblem, ContactSolver, Grid, Material
from app.io.table import write_table
from benchmarks import challenge
from benchmarks.challenge import measures
from benchmarks.challenge.page import SHOWN, write_page
from benchmarks.challenge.surface import SIDE, look_alike, read_surface, resample, rms_slope
from benchmarks.measure import ROOT

MODULUS = 25.0  # E* [N/mm2]
LOADS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0)  # p / (E* h'rms)
WORDS = ("surface", "kind")  # columns that are no numbers


def pressed(distance, mean_pressures):
    """Solve for one mean pressure after the other; yield solutions (`app.Solution`).

    Parameters
    ----------
    distance : ndarray, shape (n, n), [mm]
        Undeformed distance on the periodic patch.
    mean_pressures : sequence of float, [N/mm2]
    """
    grid = Grid.from_domain(*distance.shape[::-1], (0.0, SIDE, 0.0, SIDE))
    problem = ContactProblem(grid, Material.combined(MODULUS / 2, 0.5), distance, periodic=True)
    with ContactSolver(problem) as solver:
        for pressure in mean_pressures:
            yield solver.solve(mean_pressure=pressure)


def main():
    """Solve, measure, write the page."""
    parser = argparse.ArgumentParser("run/challenge", description=challenge.__doc__)
    parser.add_argument("--sizes", default="1024,2048,4096,8192", help="cells per side")
    parser.add_argument("--surface", type=Path, help="the Challenge's file instead of a look-alike")
    parser.add_argument("--seed", type=int, default=1, help="of the look-alike")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs/contact-mechanics-challenge.md")
    options = parser.parse_args()
    try:
        sizes = sorted(int(size) for size in options.sizes.split(","))
        if min(sizes) < 4:
            raise ValueError("sizes: at least 4 cells per side are needed")
        heights = read_surface(options.surface) if options.surface else look_alike(options.seed)
    except ValueError as error:
        parser.error(str(error))
    name = options.surface.name if options.surface else f"look-alike, seed {options.seed}"
    run(heights, name, sizes, options.output)


def run(heights, name, sizes, output, loads=LOADS, solve=pressed):
    """Solve the missing loads, and write all files after each, so that a run can be resumed.

    Parameters
    ----------
    heights : ndarray, shape (n, n), [mm]
    name : str
        Of the surface.
    sizes : sequence of int
    output : Path
        Of the page; tables and pictures are put beside it.
    loads : sequence of float
    solve : callable
        As `pressed`.
    """
    tables = output.with_suffix(".csv"), output.with_name(f"{output.stem}-distributions.csv")
    rows, densities = map(read_rows, tables)
    unit, rms_height = MODULUS * rms_slope(heights), float(heights.std())
    for size in sizes:
        done = {row["load"] for row in rows if row["surface"] == name and row["size"] == size}
        todo = [load for load in loads if load not in done]
        if not todo:
            continue
        here = resample(heights, size)
        facts = {"surface": name, "size": size, "rms_slope": rms_slope(here)}
        solutions = solve(here.max() - here, [load * unit for load in todo])
        for load, solution in tqdm(zip(todo, solutions, strict=True), f"{size}²", len(todo), disable=None):
            fields = solution.pressure, solution.gap, unit, rms_height
            about = {
                "converged": int(solution.converged),
                "applications": solution.operator_applications,
                "seconds": solution.solve_seconds,
            }
            rows.append(facts | {"load": load} | measures.numbers(*fields) | about)
            densities = [
                row for row in densities if (row["surface"], row["size"], row["load"]) != (name, size, load)
            ]
            if load in SHOWN:
                densities += [
                    {"surface": name, "size": size, "load": load, "kind": kind, "x": x, "density": y}
                    for kind, curve in measures.densities(*fields).items()
                    for x, y in zip(measures.middles(kind).tolist(), curve.tolist(), strict=True)
                ]
            for table, content in zip(tables[::-1], (densities, rows), strict=True):
                write_table(table, content)
    write_page(output, rows, densities, name)


def read_rows(path):
    """Read the rows of a CSV table; none without the file."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        rows = [{k: v if k in WORDS else float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return [row | {"size": int(row["size"])} for row in rows]


if __name__ == "__main__":
    main()
