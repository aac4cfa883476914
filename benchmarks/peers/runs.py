"""Measured solves of all packages, with the loosest tolerance that is accurate enough."""

import math
import subprocess
import sys
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.packages import ADAPTERS
from benchmarks.peers.processes import capture, reason, say

OURS = "this project"
TARGET = 1e-6
CONTACT_TARGET = 1e-4  # the same on the contact cells alone, in dilute contact
TIGHTEST = 26  # tolerances are 10^(-k/2), k up to this
REPEATS = 3  # solves of a measurement


@dataclass(frozen=True)
class Run:
    """Measured solve; `miss` is the largest error over its limit."""

    solver: str
    control: str
    tolerance: float = math.nan
    seconds: float = math.inf
    first_seconds: float = math.inf
    setup_seconds: float = math.nan
    iterations: int = -1
    products: float = -1
    peak_memory: float = math.nan
    unit: float = math.nan  # seconds of a plain product in the same process, with a hardness
    residual: float = math.inf
    penetration: float = math.inf
    tension: float = math.inf
    load_error: float = math.inf
    miss: float = math.inf
    contact_residual: float = math.nan  # on free patches
    contact_cells: int = -1  # in dilute contact
    max_pressure: float = math.nan  # in dilute contact
    failure: str = ""

    @property
    def accepted(self):
        """True if the required accuracy is reached."""
        return self.miss <= 1

    def rank(self):
        """Return a sorting key: accurate runs by time, then the others by error."""
        return (0, self.seconds) if self.accepted else (1, self.miss)


class Solver:
    """Variant of a package, or of this project, on free or periodic patches.

    Parameters
    ----------
    python : str
        Interpreter of its environment.
    name : str
        Name of its adapter.
    label : str
        Name on the page.
    variant, control : str
    warmup : Path
        File of a small problem that is solved before anything is measured.
    options : argparse.Namespace
        With ``budget`` and ``limit``, see `benchmarks.peers.__main__`.
    """

    def __init__(self, python, name, label, variant, control, warmup, options):
        self.python, self.name, self.label, self.variant, self.control = python, name, label, variant, control
        self.warmup, self.options = warmup, options

    @classmethod
    def ours(cls, control, periodic, warmup, options):
        """Return our default method."""
        variant = f"{'periodic, ' * periodic}by {control}"
        return cls(sys.executable, "ours", OURS, variant, control, warmup, options)

    def run(self, case, folder, tolerance=TARGET, repeats=REPEATS):
        """Run the adapter once; it solves up to `repeats` times.

        Returns
        -------
        Run
        ndarray or None
            The pressure, unless it fails.
        """
        answer = folder / "answer.npz"
        command = [
            self.python, ADAPTERS / f"{self.name}_adapter.py", "solve", case.file, self.warmup, answer,
            self.variant, tolerance, repeats, self.options.budget,
        ]  # fmt: skip
        failure = ""
        try:
            done = capture(command, cwd=folder, timeout=self.options.limit)
            if done.returncode:
                failure = reason(done)
        except subprocess.TimeoutExpired:
            failure = f"more than {self.options.limit:g} s"
        if failure:
            say(f"  {self.label}, {tolerance:.1e}: {failure}")
            return Run(self.label, self.control, tolerance, failure=failure), None
        with np.load(answer) as data:
            pressure = data["pressure"]
            numbers = {
                name: data[name].item() for name in data.files if name not in ("pressure", "converged")
            }
        run = Run(self.label, self.control, tolerance, **numbers, **case.judge(pressure, self.control))
        say(
            f"  {self.label}, {tolerance:.1e}: {run.seconds:.3g} s, {run.iterations} iterations, "
            f"residual {run.residual:.1e}, penetration {run.penetration:.1e}, tension {run.tension:.1e}, "
            f"load {run.load_error:.1e}"
        )
        return run, pressure


class Search(Solver):
    """Search for the loosest tolerance that is accurate enough, with one solve for each tolerance."""

    def __init__(self, python, name, variant, description, warmup, options):
        super().__init__(python, name, f"{name}: {variant}", variant, description["control"], warmup, options)
        self.start = round(-2 * math.log10(description["first_tolerance"]))

    def __call__(self, case, folder, limit):
        """Return the fastest accepted run, else the most accurate one.

        End at a solve of more than `limit` seconds.
        """
        runs, k = {}, self.start
        bad, good = -1, None  # the tightest tolerance that was not enough, the loosest that was
        while bad < k <= TIGHTEST and k != good:
            run, _ = self.run(case, folder, 10 ** (-k / 2), repeats=1)
            runs[k] = run
            if run.failure or run.miss == math.inf or run.seconds > limit:
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

    def measure(self, case, folder, found):
        """Solve again with the tolerance that was found, several times; return that run."""
        if 2 * found.seconds > self.options.budget:
            return found
        run, _ = self.run(case, folder, found.tolerance)
        return found if run.failure else run
