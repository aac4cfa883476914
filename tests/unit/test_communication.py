"""Which rank has what: the balance of slabs, and how many ranks share a grid. Computed, not run."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.parallel.rank_groups import count_ranks, slab_alignment
from app.parallel.slabs import Slabs


def balance(slabs):
    """Mean over most of the rows of a rank."""
    return slabs.ny / slabs.size / max(slabs.counts)


def grids(n, coarsest=4):
    grid = Grid(n, n, 1.0, 1.0)
    while grid is not None:
        yield grid
        grid = grid.coarsen(coarsest)


def test_4096_rows_are_balanced_on_any_number_of_ranks():
    """To nine tenths, unless whole rows cannot be: 4096 on 506 to 511 ranks are 9 on some and 8 on others."""
    for size in range(2, 513):
        possible = 4096 / size / -(-4096 // size)
        assert balance(Slabs(4096, size, 0, slab_alignment(4096, size))) >= min(0.9, possible)


@pytest.mark.parametrize("size", [2, 3, 48, 64, 500, 512])
@pytest.mark.parametrize("cells", [1, 100, 8192])
def test_coarser_grids_are_balanced_on_the_ranks_that_share_them(size, cells):
    before = size
    for grid in grids(4096):
        ranks = count_ranks(grid, size, cells)
        assert 1 <= ranks <= min(before, grid.ny)
        assert ranks == 1 or grid.n >= cells * ranks
        slabs = Slabs(grid.ny, ranks, 0, slab_alignment(grid.ny, ranks))
        assert balance(slabs) >= min(0.9, grid.ny / ranks / -(-grid.ny // ranks))
        before = ranks
    assert before == 1 or cells == 1


def test_slabs_of_a_grid_and_the_next_coarser_one_fit():
    """What a restriction makes stays where it is, where all ranks have many rows."""
    for size in (2, 3, 5, 48):
        fine = Slabs(4096, size, 0, slab_alignment(4096, size))
        coarse = Slabs(2048, size, 0, slab_alignment(2048, size))
        assert fine.coarsen(2).starts == coarse.starts


def test_ranks_beyond_have_no_rows():
    slabs = Slabs(10, 3, 4)
    assert (slabs.local, slabs.active) == (0, False)
    first, last = slabs.bounds(6)
    np.testing.assert_array_equal(last - first, [4, 3, 3, 0, 0, 0])
    assert slabs.coarsen(2).local == 0
