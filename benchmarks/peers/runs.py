"""Measured solves: ours, and those of a package with the loosest tolerance that is accurate enough."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass

import numpy as np

from app.output.result import read_result
from benchmarks.measure import ROOT
from benchmarks.peers.packages import ADAPTERS
from benchmarks.peers.processes import capture, reason, say

OURS = "this project"
TARGET = 1e-6
TIGHTEST = 26  # tolerances are 10^(-k/2), k up to this


@dataclass(frozen=True)
class Run:
    """One measured solve. `miss`: the largest of what was found over what is allowed, see the case's `judge`."""

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
    miss: float = math.inf
    failure: str = ""

    @property
    def accepted(self):
        """Whether the accuracy that all are held to is reached."""
        return self.miss <= 1

    def rank(self):
        """Sorting key: what reaches the accuracy by time, then the rest by what it reached."""
        return (0, self.seconds) if self.accepted else (1, self.miss)


def run_ours(case, control, repeats, folder):
    """Our default method on one rank; the shortest of some runs, and the attributes of its result."""
    output = folder / "ours.h5"
    command = [
        "mpiexec", "-n", "1", sys.executable, "-m", "app.solve", "-problem", "file", "-gap_file", case.gap_file,
        "-domain", ",".join(map(repr, case.domain)), "-shear_modulus", case.material.shear_modulus,
        "-poisson_ratio", case.material.poisson_ratio, *case.loading(control),
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
    return run, facts


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
            if run.failure or run.miss == math.inf:
                break
            step = math.floor(2 * math.log10(run.miss)) if run.miss > 0 else 0
            if run.accepted:
                if good is not None and run.miss > 0.99 * runs[good].miss > 0.98 * run.miss:
                    break  # loosening changes nothing any more
                if run.seconds > self.options.budget:
                    break  # half a decade is not worth another such run
                good, k = k, max(k + min(step, -1), bad + 1)
            else:
                if any(j <= k - 6 and run.miss > runs[j].miss / 2 for j in runs):
                    break  # three decades gained nothing
                bad, k = k, k + max(step, 1)
                if good is not None:
                    k = min(k, good - 1)
        accepted = {j: run for j, run in runs.items() if run.accepted}
        if accepted:
            self.start, best = min(accepted.items(), key=lambda item: item[1].seconds)
            return best
        return min(runs.values(), key=lambda run: (run.miss, run.seconds))

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
            f"residual {run.residual:.1e}, penetration {run.penetration:.1e}, tension {run.tension:.1e}, "
            f"load {run.load_error:.1e}"
        )
        return run
