"""Problems solved in this process."""

import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from unittest import mock

import numpy as np
import petsc4py

petsc4py.init([])  # the arguments of pytest are not PETSc's
from mpi4py import MPI  # noqa: E402

from app import ContactSolver  # noqa: E402
from app.contact.history import Outcome  # noqa: E402
from app.problems.problem import Problem  # noqa: E402


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
    """Solve a problem in this process, with a method of petsc_options and more options.

    Collective over all ranks. A given `load` takes the place of the approach.
    """
    loading = {"approach": approach} if load is None else {"load": load}
    with ContactSolver(problem, method, options, MPI.COMM_WORLD) as solver, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # not converged
        found = solver.solve(**loading)
    return Solution(
        pressure=found.pressure,
        contact=found.contact,
        u=found.displacement,
        h=found.undeformed_distance,
        load=found.load,
        outcome=Outcome(
            found.converged, found.message, found.iterations, found.inner_iterations, found.residual,
            found.discretisation_error, found.fallbacks,
        ),
        history=found.history,
        approach=found.approach,
        applications=found.operator_applications,
        certificate=found.certificate,
    )  # fmt: skip


@contextmanager
def alone():
    """Inside the block a rank solves by itself."""
    with mock.patch.object(MPI, "COMM_WORLD", MPI.COMM_SELF):
        yield


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
