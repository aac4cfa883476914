"""Nested iterations on several ranks against one."""

import numpy as np
import pytest
from cases import APPROACH, hertz, punch
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


@pytest.mark.mpi(2)
@pytest.mark.parametrize("method", ["mg_v10", "fmg_v11", "fast"])
def test_load_and_approach_agree_on_two_ranks(comm, method):
    by_approach = solve(punch(96), 0.1, method)
    by_load = solve(punch(96), None, method, by_approach.load)
    assert by_approach.converged and by_load.converged
    assert by_load.operator_applications <= 1.5 * by_approach.operator_applications
    assert by_load.load == pytest.approx(by_approach.load, rel=1e-12)
    # (5.1) allows both this mean gap on C.
    square, cells = (
        comm.allreduce(np.nansum(of)) for of in (by_approach.undeformed_distance**2, by_approach.contact)
    )
    assert by_load.approach == pytest.approx(0.1, abs=2e-6 * np.sqrt(square / cells))
