"""Every kind of method by several ranks against one."""

import numpy as np
import pytest
from cases import APPROACH, hertz, punch
from mpi4py import MPI
from running import solve

from app.base.errors import InputError

# Few cells on a rank, so that several levels are distributed; double precision to compare digits.
SHARED = {"lcp_cells_per_rank": 32, "lcp_precision": "double"}


@pytest.mark.mpi(2, 3, 4)
@pytest.mark.parametrize("grid", [(64, 64), (52, 37)], ids=["64", "52,37"])
@pytest.mark.parametrize("method", ["mg_v11", "fmg_v10", "fast", "fmg_lift"])
def test_any_number_of_ranks_iterates_alike(comm, method, grid):
    one, many = (solve(hertz(*grid), APPROACH, method, comm=c, **SHARED) for c in (MPI.COMM_SELF, comm))
    assert one.converged and many.converged
    assert many.comm.size == comm.size
    assert list(one.history["contact_cells"]) == list(many.history["contact_cells"])
    assert one.work_units == pytest.approx(many.work_units)
    pressure = np.vstack(comm.allgather(many.pressure))
    np.testing.assert_allclose(pressure, one.pressure, rtol=0, atol=1e-10 * one.max_pressure)


@pytest.mark.mpi(2)
@pytest.mark.parametrize("method", ["mg_v10", "fmg_v11", "fast"])
def test_load_on_two_ranks(comm, method):
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


@pytest.mark.mpi(2)
def test_a_refused_coarsest_grid_is_told_by_its_cells_or_by_its_ranks(comm):
    for n, levels, message in (
        (128, 2, "64 x 64 cells is too large"),
        (64, 3, "16 x 16 cells is on 2 ranks"),
    ):
        with pytest.raises(InputError, match=f"a coarsest grid of {message}"):
            solve(hertz(n), APPROACH, "mg_v11", pc_mg_levels=levels, lcp_cells_per_rank=1)


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize("method", ["fmg_v11", "fmg_fft"])
def test_multigrid_with_one_level_is_its_smoother(comm, method):
    """No grid is too large for it, and no matrix is assembled."""
    one_level = solve(hertz(96), APPROACH, method, pc_mg_levels=1, lcp_max_it=300)
    assert one_level.converged
    assert one_level.iterations > 2 * solve(hertz(96), APPROACH, method).iterations


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize(
    ("who", "options"),
    [
        (
            "Circulant",
            {
                "mg_coarse_pc_type": "python",
                "mg_coarse_pc_python_type": "app.methods.free.circulant.Circulant",
            },
        ),
        (
            "Circulant",
            {
                "mg_coarse_sub_pc_type": "python",
                "mg_coarse_sub_pc_python_type": "app.methods.free.circulant.Circulant",
            },
        ),
        (
            "TrackingCG",
            {
                "mg_coarse_ksp_type": "python",
                "mg_coarse_ksp_python_type": "app.methods.free.tracking_cg.TrackingCG",
            },
        ),
        ("TwoGrid", {"pc_type": "python", "pc_python_type": "app.methods.periodic.two_grid.TwoGrid"}),
    ],
)
def test_our_solvers_refuse_systems_that_are_not_theirs(comm, who, options):
    with pytest.raises(InputError, match=f"{who}: needs an In"):
        solve(hertz(32), APPROACH, "fmg_v11", **options)
