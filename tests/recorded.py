"""Recorded solves: every patch, method, loading, hardness and layer, with counts and a digest of the pressure.

    python tests/recorded.py                        # solve, and compare with tests/recorded.csv to the last bit
    mpiexec -n 2 python tests/recorded.py           # its rows of two ranks
    python tests/recorded.py -o FILE                # write FILE instead
    python tests/recorded.py --against FILE         # compare with FILE

A change of structure leaves every row as it is. Digests depend on the processor and on the versions of numpy, PETSc and
the FFT: to compare two versions of the program, let each write a file on one machine. Run this script of the newer
version in a checkout of the older one, with ``PYTHONPATH=. python NEWER/tests/recorded.py -o FILE``. The tests
(tests/validation/test_recorded.py) compare counts with the tolerance that other processors need.

To record again after a change of the method: write both files, append the rows of two ranks to those of one.
"""

import argparse
import csv
import hashlib
import sys
import warnings
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app import (
    ContactProblem,
    ContactSolver,
    FlatPunch,
    Grid,
    Material,
    Paraboloid,
    SelfAffineSurface,
    Sphere,
)
from app.methods.progress import HalvingTest
from app.problems.random_surfaces import WavySurface

TABLE = Path(__file__).with_suffix(".csv")
STEEL = Material.isotropic(210e3, 0.3)
STIFF = Material.coated(young=(420e3, 105e3), poisson=(0.3, 0.3), thickness=0.02)
SOFT = Material.coated(young=(70e3, 210e3), poisson=(0.3, 0.3), thickness=0.05, other=(210e3, 0.3))
RUBBER = Material.layer(10.0, 0.5, 0.02)  # thin and incompressible: the method film
BONDED = Material.layer(10.0, 0.4, 0.3)


def hertz(nx, ny=None):
    """Sec. 5.1."""
    grid = Grid.from_domain(nx, ny or nx, (-10.0, 10.0, -6.0, 6.0))
    return ContactProblem(grid, Material.combined(82000.0, 0.28), Paraboloid(300.0, 163.0))


def punch(n):
    """Sec. 5.2."""
    surface = WavySurface((12, 10), 0.8, 0.1, 7, (12.0, 10.0), (-6.0, -5.0))
    grid = Grid.from_domain(n, n, (-6.0, 6.0, -5.0, 5.0))
    return ContactProblem(grid, Material.combined(80000.0, 0.28), FlatPunch(8.97), surfaces=[surface])


def rough(nx, ny=None, material=STEEL, **how):
    """Self-affine surface on 1 mm."""
    grid = Grid.from_domain(nx, ny or nx, (0.0, 1.0, 0.0, 1.0))
    surface = SelfAffineSurface(0.8, 0.25, 1 / 16, (1.0, 1.0), 3, rms_slope=0.1)
    return ContactProblem(grid, material, surfaces=[surface], **how)


def ball(n, material=STEEL, radius=10.0, **how):
    """Sphere on 1 mm."""
    return ContactProblem(Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5)), material, Sphere(radius), **how)


def holes(n):
    """Sphere with cells where contact is impossible."""
    grid = Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5))
    shape = (grid.x() ** 2 + grid.y()[:, None] ** 2) / 20
    shape[::7, ::5] = np.nan
    return ContactProblem(grid, STEEL, shape)


class Case(NamedTuple):
    """A recorded solve: the problem, the loading, the method and its options."""

    problem: ContactProblem
    loading: dict
    method: str | None = None
    options: dict = {}  # noqa: RUF012
    forced: bool = False  # the safeguard takes over after the first iteration of each grid
    again: dict = {}  # noqa: RUF012  # loading of a second solve that starts from the first


def patches():
    """Return the default method's cases by kind of patch, body and loading."""
    hard = {"hardness": 8e3}
    return {
        "hertz by approach": Case(hertz(64), {"approach": 0.1091}),
        "hertz by load": Case(hertz(97, 65), {"load": 82e3}),
        "ball, single cells": Case(ball(64), {"load": 0.5}),
        "ball in a window": Case(ball(256), {"load": 20.0}),
        "ball, box product": Case(ball(640, radius=100.0), {"load": 2000.0}),
        "ball with holes": Case(holes(96), {"load": 100.0}),
        "punch, case 1": Case(punch(128), {"approach": 0.01}),
        "punch, case 3": Case(punch(128), {"approach": 0.25}),
        "rough, 1%": Case(rough(128), {"mean_pressure": 50.0}),
        "rough, 20%": Case(rough(128), {"mean_pressure": 1e3}),
        "rough, 90%": Case(rough(96, 80), {"load": 1e4}),
        "rough by approach": Case(rough(128), {"approach": 0.01}),
        "rough, double precision": Case(rough(64), {"load": 300.0}, "fast", {"lcp_precision": "double"}),
        "rough, second solve": Case(rough(64), {"load": 300.0}, again={"load": 500.0}),
        "rough, hardness": Case(rough(128, **hard), {"load": 1e3}),
        "rough, hardness, approach": Case(rough(64, **hard), {"approach": 0.01}),
        "ball, hardness": Case(ball(64, hardness=2e3), {"load": 300.0}),
        "stiff coating": Case(rough(64, material=STIFF), {"load": 300.0}),
        "stiff coating, approach": Case(ball(64, STIFF), {"approach": 0.003}),
        "soft coating": Case(rough(64, material=SOFT), {"load": 300.0}),
        "soft coating, hardness": Case(rough(64, material=SOFT, hardness=6e3), {"load": 500.0}),
        "layer on a rigid base": Case(ball(64, BONDED), {"load": 0.05}),
        "film": Case(ball(64, RUBBER), {"load": 0.05}),
        "film by approach": Case(ball(64, RUBBER), {"approach": 0.002}),
        "film, periodic": Case(rough(64, material=RUBBER, periodic=True), {"mean_pressure": 0.5}),
        "along x": Case(rough(64, periodic="x"), {"load": 300.0}),
        "along y": Case(rough(64, periodic="y"), {"load": 300.0}),
        "along y by approach": Case(rough(64, 48, periodic="y"), {"approach": 0.01}),
        "along x, hardness": Case(rough(64, periodic="x", **hard), {"load": 500.0}),
        "along y, soft coating": Case(rough(64, material=SOFT, periodic="y"), {"load": 300.0}),
        "periodic, 1%": Case(rough(128, periodic=True), {"mean_pressure": 50.0}),
        "periodic, 20%": Case(rough(128, periodic=True), {"load": 1e3}),
        "periodic, 90%": Case(rough(97, 81, periodic=True), {"load": 1e4}),
        "periodic, full contact": Case(rough(64, periodic=True), {"mean_pressure": 5e4}),
        "periodic by mean gap": Case(rough(64, periodic=True), {"mean_gap": 0.004}),
        "periodic by approach": Case(rough(64, periodic=True), {"approach": -0.004}),
        "periodic, love": Case(rough(64, periodic="love"), {"load": 300.0}),
        "periodic, second solve": Case(
            rough(64, periodic=True), {"load": 300.0}, again={"load": 500.0}
        ),
        "periodic, hardness": Case(rough(128, periodic=True, **hard), {"load": 1e3}),
        "periodic, hardness, approach": Case(rough(64, periodic=True, **hard), {"approach": -0.002}),
        "periodic, hardness, mean gap": Case(rough(64, periodic=True, **hard), {"mean_gap": 0.003}),
        "periodic, stiff coating": Case(rough(64, material=STIFF, periodic=True), {"load": 300.0}),
        "periodic, soft coating": Case(rough(64, material=SOFT, periodic=True), {"mean_gap": 0.004}),
        "periodic, layer": Case(rough(64, material=BONDED, periodic=True), {"mean_pressure": 0.05}),
    }  # fmt: skip


def cases():
    """Return all cases by name."""
    table = patches()
    papers = "norm", "mg_v11", "mg_v10", "mg_v01", "fmg_v11", "fmg_v10", "fmg_v01", "fmg_fft", "fmg_lift"
    table |= {f"{name}, hertz": Case(hertz(64), {"approach": 0.1091}, name) for name in papers}
    table |= {
        "fmg_v11, punch by load": Case(punch(64), {"load": 2e4}, "fmg_v11"),
        "fmg_v11, hardness": Case(ball(64, hardness=2e3), {"load": 300.0}, "fmg_v11"),
        "fmg_v11, coating": Case(ball(64, SOFT), {"approach": 0.003}, "fmg_v11"),
        "fmg_v11, along x": Case(rough(64, periodic="x"), {"approach": 0.01}, "fmg_v11"),
        "fmg_v11, periodic": Case(rough(64, periodic=True), {"mean_gap": 0.004}, "fmg_v11"),
        "norm, rough": Case(rough(64), {"approach": 0.01}, "norm"),
        "norm, periodic by load": Case(rough(64, periodic=True), {"load": 300.0}, "norm"),
        "snesvi": Case(hertz(32), {"approach": 0.1091}, None, {"lcp_type": "snesvi"}),
    }
    forced = (
        "hertz by load", "rough, 20%", "rough by approach", "rough, hardness", "stiff coating", "along x",
        "along y by approach", "film", "film by approach", "film, periodic", "periodic, 20%", "periodic by mean gap",
        "periodic by approach", "periodic, hardness", "periodic, hardness, approach", "periodic, soft coating",
    )  # fmt: skip
    return table | {f"safeguard: {name}": table[name]._replace(forced=True) for name in forced}


@contextmanager
def forced_safeguard():
    """Let each test of progress fail, so that the safeguard continues after the first iteration of a grid."""
    stagnates = HalvingTest.stagnates
    HalvingTest.stagnates = property(lambda _: True)
    try:
        yield
    finally:
        HalvingTest.stagnates = stagnates


class Row(NamedTuple):
    """Line of the table."""

    name: str
    ranks: int
    converged: int
    iterations: int
    inner_iterations: int
    operator_applications: str
    fallbacks: int
    load: str  # [N]
    approach: str  # [mm]
    digest: str  # of the pressure of all ranks


def solve(name, case, comm):
    """Solve a case; return its Row on all ranks. Collective over `comm`."""
    with warnings.catch_warnings(), forced_safeguard() if case.forced else nullcontext():
        warnings.simplefilter("ignore")
        with ContactSolver(case.problem, case.method, case.options, comm) as solver:
            solution = solver.solve(**case.loading)
            if case.again:
                solution = solver.solve(**case.again, start=solution)
            pressure = np.vstack(comm.allgather(solution.pressure))
    digest = hashlib.sha256(pressure.tobytes()).hexdigest()[:12]
    counts = int(solution.converged), solution.iterations, solution.inner_iterations
    applications = f"{solution.operator_applications:.6g}"
    numbers = f"{solution.load:.9g}", f"{solution.approach:.9g}"
    return Row(name, comm.size, *counts, applications, solution.fallbacks, *numbers, digest)


def read(file=TABLE):
    """Return the rows of a table by name and ranks."""
    with Path(file).open(newline="", encoding="utf8") as lines:
        types = Row.__annotations__.values()
        rows = [
            Row(*(t(text) for t, text in zip(types, row, strict=True))) for row in list(csv.reader(lines))[1:]
        ]
    return {(row.name, row.ranks): row for row in rows}


def main():
    """Write a table, or compare with one."""
    from mpi4py import MPI

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", metavar="FILE", help="write the rows, and compare nothing")
    parser.add_argument("--against", metavar="FILE", default=TABLE, help="table to compare with")
    parser.add_argument("--only", default="", help="part of the names of the cases to solve")
    arguments, comm = parser.parse_args(), MPI.COMM_WORLD
    rows = [solve(name, case, comm) for name, case in cases().items() if arguments.only in name]
    if comm.rank:
        return 0
    if arguments.o:
        with Path(arguments.o).open("w", newline="", encoding="utf8") as file:
            csv.writer(file, lineterminator="\n").writerows([Row._fields, *rows])
        return 0
    recorded, differ = read(arguments.against), 0
    for row in rows:
        before = recorded.get((row.name, row.ranks))
        if row != before:
            differ += 1
            print("was", *(before or ["nothing"]), sep="  ")
            print("is ", *row, sep="  ")
    print(f"{len(rows) - differ} of {len(rows)} equal")
    return differ > 0


if __name__ == "__main__":
    sys.exit(main())
