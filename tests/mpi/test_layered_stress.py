"""Stress below a coated contact that one, two and three ranks solved."""

import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, Grid, Material, Sphere, solve, stress


@pytest.mark.mpi(1, 2, 3)
def test_stresses_do_not_depend_on_the_number_of_ranks(comm):
    for periodic in (False, "y", True):
        compare_ranks(comm, periodic)


def compare_ranks(comm, periodic):
    grid = Grid.from_domain(24, 20, (-1, 1, -1, 1))
    material = Material.coated((300.0, 100.0), (0.3, 0.2), 0.15)
    problem = ContactProblem(grid, material, Sphere(10), periodic=periodic)
    options = {"lcp_rtol": 1e-9, "lcp_precision": "double"}
    here, alone = (solve(problem, load=5.0, options=options, comm=ranks) for ranks in (comm, MPI.COMM_SELF))
    whole = here.gather()
    if comm.rank == 0:
        for side in ("coating", "substrate"):
            one, other = (stress(solution).plane(0.15, side) for solution in (whole, alone))
            np.testing.assert_allclose(one, other, atol=1e-6 * alone.max_pressure)
