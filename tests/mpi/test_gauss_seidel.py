"""Gauss-Seidel on several ranks against one."""

import numpy as np
import pytest
from sweeps import GRIDS, block_sizes, empty_in_the_middle, make, random_problem, sweep

from app.halfspace.grid import Grid
from app.parallel.communicator import Communicator
from app.parallel.slabs import Slabs

each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())


def assert_same_as_alone(comm, grid, slabs, problems):
    alone, together = make(grid), make(grid, slabs, comm)
    for mask, r in problems:
        for backward in (False, True):
            expected = sweep(alone, r, mask, 0.8, backward)
            found = sweep(together, r[slabs.rows], mask[slabs.rows], 0.8, backward)
            error = np.abs(found - expected[slabs.rows]).max(initial=0.0)
            assert error <= 1e-12 * np.abs(expected).max(), (grid, slabs.counts, backward, error)
    assert len(set(comm.allgather(together.products_per_sweep))) == 1


@pytest.mark.mpi(2, 3, 4)
@each_grid
@pytest.mark.parametrize("block", [1, 64])  # 64: some ranks own no rows
def test_sweep_does_not_depend_on_number_of_ranks(comm, grid, block):
    problems = [random_problem(grid), empty_in_the_middle(grid), random_problem(grid, share=0)]
    assert_same_as_alone(comm, grid, Slabs(grid.ny, comm.size, comm.rank, block), problems)


@pytest.mark.mpi(2, 3, 4)
@each_grid
def test_sweep_does_not_depend_on_block_sizes(comm, grid):
    problems = [random_problem(grid), empty_in_the_middle(grid)]
    with block_sizes(5, 16):
        assert_same_as_alone(comm, grid, Slabs(grid.ny, comm.size, comm.rank), problems)


@pytest.mark.mpi(2, 3, 4)
@each_grid
def test_sweep_is_the_same_on_slabs_of_coarse_grid(comm, grid):
    coarsened = Slabs(2 * grid.ny - 1, comm.size, comm.rank, 8).coarsen(2)
    assert_same_as_alone(comm, grid, coarsened, [random_problem(grid)])


@pytest.mark.mpi(2, 3)
def test_sweep_needs_few_messages(comm):
    """For every leaf its defect and correction, what is added to it and the leaf, solved; two gathers in all."""
    grid, leaf_rows = Grid(40, 240, 1.0, 1.0), 8
    slabs = Slabs(grid.ny, comm.size, comm.rank)
    counted = Communicator(comm)
    mask, r = random_problem(grid)
    with block_sizes(leaf_rows, 16):
        relaxation = make(grid, slabs, counted)
        sweep(relaxation, r[slabs.rows], mask[slabs.rows], 0.8)  # which prepares
        before = counted.traffic.copy()
        sweep(relaxation, r[slabs.rows], mask[slabs.rows], 0.8)
    sent, leaves = counted.traffic.since(before), grid.ny // leaf_rows
    assert sent.small_collectives == 2
    assert sent.all_to_alls == 0
    own = leaves // comm.size  # leaves whose rows are here
    others = comm.size - 1
    assert sent.messages == (leaves * others + own * others if comm.rank == 0 else own + leaves - 2)
