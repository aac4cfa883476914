"""Compiled loops: by one rank, for all."""

from importlib import import_module

import pytest

LOOP = """
from app.base.numba_cache import njit

@njit()
def twice(x):
    return 2 * x
"""


@pytest.mark.mpi(2, 3)
def test_ranks_that_begin_at_once_compile_once(comm, tmp_path, monkeypatch):
    if comm.rank == 0:
        (tmp_path / "loop_of_a_test.py").write_text(LOOP)
    comm.Barrier()
    monkeypatch.syspath_prepend(tmp_path)
    loop = import_module("loop_of_a_test")
    comm.Barrier()
    assert loop.twice(2.0) == 4
    assert comm.allreduce(sum(loop.twice.stats.cache_misses.values())) == 1
