"""Nested iterations on several ranks against one."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from mpi4py import MPI
from running import solve

# Few cells on a rank, so that several levels are distributed; double precision to compare digits.
SHARED = {"lcp_cells_per_rank": 32, "lcp_precision": "double"}


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize("grid", [(64, 64), (52, 37)], ids=["64", "52,37"])
@pytest.mark.parametrize("method", ["mg_v11", "fmg_v10", "fast", "fmg_lift"])
def test_iterations_are_independent_of_ranks(comm, method, grid):
    one, many = (solve(hertz(*grid), APPROACH, method, comm=c, **SHARED) for c in (MPI.COMM_SELF, comm))
    assert one.converged and many.converged
    assert many.comm.size == comm.size
    assert list(one.history["contact_cells"]) == list(many.history["contact_cells"])
    assert one.work_units == pytest.approx(many.work_units)
    pressure = np.vstack(comm.allgather(many.pressure))
    np.testing.assert_allclose(pressure, one.pressure, rtol=0, atol=1e-10 * one.max_pressure)
