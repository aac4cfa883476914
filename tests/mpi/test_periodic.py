"""Periodic patches on several ranks against one."""

from fractions import Fraction

import numpy as np
import periodic
import pytest
from mpi4py import MPI
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material

CIRCULANT = {
    "pc_type": "python",
    "pc_python_type": "app.methods.free.circulant.Circulant",
    "pc_circulant_extend": 3,
}


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize(
    ("method", "options"),
    [("norm", CIRCULANT), ("fmg_v11", {}), ("fmg_lift", {}), (None, {"lcp_type": "snesvi"})],
    ids=["norm", "fmg", "lift", "snesvi"],
)
def test_any_number_of_ranks_finds_the_same(comm, method, options):
    assert_same_as_alone(comm, method, options)


@pytest.mark.mpi(2, 3)
def test_the_mean_distance_is_not_rounded_on_any_number_of_ranks(comm):
    gap = 10.0 ** np.random.default_rng(1).uniform(-9, 9, (13, 8))
    gap[0, 0] = 0.0
    material = Material.from_contact_modulus(1.0)
    problem = ContactProblem(Grid(8, 13, 0.1, 0.1), material, gap, periodic=True)
    with ContactSolver(problem, comm=comm) as solver:
        found = solver._distances[-1].statistics
    exact = sum(map(Fraction, gap.ravel().tolist())) / gap.size
    assert abs(Fraction(found.mean) + Fraction(found.mean_rest) - exact) <= 1e-29 * exact


@pytest.mark.mpi(2, 3)
def test_odd_numbers_of_cells(comm):
    assert_same_as_alone(comm, "fmg_v11", {}, (23, 19))


@pytest.mark.mpi(5)  # a slab of as many rows as a coarse cell, or none
def test_so_do_more_ranks_than_coarse_rows(comm):
    assert_same_as_alone(comm, "fmg_v11", {"lcp_cells_per_rank": 1})


def assert_same_as_alone(comm, method, options, cells=(24, 20)):
    """By approach, and by loads below and at full contact."""
    problem = periodic.rough(*cells, 1)
    options = {"lcp_rtol": 1e-9, "lcp_cells_per_rank": 8} | options
    least = solve(problem, problem.gap.mean(), method, comm=MPI.COMM_SELF, **options).load
    loadings = [(0.8 * problem.gap.mean(), None)]
    loadings += [(None, share * least) for share in (0.4, 1.5)] if method else []
    for approach, load in loadings:
        alone = solve(problem, approach, method, load, MPI.COMM_SELF, **options)
        here = solve(problem, approach, method, load, comm, **options)
        assert here.converged and alone.converged
        found = np.vstack(comm.allgather(here.pressure))
        np.testing.assert_allclose(found, alone.pressure, rtol=0, atol=1e-6 * alone.max_pressure)
        assert here.approach == pytest.approx(alone.approach, rel=1e-8)
        assert here.error_bound == pytest.approx(alone.error_bound, rel=0.1, abs=1e-6)
