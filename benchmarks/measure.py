"""Heads, measured solves and memory for the pages of `run/bench`."""

import datetime
import os
import platform
import shlex
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np

from app.io.result import read_result
from benchmarks.plain import seconds

ROOT = Path(__file__).resolve().parents[1]


def publish(path, page):
    """Write the parts of a page and show them."""
    text = "\n".join(page)
    path.write_text(text, encoding="utf-8")
    print(text)


def note_on(accurate):
    """Return the note of a row about its accuracy: nothing if accurate enough."""
    return "" if accurate else "not accurate enough"


def insist(rows):
    """Exit with status 1 if rows of a page lack an accurate result."""
    noted = sum(bool(row.get("note")) for row in rows)
    if noted:
        sys.exit(f"{noted} of {len(rows)} solves: no result, or not accurate enough; see `note`")


def processor():
    """Name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = (line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    return next(names, "unknown processor")


def _commit():
    """Which state of the program this is."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=Path(__file__).parent, capture_output=True, text=True
    )
    return said.stdout.strip() or "of unknown state"


def head(options, title):
    """Return title, command, date, machine and versions for the head of a page."""
    from petsc4py import PETSc

    from app import __version__

    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    versions = f"PETSc {petsc}, numpy {np.__version__}, Python {platform.python_version()}"
    versions = f"version {__version__} ({_commit()}), {versions}"
    threads = f"OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS')}"
    command = shlex.join(["run/bench", *sys.argv[1:]])
    from app.options.method import DEFAULT, PERIODIC

    default = PERIODIC if getattr(options, "periodic", False) else DEFAULT
    method = ", ".join(options.method) or f"the default ({default}.opts)"
    return (
        f"# {title}\n\nMade by `{command}` on {datetime.date.today()}: {processor()}, {os.cpu_count()} cores; "
        f"{versions}; {threads}. Method: {method}.\n"
    )


def solve_command(problem, methods, count, output):
    """Words of a solve on some ranks."""
    method = [part for file in methods for part in ("-options_file", file)]
    return [
        "mpiexec", "-n", str(count), sys.executable, "-m", "app.solve", *problem, *method, "-output", str(output)
    ]  # fmt: skip


def quickest(command, repeats, make_product):
    """Time a solve some times, with plain products in between, and second solves.

    Parameters
    ----------
    command : list of str
        As of `solve_command`.
    repeats : int
    make_product : callable
        Makes the plain product from the result.

    Returns
    -------
    Result or str
        Of the quickest run; or the last line of a complaint.
    product : callable or None
    again : float
        Shortest time of a second solve [s].
    plain : float
        That of a plain product [s].
    """
    best = product = None
    again = plain = np.inf
    for _ in range(repeats):
        done = _run(command)
        if done.returncode:
            told = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
            return told[-1], None, again, plain
        result = read_result(command[-1])
        if product is None:
            product = make_product(result)
        plain = min(plain, seconds(partial(product, result.pressure), 3))
        if best is None or result.attributes["solve_seconds"] < best.attributes["solve_seconds"]:
            best = result
    if best is not None and best.attributes["converged"]:
        again = float(_run(["benchmarks.again" if word == "app.solve" else word for word in command]).stdout)
        plain = min(plain, seconds(partial(product, best.pressure), 3))
    return best, product, again, plain


def _run(command):
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env=dict(os.environ), check=False
    )


class Memory:
    """Return peak memory above that of the smallest grid, in doubles per additional cell."""

    def __init__(self):
        self._smallest = {}

    def __call__(self, key, size, peak):
        """Return the memory of a run as text; nothing for the smallest grid."""
        n = size * size
        n0, peak0 = self._smallest.setdefault(key, (n, peak))
        return "-" if n <= n0 else f"{(peak - peak0) / 8 / (n - n0):.1f}"
