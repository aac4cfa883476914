"""Solvers by any method, and comparisons of their solutions."""

from dataclasses import replace

import numpy as np
import pytest
from cases import hertz, punch
from mpi4py import MPI

from app import ContactProblem, ContactSolver

METHODS = {
    "fast": (None, {}),
    "norm": ("norm", {}),
    "mg": ("mg_v11", {}),
    "fmg": ("fmg_v11", {}),
    "snesvi": (None, {"lcp_type": "snesvi"}),
    "primal": (None, {}),
}
each_method = pytest.mark.parametrize("method", METHODS)


def problem_of(method, problem=None):
    """Return a problem, by default a punch, on a patch that suits the method."""
    problem = problem or punch(24)
    return problem.on(replace(problem.grid, periodic="spectral")) if method == "primal" else problem


def solver_of(method, problem=None, **options):
    name, own = METHODS[method]
    return ContactSolver(problem_of(method, problem), name, own | options)


def assert_same(found, expected, rounding=0.0):
    """Compare solutions bit by bit, or up to a relative rounding error."""
    assert (found.load, found.approach) == pytest.approx(
        (expected.load, expected.approach), rel=rounding, abs=0
    )
    assert found.iterations == expected.iterations
    for name in ("pressure", "displacement", "undeformed_distance", "contact"):
        field = getattr(expected, name)
        atol = rounding * np.nanmax(field)
        np.testing.assert_allclose(getattr(found, name), field, rtol=0, atol=atol)


def communicators():
    """Return the largest number of 20 new communicators, which get the smallest free ones."""
    comms = [MPI.COMM_SELF.Dup() for _ in range(20)]
    number = max(comm.py2f() for comm in comms)
    for comm in comms:
        comm.Free()
    return number


def punch_on(grid):
    return ContactProblem(grid, hertz(8).material, lambda x, y: np.where(x**2 + y**2 < 9, 0 * x * y, np.nan))
