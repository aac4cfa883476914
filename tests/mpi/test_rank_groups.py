"""Grids shared by all ranks or the first few."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from mpi4py import MPI
from running import assert_proved_equal, solve

from app.halfspace.grid import Grid
from app.parallel.rank_groups import RankGroups


@pytest.mark.mpi(3, 5)
def test_only_first_ranks_have_a_communicator(comm):
    ranks = RankGroups(comm, 8)
    slabs, few = ranks.distribute(Grid(4, 5, 1.0, 1.0))  # 20 cells on 2 ranks
    assert slabs.size == 2
    assert (few is None) == (comm.rank >= 2)
    assert comm.allreduce(slabs.local) == 5
    assert few is None or (few.size, few.rank, few.allreduce(slabs.local)) == (2, comm.rank, 5)
    assert ranks.distribute(Grid(4, 4, 1.0, 1.0))[1] is few  # made once
    ranks.destroy()


@pytest.mark.mpi(8)
@pytest.mark.parametrize("method", ["fast", "fmg_v11"])
def test_result_is_the_same_on_ranks_without_small_grids(comm, method):
    options = {"lcp_cells_per_rank": 64, "lcp_rtol": 1e-9, "lcp_precision": "double"}
    if method != "fast":
        del options["lcp_precision"]
    here = solve(hertz(64), APPROACH, method, **options)
    pressure = np.vstack(comm.allgather(here.pressure))
    assert here.converged
    if comm.rank == 0:
        alone = solve(hertz(64), APPROACH, method, comm=MPI.COMM_SELF, **options)
        assert here.iterations == alone.iterations
        np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=1e-8 * alone.max_pressure)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("cells", [3000, 9000, 20000])
def test_windows_on_few_ranks_give_the_same_result(comm, cells):
    here = solve(hertz(160), APPROACH, "fast", lcp_cells_per_rank=cells)
    alone = solve(hertz(160), APPROACH, "fast", comm=MPI.COMM_SELF)
    assert here.converged
    assert here.iterations == alone.iterations
    whole = here.gather()
    if comm.rank == 0:
        assert_proved_equal(whole, alone)
