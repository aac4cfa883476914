"""Flow through a gap is the same on any number of ranks."""

import numpy as np
import pytest
from cases import self_affine

from app import ContactSolver, Grid
from app.base.mpi import MPI
from app.flow.gap_flow import MAX_ERROR, PREFIX, solve_flow
from app.flow.percolation import find_percolating_sets
from app.options.solver_options import temporary_options
from app.parallel.slabs import Slabs


def random_gap(grid, closed):
    rng = np.random.default_rng(5)
    return 10 ** -(2 * rng.random(grid.shape)), rng.random(grid.shape) > closed


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("periodic", [False, "x", "y", True])
@pytest.mark.parametrize(
    ("shape", "closed"), [((37, 30), 0.3), ((2, 40), 0.1), ((1, 6), 0.0), ((30, 16), 0.9)]
)
def test_flow_is_independent_of_ranks(comm, periodic, shape, closed):
    grid = Grid.from_domain(*shape[::-1], (0, 2, 0, 1), periodic)
    gap, is_open = random_gap(grid, closed)
    slabs = Slabs.over(comm, grid.ny)
    for options in ({}, {"ksp_rtol": "0.2"}):
        with temporary_options(PREFIX, {}, options):
            alone = solve_flow(gap, is_open, grid)
            flow = solve_flow(gap[slabs.rows], is_open[slabs.rows], grid, slabs, comm)
        assert comm.allreduce(flow.upper_x, MPI.MIN) == comm.allreduce(flow.upper_x, MPI.MAX)
        for one, other in ((flow.x, alone.x), (flow.y, alone.y)):
            assert one.percolates is other.percolates
            assert one.lower <= other.upper and other.lower <= one.upper
        if options:
            continue
        assert flow.flow_error <= MAX_ERROR
        for name in ("fluid_pressure", "flux_x", "flux_y"):
            expected = getattr(alone, name)[slabs.rows]
            size = np.nanmax(np.abs(getattr(alone, name)), initial=1e-300)
            assert np.allclose(getattr(flow, name), expected, atol=0.02 * size, equal_nan=True)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("periodic", [False, "x", "y", True])
def test_percolating_sets_are_independent_of_ranks(comm, periodic):
    for closed in (0.2, 0.4):
        grid = Grid.from_domain(21, 17, (0, 2, 0, 1), periodic)
        _, is_open = random_gap(grid, closed)
        slabs = Slabs.over(comm, grid.ny)
        for along in "xy":
            expected, count = find_percolating_sets(is_open, grid, along, Slabs(grid.ny))
            sets, same = find_percolating_sets(is_open[slabs.rows], grid, along, slabs, comm)
            assert same == count and np.array_equal(sets > 0, expected[slabs.rows] > 0)


@pytest.mark.mpi(2, 3)
def test_gathered_solutions_keep_their_flow(comm):
    with ContactSolver(self_affine(32), comm=comm) as solver:
        solution = solver.solve(load=3.0)
        flow = solution.flow()
    whole = solution.gather()
    if whole is None:
        return
    assert whole.computed["flow"].y.flux_y.shape == whole.flow().fluid_pressure.shape == (32, 32)
    assert whole.transmissivity_x == flow.transmissivity_x
    assert np.array_equal(whole.extra["flux_x"][solution.slabs.rows], flow.flux_x)
