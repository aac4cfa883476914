"""The active set iteration on several ranks."""

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
