"""The public contact solvers of PyPI on our problems, to the same checked accuracy.

Run by ``run/bench-peers``; see there. Every package lives in an environment of its own and is driven by a small
script, ``benchmarks/peers/*_adapter.py`` (see ``protocol.py`` there). All get the same array of distances; all
pressures are checked here by a plain product.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app.halfspace.grid import Grid
from app.options import TABLE
from app.output.result import read_result
from app.output.table import markdown
from app.solve import make_problem
from benchmarks.bench import PROBLEMS, ROOT, self_affine
from benchmarks.plain import PlainProduct, check, seconds

ADAPTERS = ROOT / "benchmarks" / "peers"
OURS = "this project"
TARGET = 1e-6
TIGHTEST = 26  # tolerances are 10^(-k/2), k up to this


# -- environments ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Peer:
    """How to install a package, and what it has that a table of times does not show."""

    requirement: str
    about: str
    pythons: tuple[str, ...] = ()  # versions that have wheels for its dependencies; () for any
    first: str = ""  # to be installed before, for the build
    build: tuple[tuple[str, str], ...] = ()  # environment variables of the build


PEERS = {
    "aspher": Peer(
        "aspher==0.1.3.post1",
        "Load only; square patches of square cells; contact everywhere. Also periodic contact, friction, and an FMM "
        "product with very little memory per cell (here slower than its FFT). Its build finds Eigen from PyPI.",
        first="cmeel-eigen",  # headers that the build would otherwise fetch from elsewhere
        build=(("CMAKE_PREFIX_PATH", "{site}/cmeel.prefix"),),
    ),
    "slippy": Peer(
        "slippy==0.5.2",
        "Approach and load; contact everywhere. Also lubrication, wear, plastic limits, layers, GPUs. Needs "
        "numpy < 1.21, so Python 3.9 at most.",
        pythons=("3.9", "3.8"),
    ),
    "tamaas": Peer(
        "tamaas==2.9.0",
        "Load only (its other control is the mean gap); contact everywhere. Periodic at heart: the free half-space is "
        "its operator `dcfft`. Also adhesion, friction, plasticity, MPI.",
    ),
    "contactmechanics": Peer(
        "ContactMechanics==1.8.3",
        "Approach and load; cells where contact is impossible can be masked in its constrained CG. Also periodic "
        "contact, adhesion (in a sister package), a hardness limit, MPI.",
    ),
}


class Unavailable(Exception):
    """A package that cannot be installed here; the message is pip's."""


def install(name, folder):
    """Return the Python of a package's environment, made if need be.

    Raises
    ------
    Unavailable
        With the line in which pip says why.
    """
    peer = PEERS[name]
    home = folder / name
    python, stamp = home / "bin" / "python", home / "installed.txt"
    recipe = repr(peer)
    if stamp.exists() and stamp.read_text() == recipe:
        return python
    shutil.rmtree(home, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".gitignore").write_text("*\n")
    say(f"installing {peer.requirement} in {home}")
    made = capture([find_python(peer.pythons), "-m", "venv", home])
    if made.returncode:
        raise Unavailable(reason(made))
    site = capture([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]).stdout.strip()
    environment = dict(os.environ) | {key: value.format(site=site) for key, value in peer.build}
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    for requirement in filter(None, (peer.first, peer.requirement)):
        done = capture([*pip, requirement], env=environment)
        if done.returncode:
            shutil.rmtree(home)
            raise Unavailable(reason(done))
    stamp.write_text(recipe)
    return python


def find_python(versions):
    """Path of an interpreter of one of these versions that can make environments; Debian's own if any will do."""
    if not versions:
        return "/usr/bin/python3"
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in versions:
        for candidate in (f"python{version}", *pyenv.glob(f"{version}.*/bin/python")):
            path = shutil.which(candidate)
            if path and capture([path, "-c", "import ensurepip, venv"]).returncode == 0:
                return path
    raise Unavailable(f"needs Python {' or '.join(versions)}, which is not on this machine")


def capture(command, **options):
    """Run a command and return it with its exit status and output.

    The environment is Python's: Open MPI, loaded here, adds to that of the process what stops `mpiexec`.
    """
    options = {"env": dict(os.environ), "capture_output": True, "text": True, "check": False} | options
    return subprocess.run([*map(str, command)], **options)


def reason(done):
    """The last line in which a failed command speaks of an error, else its last line."""
    lines = (done.stderr + done.stdout).strip().splitlines() or [f"exit status {done.returncode}"]
    return next((line.strip() for line in reversed(lines) if "error" in line.lower()), lines[-1].strip())


# -- problems ----------------------------------------------------------------------------------------------


class Words:
    """Options from a command line without PETSc's database: what `make_problem` asks for."""

    kinds = {option.name: option for option in TABLE}  # noqa: RUF012

    def __init__(self, words):
        self.text = {}
        for name, value in zip(words[::2], words[1::2], strict=True):
            lines = (
                Path(ROOT, value).read_text().splitlines() if name == "-options_file" else [f"{name} {value}"]
            )
            for line in lines:
                key, _, text = line.partition("#")[0].strip().partition(" ")
                if key:
                    self.text[key[1:]] = text.strip()

    def given(self, name):
        """Whether an option is there."""
        return name in self.text

    def __getitem__(self, name):
        option = self.kinds[name]
        return option.kind(self.text[name]) if name in self.text else option.default


class Case:
    """A problem on a grid, in files that our solver and the adapters read.

    Parameters
    ----------
    name : str
        Of `benchmarks.bench.PROBLEMS`.
    size : int
        Cells per side.
    folder : Path
    square : bool
        Take the smallest square patch around the usual one: the same bodies, on square cells.
    """

    def __init__(self, name, size, folder, square=False):
        self.size = size
        options = Words([*(PROBLEMS[name] or self_affine(size, folder)), "-grid", str(size)])
        problem = make_problem(options, MPI.COMM_SELF)
        grid = problem.grid
        self.domain = grid.x0, grid.x0 + size * grid.dx, grid.y0, grid.y0 + size * grid.dy
        self.is_square = math.isclose(grid.dx, grid.dy)
        if square and not self.is_square:
            half = max(self.domain)
            self.domain = -half, half, -half, half
            problem = replace(problem, grid=Grid.from_domain(size, size, self.domain))
        self.name = f"{name}, square patch" if square and not self.is_square else name
        self.problem, self.grid, self.material = problem, problem.grid, problem.material
        self.gap = problem.shape_on(self.grid)
        self.approach, self.load = options["approach"], math.nan
        self.stem = folder / f"{self.name.replace(', ', '-').replace(' ', '-')}-{size}"
        np.save(self.gap_file, self.gap)

    @property
    def gap_file(self):
        """The distances at zero approach, for our solver."""
        return self.stem.with_suffix(".npy")

    def write(self):
        """Write the file for the adapters, once the load is known."""
        path = self.stem.with_suffix(".npz")
        np.savez(
            path,
            gap=self.gap,
            dx=self.grid.dx,
            dy=self.grid.dy,
            approach=self.approach,
            load=self.load,
            contact_modulus=self.material.contact_modulus,
            shear_modulus=self.material.shear_modulus,
            poisson_ratio=self.material.poisson_ratio,
        )
        return path

    @cached_property
    def product(self):
        """The plain product, which is the unit and the judge."""
        return PlainProduct(self.grid, self.material.compliance)

    def unit(self):
        """Seconds of a plain product now."""
        pressure = np.where(self.gap < self.approach, 1.0, 0.0)
        return seconds(partial(self.product, pressure))

    def judge(self, pressure, control):
        """Accuracy of a pressure by one plain product; see `Run`.

        A prescribed load says nothing of the approach: it is the one that fits the cells under pressure best.
        """
        approach = self.approach
        clean = np.isfinite(pressure).all() and (pressure > 0).any()
        if not clean:
            return {
                "residual": math.inf,
                "penetration": math.inf,
                "tension": math.inf,
                "load_error": math.inf,
            }
        gap = self.gap + self.product(pressure)
        if control == "load":
            approach = float(np.mean(gap[pressure > 0]))
        h = self.gap - approach
        found = check(self.product, pressure, h)
        admissible, gap = ~np.isnan(h), gap - approach
        defect = np.where(pressure > 0, gap, np.minimum(gap, 0.0))[admissible]
        load = float(pressure.sum() * self.grid.cell_area)
        return {
            "residual": float(np.linalg.norm(defect) / np.linalg.norm(h[admissible]))
            if found["outside"]
            else math.inf,
            "penetration": found["penetration"],
            "tension": found["tension"] + 0.0,
            "load_error": abs(load / self.load - 1) if control == "load" else 0.0,
        }


def warm_up(folder):
    """A small Hertz problem, solved before anything is measured."""
    case = Case("hertz", 128, folder, square=True)
    case.load = case.problem.reference(case.approach).load
    return case.write()


# -- runs --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """One measured solve. `residual`: norm of e where p > 0 and of penetrations elsewhere, over ||h||."""

    solver: str
    control: str
    tolerance: float = math.nan
    seconds: float = math.inf
    setup_seconds: float = math.nan
    iterations: int = -1
    products: float = -1
    peak_memory: float = math.nan
    residual: float = math.inf
    penetration: float = math.inf
    tension: float = math.inf
    load_error: float = math.inf
    failure: str = ""

    @property
    def accepted(self):
        """Whether the accuracy that all are held to is reached."""
        return max(self.residual, self.tension, self.load_error) <= TARGET

    def rank(self):
        """Sorting key: what reaches the accuracy by time, then the rest by what it reached."""
        return (0, self.seconds) if self.accepted else (1, self.residual)


def run_ours(case, control, repeats, folder):
    """Our default method on one rank; the shortest of some runs."""
    output = folder / "ours.h5"
    value = case.approach if control == "approach" else case.load
    command = [
        "mpiexec", "-n", "1", sys.executable, "-m", "app.solve", "-problem", "file", "-gap_file", case.gap_file,
        "-domain", ",".join(map(repr, case.domain)), "-shear_modulus", case.material.shear_modulus,
        "-poisson_ratio", case.material.poisson_ratio, f"-{control}", repr(value),
        "-lcp_rtol", TARGET, "-output", output,
    ]  # fmt: skip
    best = None
    for _ in range(repeats):
        done = capture(command, cwd=ROOT)
        if done.returncode:
            return Run(OURS, control, failure=reason(done)), None
        result = read_result(output)
        if best is None or result.attributes["solve_seconds"] < best.attributes["solve_seconds"]:
            best = result
    facts = best.attributes
    run = Run(
        OURS, control, TARGET, facts["solve_seconds"], facts["setup_seconds"], facts["active_set_iterations"],
        facts["operator_applications"], facts["peak_memory"], **case.judge(best.pressure, control),
    )  # fmt: skip
    return run, facts["load"]


class Search:
    """The loosest tolerance of one variant of one package that reaches the accuracy, and its fastest run."""

    def __init__(self, python, name, variant, description, warmup, options):
        self.python, self.name, self.variant = python, name, variant
        self.control = description["control"]
        self.start = round(-2 * math.log10(description["first_tolerance"]))
        self.warmup, self.options = warmup, options

    def __call__(self, case, problem_file, folder):
        """Return the fastest accepted run, else the most accurate one."""
        runs, k = {}, self.start
        bad, good = -1, None  # the tightest tolerance that was not enough, the loosest that was
        while bad < k <= TIGHTEST and k != good:
            run = runs[k] = self.run(case, problem_file, folder, k)
            if run.failure or run.residual == math.inf:
                break
            step = math.floor(2 * math.log10(run.residual / TARGET)) if run.residual > 0 else 0
            if run.accepted:
                if good is not None and run.residual > 0.99 * runs[good].residual > 0.98 * run.residual:
                    break  # loosening changes nothing any more
                if run.seconds > self.options.budget:
                    break  # half a decade is not worth another such run
                good, k = k, max(k + min(step, -1), bad + 1)
            else:
                if any(j <= k - 6 and run.residual > runs[j].residual / 2 for j in runs):
                    break  # three decades gained nothing
                bad, k = k, k + max(step, 1)
                if good is not None:
                    k = min(k, good - 1)
        accepted = {j: run for j, run in runs.items() if run.accepted}
        if accepted:
            self.start, best = min(accepted.items(), key=lambda item: item[1].seconds)
            return best
        return min(runs.values(), key=lambda run: (run.residual, run.seconds))

    def run(self, case, problem_file, folder, k):
        """Run the adapter once, with tolerance 10^(-k/2)."""
        answer = folder / "answer.npz"
        tolerance = 10 ** (-k / 2)
        label = f"{self.name}: {self.variant}"
        command = [
            self.python, ADAPTERS / f"{self.name}_adapter.py", "solve", problem_file, self.warmup, answer,
            self.variant, tolerance, self.options.budget,
        ]  # fmt: skip
        failure = ""
        try:
            done = capture(command, cwd=folder, timeout=self.options.limit)
            if done.returncode:
                failure = reason(done)
        except subprocess.TimeoutExpired:
            failure = f"more than {self.options.limit:g} s"
        if failure:
            say(f"  {label}, {tolerance:.1e}: {failure}")
            return Run(label, self.control, tolerance, failure=failure)
        with np.load(answer) as data:
            numbers = {
                name: data[name].item() for name in data.files if name not in ("pressure", "converged")
            }
            run = Run(label, self.control, tolerance, **numbers, **case.judge(data["pressure"], self.control))
        say(
            f"  {label}, {tolerance:.1e}: {run.seconds:.3g} s, {run.iterations} iterations, "
            f"residual {run.residual:.1e}, tension {run.tension:.1e}, load {run.load_error:.1e}"
        )
        return run


# -- the page ----------------------------------------------------------------------------------------------


def main():
    """Install, measure, write the page."""
    parser = argparse.ArgumentParser("run/bench-peers", description=__doc__)
    parser.add_argument("--sizes", default="256,512,1024", help="cells per side")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument("--only", default=",".join(PEERS), help="packages")
    parser.add_argument("--limit", type=float, default=900, help="seconds for one process of a package")
    parser.add_argument("--budget", type=float, default=20, help="seconds for the repetitions of one solve")
    parser.add_argument(
        "--environments", default=str(ROOT / ".venv-peers"), help="where the packages are installed"
    )
    parser.add_argument("-o", "--output", default=str(ROOT / "docs" / "benchmark-peers.md"))
    options = parser.parse_args()
    names, problems = options.only.split(","), options.problems.split(",")
    for given, allowed in ((names, PEERS), (problems, PROBLEMS)):
        if set(given) - set(allowed):
            parser.error(
                f"unknown: {', '.join(sorted(set(given) - set(allowed)))}; allowed: {', '.join(allowed)}"
            )
    sizes = sorted(int(size) for size in options.sizes.split(","))

    packages = {name: set_up(name, Path(options.environments)) for name in names}
    contests = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        warmup = warm_up(folder)
        searches = {
            name: [
                Search(package["python"], name, variant, description, warmup, options)
                for variant, description in package["variants"].items()
            ]
            for name, package in packages.items()
            if "python" in package
        }
        for problem in problems:
            starts = {search: search.start for group in searches.values() for search in group}
            field = {name: list(group) for name, group in searches.items()}
            for size in sizes:
                for square in (False, True):
                    entrants = {name: field[name] for name in field if packages[name]["square"] == square}
                    case = Case(problem, size, folder, square)
                    if case.is_square:
                        entrants = dict(field) if not square else {}
                    if entrants:
                        contests += compare(case, entrants, field, folder)
                        Path(options.output).write_text(page(packages, contests))
            for search, start in starts.items():
                search.start = start
    print(page(packages, contests))


def set_up(name, folder):
    """Environment and description of a package, or why there is none."""
    try:
        python = install(name, folder)
        command = [python, ADAPTERS / f"{name}_adapter.py", "describe"]
        done = capture(command)
        if done.returncode:
            raise Unavailable(reason(done))
    except Unavailable as failure:
        say(f"{name} is not available: {failure}")
        return {"failure": str(failure), "square": False}
    return {"python": python, **json.loads(done.stdout.strip().splitlines()[-1])}


@dataclass(frozen=True)
class Contest:
    """What solved one problem on one grid with one thing given; `unit`: seconds of a plain product."""

    problem: str
    size: int
    control: str
    unit: float
    ours: Run
    others: list[Run]


def compare(case, entrants, field, folder):
    """Run one problem on one grid with everything that can.

    Variants that need more than twice the time of the best one of their package are taken out of `field`.
    """
    say(f"{case.name} {case.size}^2")
    unit = case.unit()
    ours = {}
    ours["approach"], case.load = run_ours(case, "approach", 3, folder)
    if case.load is None:
        return [Contest(case.name, case.size, "approach", unit, ours["approach"], [])]
    ours["load"], _ = run_ours(case, "load", 3, folder)
    problem_file = case.write()
    others = defaultdict(list)
    for name, searches in entrants.items():
        groups = defaultdict(list)
        for search in searches:
            groups[search.control].append((search, search(case, problem_file, folder)))
        for control, found in groups.items():
            best = min((run for _, run in found), key=Run.rank)
            others[control].append(best)
            for search, run in found:
                if best.accepted and not (run.accepted and run.seconds <= 2 * best.seconds):
                    field[name].remove(search)
        unit = min(unit, case.unit())
    return [
        Contest(case.name, case.size, control, unit, ours[control], found)
        for control, found in others.items()
    ]


def row(contest, run):
    """A line of the table."""
    measured = run.seconds < math.inf
    note = run.failure
    if measured and not run.accepted:
        reached = {"residual": run.residual, "tension": run.tension, "error of the load": run.load_error}
        missed = [f"{what} {value:.0e}" for what, value in reached.items() if value > TARGET]
        note = f"does not reach the accuracy: {', '.join(missed)}"

    def number(value, form):
        return format(value, form) if measured and value >= 0 else ""

    return {
        "problem": contest.problem,
        "grid": f"{contest.size}^2",
        "given": run.control,
        "solver": run.solver,
        "plain": number(run.seconds / contest.unit, ".1f"),
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
measured in the same run (`plain` is a time in this unit). One thread each; a small problem is solved before anything
is measured; `plain` and `seconds` are the solve alone, the shortest of up to three, `set-up` (kernels and their
transforms) apart. `over ours` is the time over that of our default method on one rank, with the same thing given:
approach or load. `MiB` is the peak resident size of the whole process.

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


WINS = """\
Rows of the table above in which a package reaches the accuracy and beats us. Our set-up includes the loading of
compiled code, which the packages have loaded before; our memory includes PETSc, MPI and HDF5, theirs Python and what
they import. What they have and we have not is in the first table: friction, adhesion, plasticity, lubrication, periodic
surfaces, GPUs.
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


def page(packages, contests):
    """The whole page as Markdown."""
    machine = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.split(":")[1].strip() for line in machine if line.startswith("model name")), "")
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
        f"- {run.solver}, {c.problem} {c.size}^2 by {c.control}: {run.seconds / c.ours.seconds:.2f} of our time"
        for c in contests
        for run in c.others
        if run.accepted and (run.seconds < c.ours.seconds or not c.ours.accepted)
    ]
    return "\n".join(
        [
            "# Benchmark against the packages of PyPI\n",
            f"Made by `{command}` on {datetime.date.today()}: {cpu}, {os.cpu_count()} cores; ours with {versions}.\n",
            TEXT,
            "## Packages\n",
            markdown(table),
            "",
            "## Times\n",
            markdown(rows),
            "",
            "## Where they win\n",
            WINS,
            markdown([wins(name, contests) for name in packages]),
            "Faster than we are:\n",
            "\n".join(faster) or "- in none of the rows above",
            "",
        ]
    )


def say(text):
    """Tell the user how far we are."""
    print(f"[peers] {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
