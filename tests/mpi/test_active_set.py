"""The active set iteration on several ranks."""

import numpy as np
import pytest
from cases import APPROACH, assert_counts_of_norm, hertz
from mpi4py import MPI
from running import solve


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("n", [32, 64, 128])
def test_norm_takes_as_many_iterations_on_several_ranks(comm, n):
    together = solve(hertz(n), APPROACH)
    assert_counts_of_norm(n, together)
    if comm.rank == 0:
        expected = solve(hertz(n), APPROACH, comm=MPI.COMM_SELF)
        assert together.load == pytest.approx(expected.load, rel=5e-6)  # both are solved to 1e-6


@pytest.mark.mpi(2, 3)
def test_pressure_of_norm_is_independent_of_ranks(comm):
    pressure = np.vstack(comm.allgather(solve(hertz(45, 37), APPROACH, lcp_rtol=1e-12).pressure))
    if comm.rank == 0:
        expected = solve(hertz(45, 37), APPROACH, comm=MPI.COMM_SELF, lcp_rtol=1e-12)
        np.testing.assert_allclose(pressure, expected.pressure, rtol=0, atol=1e-6)
        assert ((pressure > 0) == expected.contact).all()
