"""Redistribution of rows between any two layouts."""

import numpy as np
import pytest

from app.parallel.fetch import Fetch
from app.parallel.slabs import Slabs


@pytest.mark.mpi(1, 2, 3, 5)
@pytest.mark.parametrize("dtype", [float, np.float32, bool])
def test_fetch_brings_each_rank_the_rows_it_wants(comm, dtype):
    rng, ny = np.random.default_rng(3), 11
    field = (rng.normal(size=(ny, 4)) > 0).astype(dtype) * np.arange(1, 4 * ny + 1).reshape(ny, 4)
    for size in range(1, comm.size + 1):
        have = Slabs(ny, size, comm.rank, rng.integers(1, 4))
        mine = field[have.rows]
        for reach in (0, 3, 2 * ny):  # inside, beyond the grid, over several periods
            pairs = [np.sort(rng.integers(-reach, ny + reach + 1, (2, comm.size)), axis=0) for _ in range(2)]
            fetch = Fetch(have, pairs, comm)
            wanted = np.concatenate([np.arange(first[comm.rank], last[comm.rank]) for first, last in pairs])
            np.testing.assert_array_equal(fetch(mine), field[wanted % ny])
        stays = Fetch(have, [have.bounds(comm.size)], comm)
        assert stays(mine) is mine
