"""Reductions over ranks."""

import numpy as np
import pytest

from app.parallel.communicator import Communicator
from app.parallel.reductions import minimum_over, sums_and_minima


@pytest.mark.mpi(1, 2, 3)
def test_sums_and_minima_need_one_reduction(comm):
    counted = Communicator(comm)
    for size in (0, 1, 5):  # of either
        ours = np.arange(size) + 10.0 * comm.rank
        sums, lowest = sums_and_minima(counted, ours, -ours)
        np.testing.assert_array_equal(
            sums, np.sum([np.arange(size) + 10 * r for r in range(comm.size)], axis=0)
        )
        np.testing.assert_array_equal(lowest, -(np.arange(size) + 10 * (comm.size - 1)))
    assert counted.traffic.small_collectives == 3


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("last", [False, True])
def test_minimum_is_nan_if_any_rank_has_nan(comm, last):
    """MPI.MIN tells NaN or not, depending on which rank has it."""
    here = comm.rank == (comm.size - 1 if last else 0)
    found = minimum_over(comm, [[comm.rank, np.nan if here else 1.0]])
    np.testing.assert_array_equal(found, [[0.0, np.nan]])
