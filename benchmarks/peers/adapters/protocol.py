"""Messages between driver and adapter.

Runs in the environments of the packages: numpy only (with a hardness also scipy), Python 3.9 or newer.


    python X_adapter.py describe
    python X_adapter.py solve PROBLEM.npz WARMUP.npz ANSWER.npz VARIANT TOLERANCE REPEATS BUDGET

The first prints JSON: versions, variants and the features of the package. The second prepares, solves the small
problem once unmeasured, then the problem itself, up to REPEATS times while the seconds of BUDGET last, and writes the
pressure, the first and the shortest time. In dilute contact every solve has a set-up of its own, and the shortest sum
of both times counts.
"""

import json
import platform
import resource
import sys
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np


class Problem:
    """A contact problem as the driver writes it; lengths mm, forces N, stresses N/mm2.

    Attributes
    ----------
    gap : ndarray, shape (ny, nx)
        Undeformed distance at zero approach; NaN where contact is impossible.
    open_gap : ndarray, shape (ny, nx)
        The same for packages that know no such cells: there the gap stays open at the prescribed approach,
        because displacements are not negative. No larger than needed, so that it disturbs no coarser grids.
    dx, dy, contact_modulus, shear_modulus, poisson_ratio, approach, load : float
        On a periodic patch the approach is that of displacements of mean 0; NaN if nobody knows it.
    hardness : float
        Upper bound of the pressure; inf if there is none.
    thickness : float
        Thickness of a layer on a rigid base; inf: a half-space.
    dilute : bool
        True if the page reports the sum of set-up and solve.
    """

    def __init__(self, path):
        with np.load(path) as data:
            self.gap = data["gap"]
            for name in (
                "dx", "dy", "contact_modulus", "shear_modulus", "poisson_ratio", "approach", "load", "hardness",
                "thickness",
            ):  # fmt: skip
                setattr(self, name, float(data[name]))
            self.dilute = bool(data["dilute"])
        deepest = self.approach - np.nanmin(self.gap)
        self.open_gap = np.where(np.isnan(self.gap), self.approach + deepest, self.gap)
        self.ny, self.nx = self.gap.shape

    @property
    def cell_area(self):
        """Area of a cell [mm2]."""
        return self.dx * self.dy

    @property
    def young(self):
        """Young's modulus of a single elastic body [N/mm2]."""
        return self.contact_modulus * (1 - self.poisson_ratio**2)

    @property
    def mean_pressure(self):
        """Prescribed load over the area of the patch [N/mm2]."""
        return self.load / (self.gap.size * self.cell_area)

    @property
    def interpenetrating(self):
        """Cells that overlap undeformed: no other can be in contact."""
        return self.open_gap < self.approach


@dataclass(frozen=True)
class Variant:
    """Variant of a package: loading ("approach" or "load"), first tolerance, patches, hardness, layer.

    `dilute` is True if the work follows the contact; these variants are tried first in dilute contact.
    """

    control: str
    first_tolerance: float = 1e-5
    periodic: bool = False
    hardness: bool = False
    layer: bool = False
    dilute: bool = False


@dataclass
class Outcome:
    """Outcome of a solve; numbers that a package lacks are -1."""

    pressure: np.ndarray
    iterations: int = -1
    products: int = -1
    converged: bool = True
    setup_seconds: float = 0.0  # set-up that the package does inside its solve


class Counted:
    """A function that counts its calls."""

    def __init__(self, function):
        self.function, self.calls = function, 0

    def __call__(self, *arguments):
        """Call it."""
        self.calls += 1
        return self.function(*arguments)


def peak_memory():
    """Return the peak resident size in bytes of this process, or of a larger one that it ran.

    `resource` would include, for this process, its parent's before exec.
    """
    status = Path("/proc/self/status").read_text().splitlines()
    own = next(int(line.split()[1]) for line in status if line.startswith("VmHWM:"))
    return 1024 * max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def unit_seconds(problem):
    """Return the CPU time of a plain periodic product [s], the shortest of ten."""
    from scipy import fft

    symbol, times = np.ones((problem.ny, problem.nx // 2 + 1)), []
    for _ in range(10):
        started = time.process_time()
        fft.irfft2(fft.rfft2(problem.gap) * symbol, s=problem.gap.shape)
        times.append(time.process_time() - started)
    return min(times)


def serve(distributions, variants, prepare, square=False, programs=(), clock=time.process_time):
    """Do what the command line asks for.

    Parameters
    ----------
    distributions : sequence of str
        Installed distributions whose versions matter.
    variants : dict of str to Variant
    prepare : callable
        ``prepare(problem, variant_name)`` sets up and returns ``solve(tolerance) -> Outcome``.
    square : bool
        Whether the package takes square patches of square cells only.
    programs : sequence of (str, callable)
        Names of programs that are no distributions, and functions that return their versions.
    clock : callable
        Return the time by which solves are measured [s].
    """
    if sys.argv[1] == "describe":
        versions = {name: find_version() for name, find_version in programs}
        versions |= {name: version(name) for name in distributions}
        versions["Python"] = platform.python_version()
        ways = {name: asdict(variant) for name, variant in variants.items()}
        print(json.dumps({"versions": versions, "variants": ways, "square": square}))
        return
    problem, warmup, answer, variant, tolerance, repeats, budget = sys.argv[2:]
    tolerance, budget = float(tolerance), float(budget)
    prepare(Problem(warmup), variant)(tolerance)
    problem = Problem(problem)
    has_unit = min(problem.hardness, problem.thickness) < np.inf
    unit = unit_seconds(problem) if has_unit else np.nan
    times, setups, spent = [], [], 0.0
    for _ in range(int(repeats)):
        if problem.dilute or not times:
            started = clock()
            solve = prepare(problem, variant)
            setup = clock() - started
        started = clock()
        outcome = solve(tolerance)
        elapsed = clock() - started
        times.append(elapsed - outcome.setup_seconds)
        setups.append(setup + outcome.setup_seconds)
        spent += elapsed
        if spent + elapsed > budget:
            break
    quickest = int(np.argmin(np.add(times, setups) if problem.dilute else times))
    np.savez(
        answer,
        pressure=np.asarray(outcome.pressure, dtype=float),
        seconds=times[quickest] + problem.dilute * setups[quickest],
        first_seconds=times[0],
        setup_seconds=setups[quickest],
        iterations=outcome.iterations,
        products=outcome.products,
        converged=outcome.converged,
        peak_memory=peak_memory(),
        unit=min(unit, unit_seconds(problem)) if has_unit else np.nan,
    )
