"""Windows on one and several ranks."""

from contextlib import nullcontext
from itertools import product
from unittest import mock

import numpy as np
import pytest
from mpi4py import MPI
from running import assert_solves_lcp, solve

from app import ContactProblem, Grid, Material
from app.multigrid import solver_cache
from app.multigrid.hierarchy import Hierarchy

each_number_of_ranks = pytest.mark.mpi(1, 2, 3, 5)


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize("load", [80.0, 40000.0])  # windows on one rank, and on all two
def test_freed_memory_changes_no_solution(comm, load):
    grid, solutions = Grid.from_domain(200, 200, (-1.0, 1.0, -1.0, 1.0)), []
    wavy = ContactProblem(
        grid,
        Material.combined(80000.0, 0.3),
        lambda x, y: (x**2 + y**2) / 2 + 1e-3 * np.cos(40 * x) * np.cos(31 * y),
    )
    for largest in (solver_cache.MAX_CACHED_CELLS, 0):
        with mock.patch.object(solver_cache, "MAX_CACHED_CELLS", largest):
            solutions.append(solve(wavy, None, "fast", load, comm))
    for field in ("pressure", "displacement", "contact"):
        one, other = (getattr(solution, field) for solution in solutions)
        np.testing.assert_array_equal(one, other)
    assert len({solution.operator_applications for solution in solutions}) == 1


def spiked(n):
    """Return a ball and a spike that vanishes in coarse cells."""
    grid = Grid.from_domain(n, n, (-1.0, 1.0, -1.0, 1.0))
    x, y = np.meshgrid(grid.x(), grid.y())
    shape = (x**2 + y**2) / 2
    shape[3, n - 5] = 0.005
    return ContactProblem(grid, Material.combined(80000.0, 0.3), shape)


@each_number_of_ranks
def test_contact_outside_the_window_is_found(comm):
    """Contact that coarse grids do not resolve is found."""
    everywhere = solve(spiked(128), 0.02, "fast", lcp_window=0, lcp_rtol=1e-9)
    for load, blind in product((None, everywhere.load), (False, True)):
        with mock.patch.object(Hierarchy, "coarse_minimum", return_value=None) if blind else nullcontext():
            solution = solve(spiked(128), 0.02, "fast", load, lcp_rtol=1e-9)
        level, iteration = (np.array(solution.history[name]) for name in ("level", "iteration"))
        starts = np.count_nonzero((level == level.max()) & (iteration == 1))
        assert starts == (2 if blind else 1)
        assert solution.converged, solution.message
        assert comm.allreduce(int(solution.contact.sum())) == comm.allreduce(int(everywhere.contact.sum()))
        highest = comm.allreduce(everywhere.pressure.max(initial=0.0), MPI.MAX)
        np.testing.assert_allclose(solution.pressure, everywhere.pressure, rtol=0, atol=1e-4 * highest)
    if comm.size == 1:
        assert solution.contact[3, -5]
        assert_solves_lcp(solution)


@each_number_of_ranks
def test_holes_stay_in_a_window_as_wide_as_the_grid(comm):
    grid = Grid.from_domain(128, 128, (-1.0, 1.0, -1.0, 1.0))
    x, y = np.meshgrid(grid.x(), grid.y())
    strip = np.where(x**2 + y**2 < 0.02, np.nan, y**2 / 2)
    for across in (strip, strip.T):  # in C and in Fortran order
        everywhere, windowed = (
            solve(
                ContactProblem(grid, Material.combined(80000.0, 0.3), across),
                0.01,
                "fast",
                lcp_window=margin,
                lcp_rtol=1e-8,
            )
            for margin in (0, 0.06)
        )
        assert windowed.operator_applications < everywhere.operator_applications
        np.testing.assert_array_equal(
            np.isnan(windowed.undeformed_distance), np.isnan(everywhere.undeformed_distance)
        )
        np.testing.assert_allclose(windowed.load, everywhere.load, rtol=1e-5)


@each_number_of_ranks
def test_windows_of_narrow_grids(comm):
    """Ranks have equal numbers of rows on different levels."""
    for ny in (2047, 2048):
        grid = Grid.from_domain(4, ny, (-0.004, 0.004, -2.0, 2.0))
        ball = ContactProblem(grid, Material.combined(80000.0, 0.3), lambda x, y: (x**2 + y**2) / 2)
        everywhere, windowed = (
            solve(ball, 0.01, "fast", lcp_window=margin, lcp_rtol=1e-9) for margin in (0, 0.06)
        )
        np.testing.assert_allclose(windowed.load, everywhere.load, rtol=1e-5)
        assert solve(ball, -0.01, "fast").load == 0  # no grid has anything to look out for
