"""The preconditioner of the flow: symmetric, positive, and good for irregular gaps."""

import numpy as np
import pytest
from petsc4py import PETSc

from app import Grid
from app.flow.gap_flow import MAX_ERROR, PREFIX, solve_flow
from app.flow.network import Network
from app.flow.percolation import find_percolating_sets
from app.flow.two_grid import TwoGrid
from app.options.solver_options import temporary_options
from app.parallel.slabs import Slabs


def two_grid(periodic, shape, closed=0.3, decades=2):
    """Return matrix and preconditioner of a random gap, and the open cells."""
    grid, rng = Grid.from_domain(*shape[::-1], (0, 2, 0, 1), periodic), np.random.default_rng(3)
    cubes = np.where(rng.random(shape) > closed, 10 ** -(3 * decades * rng.random(shape)), 0)
    sets, count = find_percolating_sets(cubes > 0, grid, "x", Slabs(grid.ny))
    network = Network(np.where(sets > 0, cubes, 0), grid, "x", Slabs(grid.ny))
    context = TwoGrid(network, network.tie(sets, count), "test_two_grid_")
    matrix = PETSc.Mat().createPython(((grid.n, grid.n),) * 2, context, comm=PETSc.COMM_SELF)
    matrix.setUp()
    return matrix, context, network.is_open.ravel()


@pytest.mark.parametrize("periodic", [False, "x", "y", True])
def test_matrix_and_preconditioner_are_symmetric_and_positive(periodic):
    matrix, context, is_open = two_grid(periodic, (13, 10), closed=0.2)
    x, y = matrix.createVecs()
    for apply in (matrix.mult, lambda one, other: context.apply(None, one, other)):
        columns = []
        for cell in np.flatnonzero(is_open):
            x.set(0)
            x.setValue(cell, 1.0)
            x.assemble()
            apply(x, y)
            columns.append(y.getArray().copy())
        dense = np.array(columns)
        assert not dense[:, ~is_open].any()
        dense = dense[:, is_open]
        np.testing.assert_allclose(dense, dense.T, atol=1e-10 * np.abs(dense).max())
        assert np.linalg.eigvalsh(dense / np.sqrt(np.outer(dense.diagonal(), dense.diagonal()))).min() > 0


@pytest.mark.parametrize("closed", [0.0, 0.1, 0.3])
def test_iterations_stay_few_if_the_gap_differs_much_from_cell_to_cell(closed):
    grid, rng = Grid.from_domain(128, 128, (0, 1, 0, 1), True), np.random.default_rng(1)
    gap, is_open = 10 ** -(2 * rng.random(grid.shape)), rng.random(grid.shape) > closed
    with temporary_options(PREFIX, {}, {"ksp_rtol": "3e-5", "ksp_max_it": "45"}):
        assert solve_flow(gap, is_open, grid).flow_error <= MAX_ERROR
