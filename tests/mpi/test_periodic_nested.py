"""The primal form on several ranks against one."""

import numpy as np
import periodic
import pytest
from mpi4py import MPI
from operators import STEEL, random_field
from running import solve

from app import ContactSolver, Grid
from app.methods import progress
from app.methods.periodic.solver import PrimalSolver
from app.multigrid.hierarchy import Hierarchy
from app.options.method import read_method_file
from app.options.solver_options import SolverOptions


@pytest.mark.mpi(2, 3, 5)
@pytest.mark.parametrize("cells", [1, 10**6])
@pytest.mark.parametrize("shape", [(32, 24), (12, 40), (9, 16), (8, 16), (33, 27), (13, 10)])
def test_two_grid_is_independent_of_the_number_of_ranks(comm, shape, cells):
    """Several slabs may begin inside a coarse row."""
    grid = Grid(shape[1], shape[0], 0.3, 0.2, periodic="spectral")
    free, r, w = np.random.default_rng(1).random(shape) < 0.7, random_field(grid, 2), random_field(grid, 3)
    fields = []
    for ranks in (comm, MPI.COMM_SELF):
        hierarchy = Hierarchy(grid, STEEL, ranks, 2, cells_per_rank=cells, dtype=np.float32)
        with SolverOptions("", read_method_file("primal")).inserted():
            solver = PrimalSolver(hierarchy)
        rows = hierarchy.slabs.rows
        solver.inverse.mask[...] = free[rows]
        solver.set_contact()
        loose, kept, moved = np.empty_like(r[rows]), np.empty_like(r[rows]), w[rows].copy()
        pc = solver.preconditioner
        pc.smooth(r[rows].copy(), loose)
        pc.constrained = True
        pc.smooth(r[rows].copy(), kept)
        pc.shift(0.1, moved)
        fields.append([np.vstack(ranks.allgather(part)) for part in (loose, kept, moved)])
        solver.destroy()
    for here, alone in zip(*fields, strict=True):
        np.testing.assert_allclose(here, alone, rtol=0, atol=3e-6 * abs(alone).max())


@pytest.mark.mpi(2, 3, 5)
@pytest.mark.parametrize(("nx", "ny"), [(48, 32), (24, 20), (15, 17), (18, 3)])
def test_solution_is_independent_of_the_number_of_ranks(comm, nx, ny):
    """On 18 x 3 cells some ranks have no rows."""
    problem, options = periodic.rough(nx, ny, 4, holes=0.05 if nx == 24 else 0.0), {"lcp_cells_per_rank": 8}
    solvers = (ContactSolver(problem, None, options, ranks) for ranks in (MPI.COMM_SELF, comm))
    with next(solvers) as one, next(solvers) as many:
        for share in (0.3, 0.9):
            approach = share * np.nanmean(problem.gap)
            alone = one.solve(approach=approach)
            for loading in ({"approach": approach}, {"load": alone.load}):
                here = many.solve(**loading)
                assert here.converged and here.fallbacks == 0
                pressure, contact = (
                    np.vstack(comm.allgather(part)) for part in (here.pressure, here.contact)
                )
                np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=2e-4 * alone.max_pressure)
                assert (contact == alone.contact).mean() > 0.998
                assert here.approach == pytest.approx(alone.approach, rel=1e-5)
            work = many.solve(approach=approach).operator_applications
            # One rank has small matrices in double precision.
            assert abs(work - alone.operator_applications) <= 8


@pytest.mark.mpi(3)
def test_multilevel_solution_is_independent_of_the_number_of_ranks(comm):
    problem = periodic.rough(514, 512, 4)
    with ContactSolver(problem, comm=MPI.COMM_SELF) as one, ContactSolver(problem, comm=comm) as many:
        alone = one.solve(approach=0.3 * problem.gap.mean())
        for loading in ({"approach": alone.approach}, {"load": alone.load}):
            here = many.solve(**loading)
            assert here.converged and here.fallbacks == 0
            pressure = np.vstack(comm.allgather(here.pressure))
            np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=2e-4 * alone.max_pressure)
        counts = [
            solver._strategy.solver.operator.influence.multipliers["inverse"].count for solver in (one, many)
        ]
        assert counts[1] >= counts[0] > 0


@pytest.mark.mpi(2, 3)
def test_safeguarded_solution_is_independent_of_the_number_of_ranks(comm, monkeypatch):
    problem = periodic.rough(24, 20, 1)
    approach = 0.8 * problem.gap.mean()
    alone = solve(problem, approach, None, comm=MPI.COMM_SELF, lcp_rtol=1e-9)
    monkeypatch.setattr(progress, "PATIENCE", 0)
    here = solve(problem, approach, None, comm=comm, lcp_rtol=1e-9, lcp_cells_per_rank=8)
    assert here.converged and here.fallbacks >= 1
    pressure = np.vstack(comm.allgather(here.pressure))
    np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=1e-5 * alone.max_pressure)
