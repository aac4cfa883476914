"""Load paths with stiffness and distributions on several ranks."""

import numpy as np
import pytest
from cases import hertz, self_affine
from mpi4py import MPI

from app import ContactSolver


@pytest.mark.mpi(2, 3)
def test_paths_are_independent_of_ranks(comm):
    for problem, loads in ((hertz(64), [1e3, 8e4]), (self_affine(32), [3.0, 30.0])):
        tables = []
        for one in (comm, MPI.COMM_SELF):
            with ContactSolver(
                problem, options={"lcp_rtol": 1e-10, "lcp_coarse_rtol": 1e-8}, comm=one
            ) as solver:
                path = solver.path(load=loads, stiffness=True)
                distributions = [solution.distribution("gap", 5) for solution in path]
                tables.append(path.table | {"distribution": distributions[-1][1]})
        several, alone = tables
        for name in several.keys() - {"residual", "error_bound", "iterations", "major_axis_angle"}:
            size = alone["load"].max() if name.startswith("moment") else 1e-2  # symmetric: next to none
            scale = np.abs(alone[name]).max() + size
            assert several[name] == pytest.approx(alone[name], abs=1e-6 * scale, nan_ok=True), name
