"""The page in Markdown."""

from __future__ import annotations

import datetime
import math
import os
import platform
import shlex
import sys

import numpy as np

from app.io.table import markdown
from benchmarks.measure import processor
from benchmarks.peers.packages import PEERS
from benchmarks.peers.runs import TARGET, Run


def row(contest, run):
    """A line of the table."""
    measured = run.seconds < math.inf
    note = run.failure
    if measured and not run.accepted:
        reached = {"residual": run.residual, "tension": run.tension}
        if run.control == "load":
            reached["error of the load"] = run.load_error
        missed = [f"{what} {value:.0e}" for what, value in reached.items() if value > TARGET]
        missed = missed or [f"penetration {run.penetration:.0e}"]
        note = f"does not reach the accuracy: {', '.join(missed)}"

    def number(value, form):
        return format(value, form) if measured and value >= 0 else ""

    return {
        "problem": contest.problem,
        "grid": f"{contest.size}^2",
        "given": run.control,
        "solver": run.solver,
        "plain": number(run.seconds / contest.unit, ".1f"),
        "first": number(run.first_seconds / contest.unit, ".1f"),
        "over ours": number(run.seconds / contest.ours.seconds, ".2f") if contest.ours.accepted else "",
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


TEXT = """\
The unit is one *plain product*: zero-padded `scipy.fft.rfft2`, multiply, `irfft2` on the same grid, one thread,
measured in the same run (`plain` is a time in this unit). One thread each; all are called from Python, in a process of
their own in which a small problem is solved before anything is measured; `plain` and `seconds` are the solve alone,
`set-up` (kernels and their transforms) apart, the shortest of up to three that follow one another; `first` is the
first of them. `over ours` is the time over that of our default method on one rank, with the same thing given: approach
or load. `MiB` is the peak resident size of the whole process.

Everybody gets the same array of distances; where a package knows no cells in which contact is impossible, these get a
distance at which they stay open. A package's own tolerance is loosened or tightened by factors of sqrt(10) until its
answer just reaches `residual` <= 1e-6, and its fastest setting and variant is reported. (Variants that need twice the
time of another one on a grid are not tried on finer ones; after a solve of more than 20 s no looser tolerance is.)
`residual` is computed here, by a plain product in double precision: ||r|| / ||h||, where r is the gap in the cells
under pressure and the penetration elsewhere; `penetration` is the largest one over the largest |h|. Negative pressures
and an error in the load must be below 1e-6 of the largest pressure and of the load. By load, the load is that of our
answer by approach.

Packages for square cells get the same bodies on the smallest square patch around the usual one (`square patch`), and
so do we in these rows. `iterations` and `products` are those on the finest grid where a package tells them; ours are
active set iterations, and all products on all grids in products on the finest.
"""

PERIODIC_TEXT = """\
The surfaces and loads of `run/bench --periodic`: self-affine, on a periodic patch of 1 mm, Hurst exponent 0.8, roll-off
1/8, cut-off 8 cells, rms slope 0.1; `load`: mean pressure over E* times the rms slope.

The unit is one *plain product*: `scipy.fft.rfft2`, times the symbol, `irfft2`, nothing padded, one thread, measured in
the same run (`plain` is a time in this unit). One thread each; all are called from Python, in a process of their own in
which a small problem is solved before anything is measured; `plain` and `seconds` are the solve alone, `set-up` apart,
the shortest of up to three that follow one another; `first` is the first of them. `over ours` is the time over that of
our default method on one rank, with the same thing given. `MiB` is the peak resident size of the whole process.

Everybody gets the same array of distances and the same mean pressure (`load`); some of ContactMechanics' solvers take
an approach only: they get the one of our answer, which nobody knows before (`approach`; in full contact it leaves the
mean pressure open). A package's own tolerance is loosened or tightened by factors of sqrt(10) until its answer just
reaches the accuracy asked for, and its fastest setting and variant is reported. (Variants that need twice the time of
another one on a grid are not tried on finer ones; after a solve of more than 20 s no looser tolerance is.)

Accuracy is computed here, by a plain product in double precision: `residual`, the rms gap in the cells under pressure
about its mean, over the rms of the undeformed distance about its mean, at most 1e-6; `penetration`, the largest over
the same, at most 1e-5; negative pressures at most 1e-6 of the largest, the error of a given mean pressure at most 1e-6.
`iterations` and `products` are those on the finest grid where a package tells them; ours are all products on all grids,
in products on the finest. All use the same symbol, 2 / (E* |q|), and displacements of mean 0.
"""

WINS = """\
Rows of the table above in which a package reaches the accuracy and beats us. Our memory includes PETSc, MPI and HDF5,
theirs Python and what they import. What they have and we have not is in the first table: friction, adhesion,
plasticity, lubrication, GPUs.
"""
PERIODIC_WINS = """\
Rows of the table above in which a package reaches the accuracy and beats us. Our memory includes PETSc, MPI and HDF5,
theirs Python and what they import.
"""


def wins(name, contests):
    """A line of the summary: in how many rows a package beats us, and in what."""
    pairs = [(run, c.ours) for c in contests for run in c.others if run.solver.startswith(f"{name}:")]
    good = [(run, ours) for run, ours in pairs if run.accepted]
    return {
        "package": name,
        "rows": len(pairs),
        "accurate enough": len(good),
        "faster": sum(run.seconds < ours.seconds or not ours.accepted for run, ours in good),
        "quicker set-up": sum(run.setup_seconds < ours.setup_seconds for run, ours in good),
        "less memory": sum(run.peak_memory < ours.peak_memory for run, ours in good),
    }


def page(packages, contests, periodic=False):
    """The whole page as Markdown."""
    versions = f"numpy {np.__version__}, Python {platform.python_version()}"
    command = shlex.join(["run/bench-peers", *sys.argv[1:]])
    table = [
        {
            "package": name,
            "versions": ", ".join(f"{key} {value}" for key, value in package.get("versions", {}).items())
            or f"not installed: {package['failure']}",
            "what it can do here, and what else": PEERS[name].about,
        }
        for name, package in packages.items()
    ]
    rows = [row(c, run) for c in contests for run in sorted([c.ours, *c.others], key=Run.rank)]
    faster = [
        f"- {run.solver}, {c.problem} {c.size}^2 by {c.control}: "
        + (f"{run.seconds / c.ours.seconds:.2f} of our time" if c.ours.accepted else "we fail")
        for c in contests
        for run in c.others
        if run.accepted and (run.seconds < c.ours.seconds or not c.ours.accepted)
    ]
    failures = [
        f"- {run.solver}, {c.problem} {c.size}^2 by {run.control}: {row(c, run)['note']}"
        for c in contests
        for run in (c.ours, *c.others)
        if not run.accepted
    ]
    return "\n".join(
        [
            f"# Benchmark against the packages of PyPI{', periodic patches' if periodic else ''}\n",
            f"Made by `{command}` on {datetime.date.today()}: {processor()}, {os.cpu_count()} cores; ours with "
            f"{versions}.\n",
            PERIODIC_TEXT if periodic else TEXT,
            "## Packages\n",
            markdown(table),
            "",
            "## Times\n",
            markdown(rows),
            "",
            "## Where they win\n",
            PERIODIC_WINS if periodic else WINS,
            markdown([wins(name, contests) for name in packages]),
            "Faster than we are:\n",
            "\n".join(faster) or "- in none of the rows above",
            "",
            "## What failed\n",
            "\n".join(failures) or "- nothing",
            "",
        ]
    )
