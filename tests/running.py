"""What several tests need: commands run from outside, problems solved in this process."""

import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import petsc4py

petsc4py.init([])  # the arguments of pytest are not PETSc's
from mpi4py import MPI  # noqa: E402
from petsc4py import PETSc  # noqa: E402

import app.solve  # noqa: E402
from app.contact.certificate import certify  # noqa: E402
from app.contact.loop import History  # noqa: E402
from app.options import Options  # noqa: E402
from app.problems.problem import Problem  # noqa: E402

TESTS = Path(__file__).resolve().parent
OPTIONS = TESTS.parent / "petsc_options"


def run(*command, ranks=None, timeout=60, env=None, cwd=None):
    """Run ``python command``, under mpiexec if `ranks` is given; return status and output as text."""
    line = [sys.executable, *map(str, command)]
    if ranks is not None:
        line = ["mpiexec", "-n", str(ranks), *line]
    process = subprocess.Popen(
        line,
        env={**os.environ, **(env or {})},  # Open MPI's own variables, if we run under it, must go along
        cwd=cwd or TESTS.parent,
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.terminate()  # lets mpiexec end its ranks
        out, err = process.communicate(timeout=20)
        raise AssertionError(f"hangs for {timeout} s: {' '.join(line)}\n{out}\n{err}") from None
    return subprocess.CompletedProcess(line, process.returncode, out, err)


def solve_arguments(*methods):
    """Arguments of python for app.solve with these option files of the project."""
    files = [argument for name in methods for argument in ("-options_file", str(OPTIONS / f"{name}.opts"))]
    return ["-m", "app.solve", *files]


@contextmanager
def petsc_options(*files, **options):
    """PETSc's options inside the block: option files of the project, then single ones."""
    database = PETSc.Options()
    for name in files:
        database.insertString(f"-options_file {OPTIONS / name}.opts")
    for name, value in options.items():
        database.setValue(name, value)
    try:
        yield database
    finally:
        for name in database.getAll():  # clear() does nothing to PETSc's own database
            database.delValue(name)


@dataclass(frozen=True)
class Sampled(Problem):
    """Any shape: an array on the target grid, or a function of x and y for all grids."""

    values: object = None

    @property
    def sampled(self):
        return not callable(self.values)

    def shape_on(self, grid, rows=slice(None)):
        if self.sampled:
            return np.array(self.values[rows], float)
        return self.values(*np.broadcast_arrays(grid.x()[None, :], grid.y(rows)[:, None]))


@dataclass(frozen=True)
class Solution:
    """Fields of this rank's rows, and how the iteration went."""

    pressure: np.ndarray
    contact: np.ndarray
    u: np.ndarray
    h: np.ndarray  # NaN in inadmissible cells
    load: float
    outcome: object
    history: dict
    approach: float
    applications: float
    certificate: object

    @property
    def gap(self):
        return self.h + self.u


def solve(problem, approach, method="norm", load=None, **options):
    """Solve a problem in this process the way app.solve does, with a method of petsc_options and more options.

    Collective over all ranks. A given `load` takes the place of the approach.
    """
    loading = {"approach": repr(approach)} if load is None else {"load": repr(load)}
    options = loading | {name: str(value) for name, value in options.items()}
    files = (method,) if method else ()
    with petsc_options(*files, **options), mock.patch.object(app.solve, "make_problem", return_value=problem):
        setup = app.solve.prepare(Options(), MPI.COMM_WORLD)
        history = History()
        state, outcome = app.solve.solve(setup, history)
    applications = setup.hierarchy.operator_applications()
    shape = np.where(state.admissible, state.shape, np.nan)
    solution = Solution(
        pressure=state.pressure.getArray(readonly=True).reshape(shape.shape).copy(),
        contact=state.contact.copy(),
        u=state.u.copy(),
        h=shape - state.approach,
        load=state.load,
        outcome=outcome,
        history=history.columns(),
        approach=state.approach,
        applications=applications,
        certificate=certify(state),
    )
    setup.free_solver()
    setup.hierarchy.destroy()
    state.destroy()
    return solution


def assert_solves_lcp(solution, tolerance=1e-6):
    """Check e >= 0, p >= 0, p e = 0, relative to the size of h."""
    p, e, contact = solution.pressure, solution.gap, solution.contact
    admissible = ~np.isnan(solution.h)
    assert solution.outcome.converged, solution.outcome
    assert (p >= 0).all()
    assert (p[~contact] == 0).all()
    assert not contact[~admissible].any()
    assert (e[admissible & ~contact] > 0).all()
    assert np.linalg.norm(e[contact]) <= tolerance * np.linalg.norm(solution.h[admissible])
