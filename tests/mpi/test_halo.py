"""Ghost rows of slabs, on several ranks."""

import numpy as np
import pytest

from app.parallel.halo import Halo
from app.parallel.slabs import Slabs


@pytest.mark.mpi(2, 3, 5)
@pytest.mark.parametrize("dtype", [np.float64, np.float32, bool])
def test_halo_rows_come_from_their_ranks(comm, dtype):
    """Slabs of any height, even empty, and halos wider than the patch."""
    for ny, block, width in ((12, 1, 1), (12, 4, 5), (3, 1, 2), (1, 1, 4), (7, 2, 9), (40, 1, 8)):
        field = (np.random.default_rng(ny).normal(size=(ny, 3)) > 0.1 * np.arange(3)).astype(dtype)
        slabs = Slabs(ny, comm.size, comm.rank, block)
        first, last = slabs.rows.start, slabs.rows.stop
        before, after = Halo(slabs, comm, width)(field[slabs.rows])
        assert before.dtype == after.dtype == field.dtype
        if first == last:
            assert before.shape == after.shape == (0, 3)
            continue
        np.testing.assert_array_equal(before, field[np.arange(first - width, first) % ny])
        np.testing.assert_array_equal(after, field[np.arange(last, last + width) % ny])
