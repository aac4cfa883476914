"""Patches periodic in one direction on several ranks against one."""

import numpy as np
import pytest
from mpi4py import MPI
from running import solve

from app import ContactProblem, Grid, Material
from app.verification.solving import UNIT

TIGHT = {"lcp_rtol": 1e-9, "lcp_cells_per_rank": 64}


COATED = {  # by the shapes of their grids
    (33, 35): Material.coated((1.0, 5.0), (0.3, 0.3), 2.0),
    (32, 40): Material.coated((5.0, 1.0), (0.3, 0.3), 0.5),
}


def rough(ny, nx, periodic, material=UNIT):
    x, y = 2 * np.pi * np.arange(nx) / nx, 2 * np.pi * np.arange(ny)[:, None] / ny
    gap = 2 + np.cos(x - 1) + 0.3 * np.cos(3 * y + x) + 0.1 * np.cos(5 * x + 4 * y)
    return ContactProblem(Grid(nx, ny, 0.1, 0.13, periodic=periodic), material, 0.2 * gap)


@pytest.mark.mpi(2, 3, 5)
@pytest.mark.parametrize("periodic", ["x", "y"])
@pytest.mark.parametrize(
    ("method", "shape"),
    [*(("fast", shape) for shape in [(140, 130), *COATED]), ("fmg_v11", (35, 32)), ("norm", (4, 9))],
)
def test_all_ranks_together_find_the_solution_of_one(comm, method, shape, periodic):
    problem = rough(*shape, periodic, COATED.get(shape, UNIT))
    alone = solve(problem, None, method, load=0.005 * problem.grid.area, comm=MPI.COMM_SELF, **TIGHT)
    together = solve(problem, None, method, load=0.005 * problem.grid.area, comm=comm, **TIGHT)
    assert alone.converged and together.converged
    assert alone.fallbacks == together.fallbacks == 0
    pressure = np.vstack(comm.allgather(together.pressure))
    np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=1e-6 * alone.max_pressure)
    extents = "contact_extent_x", "contact_extent_y"
    for name in ("approach", "perimeter", "rms_slope", "pressure_centre_x", "pressure_centre_y", *extents):
        assert getattr(together, name) == pytest.approx(getattr(alone, name), rel=1e-6, nan_ok=True)
    assert together.contact_patches() == pytest.approx(alone.contact_patches())


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("periodic", ["x", "y"])
def test_counts_do_not_depend_on_ranks(comm, periodic):
    problem = rough(136, 130, periodic)
    alone, together = (
        solve(problem, None, "fast", load=0.005 * problem.grid.area, comm=ranks, lcp_cells_per_rank=64)
        for ranks in (MPI.COMM_SELF, comm)
    )
    assert together.iterations == alone.iterations
    assert together.operator_applications == pytest.approx(alone.operator_applications)
    assert 0.1 < alone.contact_fraction < 0.9
