"""One page of speed: kernels and whole solves as ratios to a plain FFT product measured in the same run.

Run by ``run/bench``; see there.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from app.halfspace.grid import Grid
from app.output.result import read_result
from app.output.table import markdown
from app.problems.surfaces import SelfAffineSurface
from benchmarks.plain import PlainProduct, check, seconds

ROOT = Path(__file__).resolve().parents[1]
PROBLEMS = {
    "hertz": ["-options_file", "petsc_options/hertz.opts"],
    "rough 1": ["-options_file", "petsc_options/punch.opts", "-approach", "-0.11"],
    "rough 2": ["-options_file", "petsc_options/punch.opts", "-approach", "0.01"],
    "rough 3": ["-options_file", "petsc_options/punch.opts", "-approach", "0.25"],
    "self-affine": None,  # from a file, see `self_affine`
}


def main():
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="256,512,1024,2048", help="cells per side")
    parser.add_argument("--ranks", default="1,2")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument(
        "--method", action="append", default=[], help="option file(s); default: the default method"
    )
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-kernels", action="store_true")
    parser.add_argument("-o", "--output", default=str(ROOT / "docs" / "benchmark.md"))
    options = parser.parse_args()
    sizes = [int(size) for size in options.sizes.split(",")]
    ranks = [int(count) for count in options.ranks.split(",")]
    names = options.problems.split(",")
    unknown = set(names) - set(PROBLEMS)
    if unknown:
        parser.error(f"unknown problems {sorted(unknown)}; allowed: {', '.join(PROBLEMS)}")

    page = [head(options)]
    if not options.no_kernels:
        page += ["## Kernels\n", KERNELS, markdown(kernels(sizes, ranks)), ""]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        work = [(name, size, count) for size in sizes for name in names for count in ranks]
        for name, size, count in tqdm(work, desc="solves", disable=None):
            rows.append(solve(name, size, count, options, Path(folder)))
    page += ["## Whole solves\n", SOLVES, markdown(rows), ""]
    text = "\n".join(page)
    Path(options.output).write_text(text)
    print(text)


def head(options):
    """Date, machine, versions."""
    from petsc4py import PETSc

    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next(
        (line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown processor"
    )
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    versions = f"PETSc {petsc}, numpy {np.__version__}, Python {platform.python_version()}"
    threads = f"OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS')}"
    method = ", ".join(options.method) or "the default (fast.opts)"
    return (
        f"# Benchmark\n\nMade by `run/bench` on {datetime.date.today()}: {cpu}, {os.cpu_count()} cores; {versions}; "
        f"{threads}. Method: {method}.\n\nThe unit is one *plain product*: zero-padded `scipy.fft.rfft2`, multiply, "
        "`irfft2` on the same grid, one thread, measured in the same run (shortest of several). Times are ratios; "
        "seconds are for orientation only.\n"
    )


KERNELS = """\
`product`: our own, in plain products; on P ranks, of the same plain product on one. `memory`: everything a product
needs beyond its vectors, in doubles per cell. `circulant`: one preconditioner application, `sweep`: one exact
Gauss-Seidel sweep on the Hertz and a rough contact set, both in units of our own product on one rank.
"""
SOLVES = """\
Approach prescribed, to ||r|| / ||h|| = 1e-6. `plain`: solve time in plain products (set-up apart). `applications`:
everything computed, in products on the target grid. `memory`: peak resident size above that of the smallest grid, per
cell, in doubles. `residual`, `penetration` (over the largest |h|): checked from the result file by a plain product.
"""


def kernels(sizes, ranks):
    """Ratios of the building blocks."""
    rows = []
    for size in sizes:
        row = {"grid": f"{size}^2"}
        plain = seconds(partial(PlainProduct(paper_grid(size)), np.ones((size, size))))
        for count in ranks:
            row.update(run_kernels(size, count, plain))
        rows.append(row)
    return rows


def run_kernels(size, count, plain):
    """Run `benchmarks.kernels` on some ranks; its output is ``name seconds`` lines."""
    command = ["mpiexec", "-n", str(count), sys.executable, "-m", "benchmarks.kernels", str(size)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, env=dict(os.environ))
    times = {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}
    if count > 1:
        return {f"product, {count} ranks": f"{times['product'] / plain:.2f}"}
    row = {
        "product": f"{times['product'] / plain:.2f}",
        "single precision": f"{times['product32'] / plain:.2f}",
        "memory": f"{times['memory']:.2f}",
    }
    for name in ("circulant", "sweep, Hertz", "sweep, rough"):
        key = name.replace(", ", "_").lower()
        row[name] = f"{times[key] / times['product']:.2f}"
    row["seconds"] = f"{times['product']:.2g}"
    return row


def paper_grid(size):
    """The Hertz patch of the paper."""
    return Grid.from_domain(size, size, (-10, 10, -6, 6))


def self_affine(size, folder):
    """A self-affine surface pressed on by a flat rigid body, as a gap file; options to solve it."""
    path = folder / f"self-affine-{size}.npy"
    grid = Grid.from_domain(size, size, (0, 1, 0, 1))
    if not path.exists():
        surface = SelfAffineSurface(0.8, 0.25, 8 / 256, (1.0, 1.0), 1, rms_slope=0.1)
        height = surface.height(grid.x(), grid.y())
        np.save(path, height.max() - height)
    return [
        "-problem", "file", "-gap_file", str(path), "-domain", "0,1,0,1", "-shear_modulus", "80000",
        "-poisson_ratio", "0.3", "-approach", "0.012",
    ]  # fmt: skip


def solve(name, size, count, options, folder):
    """Solve one problem a few times; the row of the quickest run."""
    problem = PROBLEMS[name] or self_affine(size, folder)
    method = [part for file in options.method for part in ("-options_file", file)]
    output = folder / "result.h5"
    command = ["mpiexec", "-n", str(count), sys.executable, "-m", "app.solve", *problem, *method]
    command += ["-grid", str(size), "-output", str(output)]
    best = product = None
    plain = np.inf
    for _ in range(options.repeats):
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, env=dict(os.environ), check=False
        )
        if done.returncode:
            return {
                "problem": name,
                "grid": f"{size}^2",
                "ranks": count,
                "note": done.stderr.strip().split("\n")[-1],
            }
        result = read_result(output)
        if product is None:
            facts = result.attributes
            grid = Grid(size, size, *(float(axis[1] - axis[0]) for axis in (result.x, result.y)))
            product = PlainProduct(grid, (1 - facts["poisson_ratio"]) / (np.pi * facts["shear_modulus"]))
        plain = min(plain, seconds(partial(product, result.pressure), 3))
        if best is None or result.attributes["solve_seconds"] < best.attributes["solve_seconds"]:
            best = result
    facts = best.attributes
    found = check(product, best.pressure, best.undeformed_distance)
    return {
        "problem": name,
        "grid": f"{size}^2",
        "ranks": count,
        "plain": f"{facts['solve_seconds'] / plain:.1f}",
        "applications": f"{facts['operator_applications']:.1f}",
        "iterations": facts["active_set_iterations"],
        "inner": facts["inner_iterations"],
        "seconds": f"{facts['solve_seconds']:.3g}",
        "set-up": f"{facts['setup_seconds']:.2g}",
        "memory": memory(facts, size, count),
        "residual": f"{found['residual']:.1e}",
        "penetration": f"{found['penetration']:.1e}",
    }


_smallest = {}


def memory(facts, size, count):
    """Peak resident size above that of the smallest run with as many ranks, in doubles per additional cell."""
    n, peak = size * size, facts["peak_memory"]
    if count not in _smallest or n <= _smallest[count][0]:
        _smallest[count] = n, peak
        return "-"
    n0, peak0 = _smallest[count]
    return f"{(peak - peak0) / 8 / (n - n0):.1f}"


if __name__ == "__main__":
    main()
