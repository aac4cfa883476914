"""Slabs: the rows of each rank."""

import pytest

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
