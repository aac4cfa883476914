"""Contact with a hardness on several ranks."""

import numpy as np
import pytest
from mpi4py import MPI

from app import read_result
from app.verification.dense import DenseProblem
from app.verification.solving import random_problem, solved, with_hardness

OPTIONS = {"lcp_rtol": 1e-9, "lcp_cells_per_rank": 8}


def limited_problem(seed, periodic):
    """A problem with a hardness of each cell, and holes in half of the problems."""
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, *map(int, rng.integers(3, 13, 2)), periodic)
    elastic = DenseProblem(problem).at(np.nanmean(problem.gap) - 1e-6)
    return with_hardness(rng, problem, float(elastic.max()))


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("method", [None, "norm"])
@pytest.mark.parametrize("periodic", ["", "spectral"])
def test_plastic_contact_is_independent_of_ranks(comm, periodic, method):
    for seed in range(2):
        problem = limited_problem(seed, periodic)
        dense, middle = DenseProblem(problem), 0.5 * (np.nanmin(problem.gap) + np.nanmean(problem.gap))
        exact = dense.at(middle).astype(float)
        loadings = [{"approach": middle}, {"load": problem.grid.cell_area * exact.sum()}]
        if np.isfinite(dense.largest_load):
            loadings += [{"load": dense.largest_load}, {"load": 0.97 * dense.largest_load}]
        for loading in loadings:
            several = solved(problem, method, comm, options=OPTIONS, **loading)
            gathered = several.gather()
            alone = solved(problem, method, MPI.COMM_SELF, options=OPTIONS, **loading)
            assert several.converged == alone.converged
            assert several.plastic_area == alone.plastic_area or not alone.converged
            assert several.plastic_volume == pytest.approx(alone.plastic_volume, rel=1e-5, abs=1e-12)
            if comm.rank or not alone.converged:
                continue
            size = alone.pressure.max()
            np.testing.assert_allclose(gathered.pressure, alone.pressure, rtol=0, atol=1e-6 * size)
            if "approach" in loading:
                np.testing.assert_allclose(gathered.pressure, exact, rtol=0, atol=1e-5 * size)


@pytest.mark.mpi(1, 3)
def test_a_result_file_has_the_hardness_of_each_cell(comm, tmp_path):
    path = comm.bcast(str(tmp_path / "r.h5"))
    problem = limited_problem(1, "")
    solved(problem, comm=comm, load=0.01).save(path)
    stored = read_result(path)
    assert np.array_equal(stored.extra["hardness"], problem.hardness)
    assert stored.units["hardness"] == "N/mm2"
