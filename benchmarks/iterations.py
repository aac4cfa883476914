"""Count operator applications against the number of cells, of this program and of two others.

    python -m benchmarks.iterations                          # 64 to 1024 cells per side, the other programs to 512
    python -m benchmarks.iterations --sizes 2048,4096 --peer-sizes 1024
    python -m benchmarks.iterations --dilute 1024,4096,16384

Writes docs/notebook/iterations.csv, docs/notebook/iterations.md and docs/iterations.png. Numbers that are in the CSV
file are not counted again. Counts do not depend on the load of the machine.
"""

import argparse
import csv
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver
from app.halfspace.material import Material
from app.io.table import format_markdown, write_table
from benchmarks import periodic
from benchmarks.measure import ROOT
from benchmarks.peers import cases
from benchmarks.peers.packages import set_up
from benchmarks.peers.runs import OURS, Search, Solver

LOAD = 0.05  # mean pressure / (E* rms slope) of both rough problems
# Variants whose products all are in double precision.
VARIANTS = {
    "aspher": ("nested, fft", "nested"),
    "contactmechanics": (
        "constrained CG by force",
        "periodic constrained CG by force",
        "periodic dual, CG without restart by mean force",
    ),
}
LABELS = {OURS: "this program", "aspher": "ASPHER", "contactmechanics": "ContactMechanics"}
DILUTE = "dilute"


class HertzCase(cases.Case):
    """Hertz's problem of the paper on a square patch, by load."""

    controls = ("load",)

    def __init__(self, size, folder):
        super().__init__("hertz", size, folder, square=True)
        self.load = self.problem.reference(self.approach).load

    def learn(self, pressure):
        """Nothing: the load is prescribed."""


class RoughCase(cases.DiluteCase):
    """The periodic surface of `benchmarks.periodic` on a patch that is not periodic, under the same mean pressure."""

    dilute = False

    def __init__(self, size, folder):
        self.name, self.size, self.approach = "self-affine", size, math.nan
        self.material = Material.combined(periodic.MATERIAL.shear_modulus, periodic.MATERIAL.poisson_ratio)
        self.grid, self.gap = periodic.surface_grid(size), periodic.distance(size)
        self.load = periodic.mean_pressure(LOAD) * periodic.SIDE**2
        self.stem = folder / f"rough-{size}"


def periodic_case(size, folder):
    """Return the periodic case."""
    return cases.PeriodicCase(f"load {LOAD:g}", size, folder)


PROBLEMS = {
    "Hertz": HertzCase,
    "self-affine, free patch": RoughCase,
    "self-affine, periodic patch": periodic_case,
}

PAGE = """\
# Operator applications against the number of cells

`python -m benchmarks.iterations` writes this page. All programs solve the same problems under a prescribed load to the
same accuracy, which is checked as in the [benchmark](benchmark-peers.md) of other packages.

- *Hertz*: the ball of the paper on a square patch.
- *Self-affine*: the surface of `run/bench --periodic`, Hurst exponent 0.8, roll-off 1/8 of the side, rms slope 0.1,
  mean pressure 0.05 E* times the rms slope, about 11% of the cells in contact. The shortest waves have eight cells, so
  finer grids have more waves.
- `applications`: this program counts all products and sweeps on all grids, in units of a product on the finest grid.
  ASPHER counts products on the finest grid; its coarser grids are not counted. Products of ContactMechanics, which has
  one grid, are counted by a wrapper of its function `evaluate_disp`.
- `iterations`: of this program active set iterations on the finest grid, of the others iterations of conjugate
  gradients there.

![Operator applications against cells per side](../iterations.png)

"""
DILUTE_TEXT = """
## Dilute contact

The surface of the page on [dilute contact](dilute.md) under 1.5e-4 N. A product between lists of cells counts by its
estimated time, so on fine grids the work of a solve is less than one product on all cells. `residual`: of the program.

"""


class Counter:
    """Count operator applications of the programs, on one case after the other.

    Parameters
    ----------
    environments : Path
        Folder of the packages.
    folder : Path
        Folder for the files of the cases.
    """

    def __init__(self, environments, folder):
        self.folder = folder
        self.options = argparse.Namespace(budget=math.inf, limit=3600)
        self.packages = {name: set_up(name, environments) for name in VARIANTS}

    def count(self, name, size, solver):
        """Return the row of a program: of its variant with the least products."""
        case, warm_up = (PROBLEMS[name](cells, self.folder) for cells in (size, min(size, 64)))
        case.write()
        warm_up.write()
        is_periodic = "periodic" in name
        if solver == OURS:
            ours = Solver.ours("load", is_periodic, warm_up.file, self.options)
            runs = [ours.run(case, self.folder, repeats=1)[0]]
        elif "python" not in self.packages[solver]:
            raise SystemExit(f"{solver}: {self.packages[solver]['failure']}")
        else:
            package = self.packages[solver]
            described = {variant: package["variants"][variant] for variant in VARIANTS[solver]}
            searches = [
                Search(package["python"], solver, variant, facts, warm_up.file, self.options)
                for variant, facts in described.items()
                if facts["periodic"] == is_periodic
            ]
            runs = [search(case, self.folder, math.inf) for search in searches]
        best = min(runs, key=lambda run: (not run.accepted, run.products))
        return {
            "problem": name,
            "cells": size,
            "solver": solver,
            "applications": f"{best.products:.4g}" if best.accepted else "",
            "iterations": best.iterations,
            "residual": f"{best.residual:.1e}",
            "note": best.failure if best.accepted or best.failure else "not accurate enough",
        }


def count_dilute(size):
    """Return the row of a dilute contact, solved in this process; its residual is not checked."""
    case = cases.DiluteCase("1.5e-4 N", size, Path())
    with ContactSolver(ContactProblem(case.grid, case.material, case.gap)) as solver:
        solution = solver.solve(load=case.load)
    return {
        "problem": DILUTE,
        "cells": size,
        "solver": OURS,
        "applications": f"{solution.operator_applications:.4g}",
        "iterations": solution.iterations,
        "residual": f"{solution.residual:.1e}",
        "note": "" if solution.converged else "not converged",
    }


def read_rows(path):
    """Return the rows of the CSV file that have a number; none if there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row | {"cells": int(row["cells"])} for row in csv.DictReader(file) if row["applications"]]


def draw(rows, path):
    """Draw the applications against the cells, a panel for each problem."""
    figure, panels = plt.subplots(1, len(PROBLEMS), figsize=(11, 3.6), sharey=True, layout="constrained")
    for panel, name in zip(panels, PROBLEMS, strict=True):
        for (solver, label), marker in zip(LABELS.items(), "os^", strict=True):
            points = [
                (row["cells"], float(row["applications"]))
                for row in rows
                if (row["problem"], row["solver"]) == (name, solver) and row["applications"]
            ]
            panel.plot(*np.reshape(sorted(points), (-1, 2)).T, f"{marker}-", label=label)
        sizes = sorted({row["cells"] for row in rows if row["problem"] == name})
        panel.set(xscale="log", yscale="log", title=name, xlabel="cells per side")
        panel.set_xticks(sizes, [f"{size}" for size in sizes])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
    counts = [2, 5, 10, 20, 50, 100, 200, 500]
    panels[0].set_yticks(counts, map(str, counts))
    largest = max(
        float(row["applications"]) for row in rows if row["problem"] != DILUTE and row["applications"]
    )
    panels[0].set(ylabel="products with the matrix", ylim=(2, 1.5 * largest))
    panels[0].legend()
    figure.savefig(path, dpi=70)


def write(rows, stem):
    """Write the CSV file, the page and the picture."""
    order = {name: place for place, name in enumerate([*PROBLEMS, DILUTE])}
    rows.sort(key=lambda row: (order[row["problem"]], [*LABELS].index(row["solver"]), row["cells"]))
    write_table(stem.with_suffix(".csv"), rows)
    dilute = [row for row in rows if row["problem"] == DILUTE]
    page = [PAGE, format_markdown([row for row in rows if row["problem"] != DILUTE])]
    if dilute:
        page += [DILUTE_TEXT, format_markdown(dilute)]
    stem.with_suffix(".md").write_text("".join(page), encoding="utf-8")
    if len(dilute) < len(rows):
        draw(rows, stem.parents[1] / f"{stem.name}.png")


def main():
    """Count what is not in the table, and write it again after each row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default="64,128,256,512,1024", help="cells per side")
    parser.add_argument("--peer-sizes", default="64,128,256,512", help="those of the other programs")
    parser.add_argument("--dilute", default="", help="cells per side of dilute contacts, this program only")
    parser.add_argument("--environments", type=Path, default=ROOT / ".venv-peers")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs/notebook/iterations")
    options = parser.parse_args()
    ours, peers, dilute = (
        [int(size) for size in text.split(",") if size]
        for text in (options.sizes, options.peer_sizes, options.dilute)
    )
    rows = read_rows(options.output.with_suffix(".csv"))
    there = {(row["problem"], row["cells"], row["solver"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        counter = Counter(options.environments, Path(folder))
        work = [(name, size, OURS) for name in PROBLEMS for size in ours]
        work += [(name, size, package) for size in peers for name in PROBLEMS for package in VARIANTS]
        for key in work:
            if key not in there:
                rows.append(counter.count(*key))
                write(rows, options.output)
    for size in dilute:
        if (DILUTE, size, OURS) not in there:
            rows.append(count_dilute(size))
            write(rows, options.output)
    write(rows, options.output)


if __name__ == "__main__":
    main()
