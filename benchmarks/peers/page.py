"""Write the page in Markdown."""

import datetime
import math
import os
import platform
import shlex

import numpy as np

from app.io.table import format_markdown
from benchmarks.measure import processor
from benchmarks.peers.packages import PEERS
from benchmarks.peers.runs import CONTACT_TARGET, TARGET, Run


def row(comparison, run):
    """Return a row of the table."""
    measured = run.seconds < math.inf
    note = run.failure
    unit = comparison.unit if math.isnan(run.unit) else run.unit
    if measured and not run.accepted:
        reached = {"residual": run.residual, "tension": run.tension}
        if run.control == "load":
            reached["error of the load"] = run.load_error
        missed = [f"{what} {value:.0e}" for what, value in reached.items() if value > TARGET]
        if not missed and run.contact_residual > CONTACT_TARGET:
            missed = [f"residual on contact {run.contact_residual:.0e}"]
        missed = missed or [f"penetration {run.penetration:.0e}"]
        note = f"does not reach the accuracy: {', '.join(missed)}"

    def number(value, form):
        return format(value, form) if measured and value >= 0 else ""

    return {
        "problem": comparison.problem,
        "grid": f"{comparison.size}^2",
        "given": run.control,
        "solver": run.solver,
        "plain": number(run.seconds / unit, ".1f"),
        "first": number(run.first_seconds / unit, ".1f"),
        "over ours": number(run.seconds / comparison.ours.seconds, ".2f") if comparison.ours.accepted else "",
        "iterations": number(run.iterations, "d"),
        "products": number(run.products, ".4g"),
        "seconds": number(run.seconds, ".3g"),
        "set-up": number(run.setup_seconds, ".2g"),
        "MiB": number(run.peak_memory / 2**20, ".0f"),
        "tolerance": number(run.tolerance, ".0e"),
        "residual": number(run.residual, ".1e"),
        "penetration": number(run.penetration, ".1e"),
        "note": note,
    }


def dilute_row(comparison, run):
    """Return a row of the table of dilute contact."""
    full, ours = row(comparison, run), comparison.ours
    known = run.contact_cells >= 0
    return {
        "grid": full["grid"],
        "load": comparison.problem,
        "contact": f"{run.contact_cells / comparison.size**2:.3%}" if known else "",
        "solver": run.solver,
        "seconds": full["seconds"],
        "over ours": full["over ours"],
        "iterations": full["iterations"],
        "MiB": full["MiB"],
        "tolerance": full["tolerance"],
        "residual": full["residual"],
        "on contact": f"{run.contact_residual:.1e}" if known else "",
        "penetration": full["penetration"],
        "contact cells": run.contact_cells if known else "",
        "largest pressure": f"{run.max_pressure / ours.max_pressure - 1:.0e}"
        if known and run != ours
        else "",
        "note": full["note"],
    }


SEARCH_TEXT = """\
While the tolerance is sought each solve is done once; with the best tolerance of the fastest variant the package then
solves up to three times. A variant that needs more than twice the time of another one at some tolerance is not tried
further, nor on finer grids. After a solve of more than `--budget` seconds (20) no looser tolerance is tried. A process
must end within the `--limit`.
"""

TEXT = (
    """\
How it is measured: times are ratios of processor times to that of one *plain product*: zero-padded `scipy.fft.rfft2`,
multiplication, `irfft2` on the same grid, one thread, measured in the same run. All solvers are called from Python with
one thread, each in a process of its own, after a small problem that is not measured.

- `given`: the prescribed quantity. A load is that of our answer by approach.
- `plain`, `seconds`: time of the solve without set-up, the shortest of up to three solves.
- `first`: time of the first of them, in plain products.
- `over ours`: time over that of our default method on one rank for the same prescribed quantity.
- `set-up`: time to compute kernels and their transforms.
- `MiB`: peak resident memory of the process.
- `iterations`, `products`: on the finest grid, if the package reports them. Ours are active set iterations, and all
  products on all grids, counted in products on the finest grid.
- `residual`: ||r|| / ||h||, computed by a plain product in double precision; r is the gap under pressure and the
  penetration elsewhere.
- `penetration`: the largest one, over the largest |h|.

All packages get the same undeformed distances. Cells where contact is impossible get a distance at which they stay open
if a package does not know such cells. Packages that need square cells get the same bodies on the smallest square patch
around the usual one, and so does this project in these rows (`square patch`).

The tolerance of a package is changed by factors of sqrt(10) until its answer just reaches a residual of 1e-6; its
fastest setting and variant is reported. Negative pressures must be below 1e-6 of the largest pressure, and the error of
the load below 1e-6.

"""
    + SEARCH_TEXT
)

DILUTE_TEXT = (
    """\
[Dilute contact](../methods.md#dilute-contact) is solved on lists of cells. Of the packages that were tried, ASPHER is
the only other one whose work follows the contact instead of the grid. Here both solve the same problems. Above about 1%
of contact this program solves on all cells, so the ratio jumps there.

- *Problem.* A self-affine surface: amplitudes q^-1.8 of the waves with 12 to 0.165 n periods on the patch of n x n
  cells, random phases, a standard deviation of 0.005 mm on a free patch of 1 mm x 1 mm, E* = 1 N/mm2. The load is
  prescribed. At each size the waves are others, so the rows of two sizes are different surfaces.
- `seconds`: CPU time of set-up and solve together, the shortest of up to three. Each solve has a new solver.
- `over ours`: seconds over ours.
- `iterations`: on the finest grid. `MiB`: peak resident memory of the process.
- `residual`: ||r|| / ||h||; r is the gap under pressure and the penetration elsewhere; at most 1e-6. `on contact`: the
  same on contact cells alone; at most 1e-4, because ||h|| of the patch is large. This program ends its solves by the
  same two limits.
- `penetration`: the largest one, over the largest |h|.
- `contact cells`: their number. `largest pressure`: relative difference from ours.

How it is measured: each solver is called from Python with one thread, in a process of its own, after a small problem
that is not measured. The settings of `nested, h2, active set` are `aspher.solve_nested(backend="h2", active_set=True,
coarsest=64)`.

The tolerance of ASPHER is changed by factors of sqrt(10) until its answer just reaches this accuracy, which is computed
by one zero-padded product in double precision. All of our answers have a proved error bound; ASPHER has none.

"""
    + SEARCH_TEXT
)

PERIODIC_TEXT = (
    """\
The surfaces and loads are those of `run/bench --periodic`: self-affine on a period of 1 mm, Hurst exponent 0.8,
roll-off 1/8, cut-off 8 cells, rms slope 0.1.

How it is measured: times are ratios of processor times to that of one *plain product*: `scipy.fft.rfft2`,
multiplication by the symbol, `irfft2`, without padding, one thread, measured in the same run. All solvers are called
from Python with one thread, each in a process of its own, after a small problem that is not measured.

- `load`: mean pressure over E* times the rms slope.
- `given`: the prescribed quantity. Some solvers of ContactMechanics take an approach only; they get the approach of our
  answer. In full contact it does not determine the mean pressure.
- `plain`, `seconds`: time of the solve without set-up, the shortest of up to three solves.
- `first`: time of the first of them, in plain products.
- `over ours`: time over that of our default method on one rank for the same prescribed quantity.
- `set-up`: time to prepare the first solve.
- `MiB`: peak resident memory of the process.
- `iterations`, `products`: on the finest grid, if the package reports them. Our products are those on all grids,
  counted in products on the finest grid.
- `residual`: rms gap under pressure about its mean, over the rms of the undeformed distance about its mean; at most
  1e-6.
- `penetration`: the largest one, over the same; at most 1e-5.

Accuracy is computed by a plain product in double precision. Negative pressures must be below 1e-6 of the largest
pressure, and the error of a given mean pressure below 1e-6. All packages get the same undeformed distances and use the
same symbol, 2 / (E* |q|), and displacements of mean 0.

The tolerance of a package is changed by factors of sqrt(10) until its answer just reaches this accuracy; its fastest
setting and variant is reported.

"""
    + SEARCH_TEXT
)

HARDNESS_TEXT = (
    """\
The surface is that of `run/bench-peers --periodic`, with a period of 1 mm and rms slope 0.1. The mean pressure is
prescribed, and no pressure exceeds the hardness H.

- `load`: mean pressure over E* times the rms slope.
- `H`: hardness over the largest pressure at this load without a hardness. In the last two problems the mean pressure is
  H, or (1 - 1e-9) H: all cells are plastic, or all except one.

How it is measured: times are ratios of CPU times, the solve over one *plain product* in the same process:
`scipy.fft.rfft2`, multiplication by a symbol, `irfft2`, without padding, one thread, shortest of 20 before and after
the solves. Other programs may have run meanwhile, so prefer `products` where a package reports them. Each solver runs
in a process of its own, after a small problem that is not measured.

- `plain`, `seconds`: CPU time of the solve without set-up, the shortest of up to three solves.
- `first`: CPU time of the first of them, in plain products.
- `over ours`: seconds over those of our default method on one rank.
- `set-up`: CPU time to prepare the first solve.
- `MiB`: peak resident memory of the process.
- `iterations`: on the finest grid, as the package reports them; of KatoSaturated the sum over its inner solves.
- `products`: as ContactMechanics reports them. Ours are those on all grids, counted in products on the finest grid.
  tamaas does not report them.
- `residual`: rms gap in elastic cells (0 < p < H) about its mean, over the rms of the undeformed distance about its
  mean; at most 1e-6. Without elastic cells it is 0.
- `penetration`: the largest penetration in open or elastic cells, or the largest gap in elastic or plastic cells
  (p = H), over the same; at most 1e-5.

Accuracy is computed by one product with the symbol 2 / (E* |q|) in double precision. Negative pressures and the excess
over H must be below 1e-6 of the largest pressure, and the error of the mean pressure below 1e-6. Cells with p above
(1 - 1e-9) H count as plastic. The approach is the one that fits the elastic cells best; without elastic cells it is the
least one at which no plastic cell has a gap.

The steps of KatoSaturated have a fixed size: in N/mm2 it does not converge here. It gets pressures in units of 6 E*,
about the largest for which its steps are stable on this period, and the fastest.

The tolerance of a package is changed by factors of sqrt(10) until its answer just reaches this accuracy; its fastest
setting is reported.

"""
    + SEARCH_TEXT
)

LAYER_TEXT = (
    """\
The elastic body is a layer of thickness t on a rigid base. E* below is that of the layer's material. The symbol is
2 / (E* |q|) times the ratio for a layer (Johnson, *Contact Mechanics*, Sec. 5.8); all packages use the same one.

- `t`: thickness of the layer in cells. `nu`: its Poisson's ratio.
- The plain product is measured in the process of the solver. Other programs may have run meanwhile, so prefer
  `products`.

"""
    + PERIODIC_TEXT
)

TEXTS = {
    "free": TEXT,
    "dilute": DILUTE_TEXT,
    "periodic": PERIODIC_TEXT,
    "hardness": HARDNESS_TEXT,
    "layer": LAYER_TEXT,
}
TITLES = {
    "free": "",
    "dilute": ", dilute contact",
    "periodic": ", periodic patches",
    "hardness": ", periodic patches with a hardness",
    "layer": ", layers on a rigid base",
}

WINS = """\
The table counts rows above in which a package reaches the accuracy and is better than this project. Our memory includes
PETSc, MPI and HDF5, theirs Python and its imports. The first table lists what else they can do: friction, adhesion,
plasticity, lubrication, GPUs.
"""
PERIODIC_WINS = """\
The table counts rows above in which a package reaches the accuracy and is better than this project. Our memory includes
PETSc, MPI and HDF5, theirs Python and its imports.
"""


def wins(name, comparisons):
    """Return a row of the summary: how often, and in what, a package is better."""
    pairs = [(run, c.ours) for c in comparisons for run in c.others if run.solver.startswith(f"{name}:")]
    good = [(run, ours) for run, ours in pairs if run.accepted]
    return {
        "package": name,
        "rows": len(pairs),
        "accurate enough": len(good),
        "faster": sum(run.seconds < ours.seconds or not ours.accepted for run, ours in good),
        "quicker set-up": sum(run.setup_seconds < ours.setup_seconds for run, ours in good),
        "less memory": sum(run.peak_memory < ours.peak_memory for run, ours in good),
    }


def page(packages, comparisons, kind, words):
    """Return the page; `words` are the options of the command."""
    versions = f"numpy {np.__version__}, Python {platform.python_version()}"
    command = shlex.join(["run/bench-peers", *words])
    table = [
        {
            "package": name,
            "versions": ", ".join(f"{key} {value}" for key, value in package.get("versions", {}).items())
            or f"not installed: {package['failure']}",
            "abilities here, and others": PEERS[name].about,
        }
        for name, package in packages.items()
    ]
    make_row = dilute_row if kind == "dilute" else row
    rows = [make_row(c, run) for c in comparisons for run in sorted([c.ours, *c.others], key=Run.rank)]
    faster = [
        f"- {run.solver}, {c.problem} {c.size}^2 by {c.control}: "
        + (f"{run.seconds / c.ours.seconds:.2f} of our time" if c.ours.accepted else "we fail")
        for c in comparisons
        for run in c.others
        if run.accepted and (run.seconds < c.ours.seconds or not c.ours.accepted)
    ]
    failures = [
        f"- {run.solver}, {c.problem} {c.size}^2 by {run.control}: {row(c, run)['note']}"
        for c in comparisons
        for run in (c.ours, *c.others)
        if not run.accepted
    ]
    return "\n".join(
        [
            f"# Benchmark against other packages{TITLES[kind]}\n",
            f"Made by `{command}` on {datetime.date.today()}: {processor()}, {os.cpu_count()} cores; ours with "
            f"{versions}.\n",
            TEXTS[kind],
            "## Packages\n",
            format_markdown(table),
            "",
            "## Times\n",
            format_markdown(rows),
            "",
            "## Where other packages are better\n",
            WINS if kind == "free" else PERIODIC_WINS,
            format_markdown([wins(name, comparisons) for name in packages]),
            "Faster than this project:\n",
            "\n".join(faster) or "- in none of the rows above",
            "",
            "## Failures\n",
            "\n".join(failures) or "- nothing",
            "",
        ]
    )
