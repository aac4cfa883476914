"""Bodies that tilt, on several ranks."""

import warnings

import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

STEEL = Material.isotropic(210e3, 0.3)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("n", [48, 96])
def test_tilted_bodies_are_independent_of_ranks(comm, n):
    grid = Grid.from_domain(n, n - 1, (-1, 1, -0.8, 0.8))
    surface = SelfAffineSurface(0.8, 0.5, 0.1, (2.0, 1.6), 2, rms_slope=0.02)
    body = ContactProblem(grid, STEEL, lambda x, y: (x**2 + y**2 / 2) / 20, surfaces=[surface])
    options = {"lcp_cells_per_rank": 64}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            ContactSolver(body, options=options, comm=comm) as several,
            ContactSolver(body, options=options, comm=MPI.COMM_SELF) as alone,
        ):
            for loading in (
                {"load": 300.0, "load_centre": (0.2, -0.1)},
                {"load": 3.0, "load_centre": (0.0, 0.1)},
                {"load": 300.0, "tilt": (0.01, -0.005)},
            ):
                shared, single = several.solve(**loading), alone.solve(**loading)
                assert shared.converged and single.converged
                assert (shared.contact_cells, shared.iterations) == (single.contact_cells, single.iterations)
                for name in ("approach", "indentation", "tilt_x", "tilt_y", "max_pressure"):
                    assert getattr(shared, name) == pytest.approx(getattr(single, name), rel=1e-5)
                whole = shared.gather()
                if comm.rank == 0:
                    np.testing.assert_allclose(whole.gap, single.gap, atol=1e-6 * np.abs(single.gap).max())
            one = several.with_stiffness(several.solve(load=300, load_centre=(0.2, -0.1)), tilts=True)
            other = alone.with_stiffness(alone.solve(load=300, load_centre=(0.2, -0.1)), tilts=True)
            np.testing.assert_allclose(one.tilt_stiffness, other.tilt_stiffness, rtol=1e-5)


@pytest.mark.mpi(3)
def test_all_ranks_refuse_a_centre_outside(comm):
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    from app.base.errors import InputError

    with ContactSolver(ContactProblem(grid, STEEL, np.zeros((16, 16))), comm=comm) as solver:
        with pytest.raises(InputError, match="convex hull"):
            solver.solve(load=1, load_centre=(0, 0.95))
        assert solver.solve(load=1, load_centre=(0, 0.9)).converged
