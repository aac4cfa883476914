"""Problems in files for the adapters, and the test of their answers."""

import math
from dataclasses import replace
from functools import cached_property, partial
from time import process_time

import numpy as np
from mpi4py import MPI

from app import ContactProblem, ContactSolver
from app.cli.geometry import make_problem
from app.cli.problem_options import PROBLEM_OPTIONS
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.options.option_table import OptionReader
from app.options.solver_options import read_option_file
from benchmarks import periodic
from benchmarks.bench import PROBLEMS, self_affine
from benchmarks.measure import ROOT
from benchmarks.peers.runs import CONTACT_TARGET, TARGET
from benchmarks.plain import PlainPeriodicProduct, PlainProduct, check, check_periodic, seconds


def described(words):
    """Problem and approach that a command line of app.solve describes."""
    texts = {}
    for name, text in zip(words[::2], words[1::2], strict=True):
        texts |= read_option_file(ROOT / text) if name == "-options_file" else {name.removeprefix("-"): text}
    options = OptionReader(PROBLEM_OPTIONS, texts)
    problem, _ = make_problem(options, texts, MPI.COMM_SELF)
    return problem, options["approach"]


class Files:
    """Base of all cases: gap, grid, material, approach, load, hardness, and their file."""

    hardness = thickness = math.inf
    dilute = False

    def known(self, control):
        """Return whether the value of "approach" or "load" is known."""
        return not math.isnan(getattr(self, control))

    @property
    def file(self):
        """Name of the file for the adapters."""
        return self.stem.with_suffix(".npz")

    def write(self):
        """Write that file, with what is known of load and approach."""
        np.savez(
            self.file,
            gap=self.gap,
            dx=self.grid.dx,
            dy=self.grid.dy,
            approach=self.approach,
            load=self.load,
            hardness=self.hardness,
            thickness=self.thickness,
            dilute=self.dilute,
            contact_modulus=self.material.contact_modulus,
            shear_modulus=self.material.shear_modulus,
            poisson_ratio=self.material.poisson_ratio,
        )
        return self.file


class Case(Files):
    """A problem on a grid, in a file that the adapters read.

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
        words = PROBLEMS[name] or self_affine(size, folder)
        problem, self.approach = described([*words, "-grid", str(size)])
        grid = problem.grid
        self.is_square = math.isclose(grid.dx, grid.dy)
        if square and not self.is_square:
            half = max(grid.x0 + size * grid.dx, grid.y0 + size * grid.dy)
            problem = replace(problem, grid=Grid.from_domain(size, size, (-half, half, -half, half)))
        self.name = f"{name}, square patch" if square and not self.is_square else name
        self.problem, self.grid, self.material = problem, problem.grid, problem.material
        self.gap = problem.shape_on(self.grid)
        self.load = math.nan
        self.stem = folder / f"{self.name.replace(', ', '-').replace(' ', '-')}-{size}"

    controls = "approach", "load"  # the second follows from our answer to the first

    def learn(self, pressure):
        """Know the load by our answer to the approach."""
        self.load = float(pressure.sum() * self.grid.cell_area)

    @cached_property
    def product(self):
        """The plain product, which is the unit and the judge."""
        return PlainProduct(self.grid, self.material.kernel)

    def unit(self):
        """Processor time of a plain product now [s]."""
        pressure = np.where(self.gap < self.approach, 1.0, 0.0)
        return seconds(partial(self.product, pressure), clock=process_time)

    def judge(self, pressure, control):
        """Accuracy of a pressure by one plain product; see `Run`.

        A prescribed load says nothing of the approach: it is the one that fits the cells under pressure best.
        """
        approach = self.approach
        clean = np.isfinite(pressure).all() and (pressure > 0).any()
        if not clean:
            return dict.fromkeys(("residual", "penetration", "tension", "load_error", "miss"), math.inf)
        gap = self.gap + self.product(pressure)
        if control == "load":
            approach = float(np.mean(gap[pressure > 0]))
        h = self.gap - approach
        found = check(self.product, pressure, h)
        admissible, gap = ~np.isnan(h), gap - approach
        defect = np.where(pressure > 0, gap, np.minimum(gap, 0.0))[admissible]
        load = float(pressure.sum() * self.grid.cell_area)
        measures = {
            "residual": float(np.linalg.norm(defect) / np.linalg.norm(h[admissible]))
            if found["outside"]
            else math.inf,
            "tension": found["tension"] + 0.0,
            "load_error": abs(load / self.load - 1) if control == "load" else 0.0,
        }
        touching = pressure > 0
        return measures | {
            "penetration": found["penetration"],
            "contact_residual": float(np.linalg.norm(gap[touching]) / np.linalg.norm(h[touching])),
            "miss": max(measures.values()) / TARGET,
        }


class DiluteCase(Case):
    """A self-affine surface under a small load: few cells touch.

    Parameters
    ----------
    name : str
        Of `DILUTE_PROBLEMS`.
    size : int
    folder : Path
    """

    controls = ("load",)
    dilute = is_square = True

    def __init__(self, name, size, folder):
        self.name, self.size = name, size
        self.load, _ = DILUTE_PROBLEMS[name]
        self.approach = math.nan
        self.grid = Grid.from_domain(size, size, (0, 1, 0, 1))
        self.material = Material.combined(0.7, 0.3)  # E* is 1 N/mm2
        self.gap = dilute_gap(size)
        self.stem = folder / f"dilute-{list(DILUTE_PROBLEMS).index(name)}-{size}"

    def learn(self, pressure):
        """Nothing: the load is prescribed."""

    def unit(self):
        """Not measured: the page has CPU seconds."""
        return math.nan

    def judge(self, pressure, control):
        """Accuracy, number of contact cells, and largest pressure.

        The gap under pressure must also be small compared with h there, because ||h|| is large.
        """
        found = super().judge(pressure, control)
        found["miss"] = max(found["miss"], found.get("contact_residual", math.inf) / CONTACT_TARGET)
        return found | {
            "contact_cells": int(np.count_nonzero(pressure > 0)),
            "max_pressure": float(pressure.max()),
        }


def dilute_gap(size):
    """Return the gap between a plane and a surface with waves of 12 to 0.165 `size` periods [mm]."""
    ky, kx = np.fft.fftfreq(size, 1 / size), np.fft.rfftfreq(size, 1 / size)
    q = np.hypot(ky[:, None], kx)
    amplitude = np.zeros_like(q)
    has_wave = (q >= 12) & (q <= 0.165 * size)
    amplitude[has_wave] = q[has_wave] ** -1.8
    phase = 2j * np.pi * np.random.default_rng(1811).random(q.shape)
    height = np.fft.irfft2(amplitude * np.exp(phase), s=(size, size))
    height *= 0.005 / height.std()
    return height.max() - height


class PeriodicCase(Files):
    """A surface of `benchmarks.periodic` under a given mean pressure.

    Parameters
    ----------
    name : str
        Of `PERIODIC_PROBLEMS`.
    size : int
    folder : Path
    """

    controls = "load", "approach"
    is_square = True

    def __init__(self, name, size, folder):
        self.name, self.size, self.material = name, size, periodic.MATERIAL
        self.grid, self.gap = periodic.surface_grid(size), periodic.distance(size)
        self.load = periodic.mean_pressure(PERIODIC_PROBLEMS[name]) * periodic.SIDE**2
        self.approach = math.nan
        self.stem = folder / f"{name.replace(' ', '-').replace('.', '_')}-{size}"
        self.product = PlainPeriodicProduct(self.grid, self.material.contact_modulus)

    def rename(self, name, kind, problems):
        """Take a name of `problems`; files are called by the kind and the place of the name."""
        self.name = name
        self.stem = self.stem.with_name(f"{kind}-{list(problems).index(name)}-{self.size}")

    def learn(self, pressure):
        """Know the approach by our answer to the load."""
        self.approach = float(np.mean((self.gap + self.product(pressure))[pressure > 0]))

    def unit(self):
        """Processor time of a plain product now [s]."""
        return seconds(partial(self.product, self.gap), clock=process_time)

    def judge(self, pressure, control):
        """Accuracy of a pressure by one plain product; see `Run` and `check_periodic`."""
        if not (np.isfinite(pressure).all() and (pressure > 0).any()):
            return dict.fromkeys(("residual", "penetration", "tension", "load_error", "miss"), math.inf)
        found = check_periodic(self.product, pressure, self.gap, self.load / periodic.SIDE**2, self.hardness)
        found["tension"] += 0.0
        asked = [found["residual"], found["penetration"] / 10, found["tension"]]
        if control == "load":
            asked.append(found["load_error"])
        return found | {"miss": max(asked) / TARGET}


class HardnessCase(PeriodicCase):
    """A periodic case with a hardness.

    Parameters
    ----------
    name : str
        Of `HARDNESS_PROBLEMS`.
    size : int
    folder : Path
    """

    controls = ("load",)

    def __init__(self, name, size, folder):
        load, share = HARDNESS_PROBLEMS[name]
        super().__init__(load, size, folder)
        self.rename(name, "hardness", HARDNESS_PROBLEMS)
        if "mean pressure" in name:
            self.hardness = self.load / periodic.SIDE**2 / share
        else:
            grid = replace(self.grid, periodic=True)
            with ContactSolver(ContactProblem(grid, self.material, self.gap)) as solver:
                self.hardness = share * float(solver.solve(load=self.load).pressure.max())


class LayerCase(PeriodicCase):
    """A periodic case of a layer on a rigid base.

    Parameters
    ----------
    name : str
        Of `LAYER_PROBLEMS`.
    size : int
    folder : Path
    """

    controls = ("load",)

    def __init__(self, name, size, folder):
        load, cells, poisson = LAYER_PROBLEMS[name]
        super().__init__(load, size, folder)
        self.rename(name, "layer", LAYER_PROBLEMS)
        self.thickness = cells * periodic.SIDE / size
        young = self.material.contact_modulus * (1 - poisson**2)
        self.material = Material.pair((young, math.inf), (poisson, 0.0))
        self.product = PlainPeriodicProduct(self.grid, self.material.contact_modulus, self.thickness, poisson)


PERIODIC_PROBLEMS = {f"load {load:g}": load for load in periodic.LOADS}
# Loads and hardnesses: H over the largest pressure without a hardness, or mean pressure over H.
HARDNESS_PROBLEMS = {
    f"{load} H {share:g}": (load, share) for load in ("load 0.05", "load 0.3") for share in (0.9, 0.5, 0.2)
} | {
    "load 0.3 mean pressure H": ("load 0.3", 1.0),
    "load 0.3 mean pressure (1 - 1e-9) H": ("load 0.3", 1 - 1e-9),
}
# Loads, thicknesses in cells, and Poisson's ratios of layers.
LAYER_PROBLEMS = {
    f"load {load:g} t {cells} nu {poisson:g}": (f"load {load:g}", cells, poisson)
    for load in (0.05, 0.3)
    for cells, poisson in ((1, 0.3), (1, 0.49), (10, 0.3), (100, 0.3))
}
# Loads [N] and the largest grid on which each is solved. The dense ones take ASPHER minutes on finer grids.
DILUTE_PROBLEMS = {
    "1.5e-5 N": (1.5e-5, 4096),
    "1.5e-4 N": (1.5e-4, 4096),
    "1.5e-3 N": (1.5e-3, 4096),
    "0.017 N": (0.017, 2048),
    "0.06 N": (0.06, 1024),
}


def warm_up_periodic(folder):
    """Write a small periodic problem, to be solved before anything is measured."""
    case = PeriodicCase("load 0.05", 128, folder)
    case.approach = float(case.gap.mean() / 2)
    return case.write()


def warm_up_hardness(folder):
    """Write a small periodic problem with a hardness, to be solved before anything is measured."""
    return HardnessCase("load 0.05 H 0.5", 64, folder).write()


def warm_up_layer(folder):
    """Write a small periodic problem with a layer, to be solved before anything is measured."""
    return LayerCase(next(iter(LAYER_PROBLEMS)), 64, folder).write()


def warm_up_dilute(folder):
    """Write a small problem of few contact cells, to be solved before anything is measured."""
    return DiluteCase("1.5e-3 N", 128, folder).write()


def warm_up(folder):
    """Write a small Hertz problem, to be solved before anything is measured."""
    case = Case("hertz", 128, folder, square=True)
    case.load = case.problem.reference(case.approach).load
    return case.write()
