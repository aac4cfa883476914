"""Slabs: the rows of each rank."""

import numpy as np
import pytest

from app.parallel.rank_groups import slab_alignment
from app.parallel.slabs import Slabs


@pytest.mark.parametrize("ny", [1, 5, 16, 37])
@pytest.mark.parametrize("size", [1, 2, 3, 7])
@pytest.mark.parametrize("block", [1, 4])
def test_slabs_are_a_partition_that_coarsens(ny, size, block):
    all_rows = []
    for rank in range(size):
        slabs = Slabs(ny, size, rank, block)
        assert slabs.local == slabs.counts[rank] == slabs.rows.stop - slabs.rows.start
        assert slabs.rows.start % block == 0 or slabs.rows.start == ny
        all_rows += range(ny)[slabs.rows]
        coarse = slabs
        while coarse.ny > 1:  # the parent is where the first child is
            fine, coarse = coarse, coarse.coarsen(2)
            assert coarse.ny == -(-fine.ny // 2)
            firsts = [j // 2 for j in range(fine.ny)[fine.rows] if j % 2 == 0]
            assert firsts == list(range(coarse.ny)[coarse.rows])
    assert all_rows == list(range(ny))


def test_slabs_match_those_of_coarser_grid():
    """What a restriction makes stays where it is, where all ranks have many rows."""
    for size in (2, 3, 5, 48):
        fine = Slabs(4096, size, 0, slab_alignment(4096, size))
        coarse = Slabs(2048, size, 0, slab_alignment(2048, size))
        assert fine.coarsen(2).starts == coarse.starts


def test_ranks_beyond_size_have_no_rows():
    slabs = Slabs(10, 3, 4)
    assert (slabs.local, slabs.active) == (0, False)
    first, last = slabs.bounds(6)
    np.testing.assert_array_equal(last - first, [4, 3, 3, 0, 0, 0])
    assert slabs.coarsen(2).local == 0
