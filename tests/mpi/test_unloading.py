"""Unloading with a hardness on several ranks."""

from dataclasses import replace

import numpy as np
import pytest
from cases import hertz
from mpi4py import MPI

from app import ContactSolver, read_result


@pytest.mark.mpi(2, 3)
def test_unloading_is_independent_of_ranks(comm, tmp_path):
    problem, paths = replace(hertz(32), hardness=1000.0), []
    for one in comm, MPI.COMM_SELF:
        with ContactSolver(problem, options={"lcp_rtol": 1e-9, "lcp_coarse_rtol": 1e-9}, comm=one) as solver:
            path = solver.path(load=[9e4, 4e4, 1e3, 9e4])
            steps = [solution.gather() for solution in path]
            paths.append((path.table, steps))
            surface = next(iter(solver.path(load=[9e4]))).residual_surface()
            solver.update(replace(problem, surfaces=(surface,)))
            paths[-1][1].append(solver.solve(load=4e4).gather())
    (several, steps), (alone, expected) = paths
    for name in "load approach indentation max_pressure plastic_area plastic_volume mean_gap".split():
        assert several[name] == pytest.approx(alone[name], rel=1e-6), name
    for step, other in zip(steps, expected, strict=True):
        if comm.rank:
            assert step is None
            continue
        for name in "plastic_depth", "gap", "undeformed_distance", "pressure":
            field = getattr(other, name)
            np.testing.assert_allclose(getattr(step, name), field, atol=1e-6 * np.abs(field).max())
        np.testing.assert_array_equal(step.plastic, other.plastic)


@pytest.mark.mpi(1, 2)
def test_result_files_have_the_plastic_fields(comm, tmp_path):
    with ContactSolver(replace(hertz(32), hardness=1000.0), comm=comm) as solver:
        for k, solution in enumerate(solver.path(load=[9e4, 4e4])):
            solution.save(tmp_path / f"{k}.h5")
            whole = solution.gather()
            if comm.rank:
                continue
            saved = read_result(tmp_path / f"{k}.h5")
            for name in "plastic", "plastic_depth", "gap", "undeformed_distance":
                np.testing.assert_array_equal(getattr(saved, name), getattr(whole, name))
            assert saved.plastic.any() == (k == 0) and saved.plastic_volume == whole.plastic_volume > 0
            assert saved.units["plastic_depth"] == "mm" and saved.attributes["hardness"] == 1000.0
