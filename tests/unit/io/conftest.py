"""A result and its file."""

import pytest
from mpi4py import MPI
from results import made_up_result, write

from app.parallel.slabs import Slabs


@pytest.fixture(scope="module")
def result():
    return made_up_result(64, 48, punch_radius=4.5)


@pytest.fixture
def path(result, tmp_path):
    write(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(48), result)
    return tmp_path / "result.h5"
