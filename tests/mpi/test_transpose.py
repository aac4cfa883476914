"""Transposes between rows and dealt columns, in groups of columns."""

import numpy as np
import pytest
from operators import GRIDS, make_convolution

from app.halfspace.fft import transpose


@pytest.mark.mpi(2, 3)
def test_small_group_limit_gives_many_column_groups(comm, monkeypatch):
    monkeypatch.setattr(transpose, "_GROUP_BYTES", 1024)
    assert len(make_convolution(comm, GRIDS["many groups"])._groups) > 4


@pytest.mark.mpi(2, 3)
def test_columns_come_to_their_rank_and_go_back(comm):
    """Rank r has rows of value r; every column it is dealt has all of them, and they return unchanged."""
    heights = [3, 0, 2][: comm.size]
    (group,) = transpose.deal_columns(40, heights, comm)
    part = np.full(heights[comm.rank] * 40, comm.rank + 1, complex)
    received = np.zeros(group.to_receive, complex)
    for rank, strips in enumerate(group.deal(comm, part, received)):
        assert strips.size == heights[rank] * group.count
        assert (strips == rank + 1).all()
    part[...] = 0
    group.own(part)[...] = comm.rank + 1
    group.send_back(comm, part, received)
    assert (part == comm.rank + 1).all()
