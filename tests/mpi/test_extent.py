"""Patches of contact that go over ranks; path, stiffness and errors on several of them."""

import numpy as np
import pytest
from cases import hertz, self_affine
from mpi4py import MPI

from app import ContactSolver
from app.halfspace.connected_sets import label_connected_sets
from app.parallel.slabs import Slabs


@pytest.mark.mpi(2, 3)
def test_patches_are_the_same_on_any_number_of_ranks(comm):
    for shape in ((13, 17), (2, 9)):
        for symbol in ("", "spectral"):
            contact, periodic = np.random.default_rng(1).random(shape) < 0.55, bool(symbol)
            slabs = Slabs.over(comm, shape[0])
            labels, sizes = label_connected_sets(contact[slabs.rows], periodic, slabs, comm)
            expected, alone = label_connected_sets(contact, periodic)
            assert np.array_equal(np.sort(sizes), np.sort(alone))
            labels = np.vstack(comm.allgather(labels))
            pairs = np.unique(np.stack([labels[contact], expected[contact]]), axis=1)
            assert pairs.shape[1] == len(alone) and np.array_equal(sizes[pairs[0] - 1], alone[pairs[1] - 1])


@pytest.mark.mpi(2, 3)
def test_paths_are_the_same_on_any_number_of_ranks(comm):
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
