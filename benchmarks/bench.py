"""Page of speed: kernels and solves as ratios to a plain FFT product of the same run.

Run by ``run/bench``; see there.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.io.table import format_markdown, write_table
from app.problems.random_surfaces import SelfAffineSurface
from benchmarks import loads, periodic, replay
from benchmarks.measure import ROOT, Memory, head, insist, note_on, publish, quickest, solve_command
from benchmarks.plain import PlainProduct, check, seconds

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
    parser.add_argument("--sizes", help="cells per side; default: 256,512,1024,2048, periodic: 512,1024,2048")
    parser.add_argument("--ranks", help="default: 1,2; to replay: 64,512,4096")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument(
        "--method", action="append", default=[], help="option file(s); default: the default method"
    )
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-kernels", action="store_true")
    parser.add_argument(
        "--loads", action="store_true", help="the load sweep only, on all --sizes; it has a page of its own"
    )
    parser.add_argument(
        "--periodic", action="store_true", help="periodic patches only; they have a page of their own"
    )
    parser.add_argument(
        "--replay",
        action="store_true",
        help="what a solve sends on many ranks, on all --sizes (default 4096)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        help="default: benchmark.md, benchmark-loads.md, benchmark-periodic.md in docs/notebook/",
    )
    options = parser.parse_args()
    usual = "4096" if options.replay else "512,1024,2048" if options.periodic else "256,512,1024,2048"
    sizes = [int(size) for size in (options.sizes or usual).split(",")]
    ranks = [
        int(count) for count in (options.ranks or ("64,512,4096" if options.replay else "1,2")).split(",")
    ]
    names = options.problems.split(",")
    unknown = set(names) - set(PROBLEMS)
    if unknown:
        parser.error(f"unknown problems {sorted(unknown)}; allowed: {', '.join(PROBLEMS)}")
    if options.loads and len(options.method) > 1:
        parser.error("--loads takes one --method")
    if options.loads and options.periodic:
        parser.error("--loads and --periodic: choose one")
    notebook = ROOT / "docs/notebook"
    if options.replay:
        replay.write_page(sizes, ranks, options.output)
        return
    if options.periodic:
        periodic.write_page(sizes, ranks, options, options.output or notebook / "benchmark-periodic.md")
        return
    if options.loads:
        load_sweep(sizes, ranks, options, options.output or notebook / "benchmark-loads.md")
        return

    output = options.output or notebook / "benchmark.md"
    page = [head(options, "Benchmark on free patches"), UNIT]
    if not options.no_kernels:
        page += ["## Kernels\n", KERNELS, format_markdown(kernels(sizes, ranks)), ""]
    rows, memory = [], Memory()
    with tempfile.TemporaryDirectory() as folder:
        work = [(name, size, count) for size in sizes for name in names for count in ranks]
        for name, size, count in tqdm(work, desc="solves", disable=None):
            rows.append(solve(name, size, count, options, Path(folder), memory))
    page += ["## Whole solves\n", SOLVES, format_markdown(rows), ""]
    publish(output, page)
    if len(options.method) <= 1:
        small = [size for size in sizes if size <= 512]
        load_sweep(small, ranks, options, output.with_name(f"{output.stem}-loads.md"))
    insist(rows)


UNIT = """\
Times are ratios to one *plain product*: zero-padded `scipy.fft.rfft2`, multiplication, `irfft2` on the same grid, one
thread, measured in the same run (shortest of several). Seconds are for orientation only.
"""
KERNELS = """\
- `product`, `single precision`, `multilevel`: the program's product, the same in single precision, and the approximate
  product for corrections, in plain products.
- `product, 2 ranks`: the product on two ranks, over the plain product on one rank.
- `memory`: storage of a product without its vectors, in doubles per cell.
- `circulant`: one application of the preconditioner, over `product`.
- `sweep, Hertz`, `sweep, rough`: one exact Gauss-Seidel sweep on these contact sets, over `product`.
"""
SOLVES = """\
The approach is prescribed; solves end at ||r|| / ||h|| = 1e-6.

- `plain`: time of the first solve of a process without set-up, in plain products, shortest of several.
- `again`: time of a second solve on the same solver, in plain products.
- `applications`: all work, in products on the target grid.
- `memory`: peak resident memory above that of the smallest grid, in doubles per cell.
- `residual`, `penetration`: checked from the result file by a plain product; the penetration is over the largest |h|.
"""
LOADS = """\
Self-affine surfaces on a patch of 1 mm (three spectra, three seeds each) are solved by load, and again by the approach
that belongs to this load. Each solve is a row of the CSV file of the same name.

- `load`: mean pressure over E* times the rms slope.
- `contact`: share of the cells in contact, smallest and largest of the nine surfaces.
- `by approach`, `by load`: operator applications, median and largest.
- `ratio`: applications by load over those by approach, median and largest.
- `fallbacks`: number of solves that needed the safeguard, by approach and by load.
- `error bound`: the largest one.
- `seconds`: sum over the surfaces, by approach and by load.
"""
CONTROLS = "approach", "load"


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
        "multilevel": f"{times['levels32'] / plain:.3f}",
        "memory": f"{times['memory']:.2f}",
    }
    for name in ("circulant", "sweep, Hertz", "sweep, rough"):
        key = name.replace(", ", "_").lower()
        row[name] = f"{times[key] / times['product']:.2f}"
    row["seconds"] = f"{times['product']:.2g}"
    return row


def paper_grid(size):
    """Return the grid of the paper's Hertz problem."""
    return Grid.from_domain(size, size, (-10, 10, -6, 6))


def self_affine(size, folder):
    """Write the gap of a self-affine surface under a flat body; return options to solve it."""
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


def solve(name, size, count, options, folder, memory):
    """Solve one problem a few times; the row of the quickest run."""
    words = [*(PROBLEMS[name] or self_affine(size, folder)), "-grid", str(size)]
    command = solve_command(words, options.method, count, folder / "result.h5")
    best, product, again, plain = quickest(command, options.repeats, padded_product)
    row = {"problem": name, "grid": f"{size}^2", "ranks": count}
    if isinstance(best, str):
        return row | {"note": best}
    facts = best.attributes
    found = check(product, best.pressure, best.undeformed_distance)
    accurate = max(found["residual"], found["tension"]) <= 1e-6 and found["outside"]
    return row | {
        "plain": f"{facts['solve_seconds'] / plain:.1f}",
        "again": f"{again / plain:.1f}",
        "applications": f"{facts['operator_applications']:.1f}",
        "iterations": facts["active_set_iterations"],
        "inner": facts["inner_iterations"],
        "seconds": f"{facts['solve_seconds']:.3g}",
        "set-up": f"{facts['setup_seconds']:.2g}",
        "memory": memory((name, count), size, facts["peak_memory"]),
        "residual": f"{found['residual']:.1e}",
        "penetration": f"{found['penetration']:.1e}",
        "note": note_on(accurate),
    }


def padded_product(result):
    """Return the plain product of the free patch of a result."""
    facts = result.attributes
    grid = Grid(*result.pressure.shape[::-1], *(float(axis[1] - axis[0]) for axis in (result.x, result.y)))
    return PlainProduct(grid, Material.combined(facts["shear_modulus"], facts["poisson_ratio"]).kernel)


def load_sweep(sizes, ranks, options, output):
    """Measure `benchmarks.loads` on all grids and numbers of ranks; write page and CSV."""
    rows, failures = [], []
    surfaces = len(loads.SPECTRA) * len(loads.SEEDS)
    with tqdm(total=len(sizes) * len(ranks) * surfaces * len(loads.LOADS), desc="loads", disable=None) as bar:
        for size, count in itertools.product(sizes, ranks):
            failure = run_loads(size, count, options.method, rows, bar)
            if failure:
                failures.append(f"- {size}^2 on {count} rank(s) ended early: {failure}")
    for row in rows:
        row["ratio"] = row["by_load_applications"] / row["by_approach_applications"]
    write_table(output.with_suffix(".csv"), rows)
    page = [
        head(options, "Benchmark of prescribed loads"),
        LOADS,
        format_markdown(loads_summary(rows)),
        "",
        *failures,
    ]
    worst = sorted(rows, key=lambda row: row["ratio"], reverse=True)[:10]
    page += ["Largest ratios:\n", format_markdown([worst_row(row) for row in worst]), ""]
    publish(output, page)


def run_loads(size, count, method, rows, bar):
    """Run `benchmarks.loads` on some ranks and append its rows; return why it failed, or nothing."""
    command = ["mpiexec", "-n", str(count), sys.executable, "-m", "benchmarks.loads", str(size)]
    command += [Path(file).stem for file in method]
    with tempfile.TemporaryFile("w+") as errors:
        pipes = {"stdout": subprocess.PIPE, "stderr": errors, "text": True}
        with subprocess.Popen(command, cwd=ROOT, env=dict(os.environ), **pipes) as process:
            for line in process.stdout:
                rows.append(json.loads(line))
                bar.update()
        errors.seek(0)
        told = errors.read().strip().splitlines() or [f"exit status {process.returncode}"]
    return told[-1] if process.returncode else ""


def loads_summary(rows):
    """Return one row for each grid, number of ranks and load, over all surfaces."""
    groups = {}
    for row in rows:
        groups.setdefault((row["grid"], row["ranks"], row["load"]), []).append(row)

    def spread(group, name):
        values = [row[name] for row in group]
        return f"{np.median(values):.0f} · {max(values):.0f}"

    return [
        {
            "grid": f"{size}^2",
            "ranks": count,
            "load": f"{load:g}",
            "contact": " - ".join(f"{f(row['contact'] for row in group):.2%}" for f in (min, max)),
            "by approach": spread(group, "by_approach_applications"),
            "by load": spread(group, "by_load_applications"),
            "ratio": f"{np.median([r['ratio'] for r in group]):.2f} · {max(r['ratio'] for r in group):.2f}",
            "fallbacks": " · ".join(str(sum(r[f"by_{c}_fallbacks"] > 0 for r in group)) for c in CONTROLS),
            "error bound": f"{max(row[f'by_{c}_error_bound'] for row in group for c in CONTROLS):.1e}",
            "not solved": sum(not row[f"by_{c}_converged"] for row in group for c in CONTROLS),
            "seconds": " · ".join(f"{sum(row[f'by_{c}_seconds'] for row in group):.3g}" for c in CONTROLS),
        }
        for (size, count, load), group in groups.items()
    ]


def worst_row(row):
    """Return the row of a single problem."""
    return {
        "grid": f"{row['grid']}^2",
        "ranks": row["ranks"],
        "Hurst, roll-off, cut-off": row["spectrum"],
        "seed": row["seed"],
        "load": f"{row['load']:g}",
        "contact": f"{row['contact']:.2%}",
        "by approach": f"{row['by_approach_applications']:.0f}",
        "by load": f"{row['by_load_applications']:.0f}",
        "ratio": f"{row['ratio']:.2f}",
        "fallbacks": f"{row['by_approach_fallbacks']} · {row['by_load_fallbacks']}",
        "error bound": f"{row['by_approach_error_bound']:.1e} · {row['by_load_error_bound']:.1e}",
    }


if __name__ == "__main__":
    main()
