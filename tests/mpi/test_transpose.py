"""Transposes between rows and dealt columns, in groups of columns."""

import pytest
from operators import GRIDS, make_convolution

from app.halfspace.fft import transpose


@pytest.mark.mpi(2, 3)
def test_small_group_limit_gives_many_column_groups(comm, monkeypatch):
    monkeypatch.setattr(transpose, "_GROUP_BYTES", 1024)
    assert len(make_convolution(comm, GRIDS["many groups"])._groups) > 4
