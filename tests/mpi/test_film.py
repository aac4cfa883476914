"""Default method for thin, nearly incompressible layers on several ranks against one."""

import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, Grid, Material, solve
from app.problems.random_surfaces import SelfAffineSurface

OPTIONS = {"lcp_cells_per_rank": 300}


@pytest.mark.mpi(2, 3)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("periodic", [True, False, "y"])
@pytest.mark.parametrize("loading", [{"mean_pressure": 0.3}, {"approach": -0.1}])
def test_film_on_ranks_is_that_on_one(comm, periodic, loading):
    grid = Grid.from_domain(64, 63, (0, 64, 0, 63), periodic=periodic)
    surface = SelfAffineSurface(0.8, 16, 8, (64, 64), 1, rms_slope=0.1)
    problem = ContactProblem(grid, Material.layer(1.0, 0.5, 1.0), surfaces=[surface])
    many, one = (solve(problem, options=OPTIONS, comm=c, **loading) for c in (comm, MPI.COMM_SELF))
    assert many.iterations == one.iterations
    assert many.operator_applications == pytest.approx(one.operator_applications, rel=1e-12)
    rows = many.slabs.rows
    assert np.array_equal(many.contact, one.contact[rows])
    assert many.pressure == pytest.approx(one.pressure[rows], rel=1e-8, abs=1e-9 * one.max_pressure)
