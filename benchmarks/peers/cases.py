"""Problems in files that our solver and the adapters read, and the judge of all answers."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app.halfspace.grid import Grid
from app.options import TABLE
from app.solve import make_problem
from benchmarks.bench import PROBLEMS, ROOT, self_affine
from benchmarks.plain import PlainProduct, check, seconds


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
