"""Result files written by several ranks: those of one rank, and errors on all ranks at once."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from results import FIELDS, assert_same, full_disk, made_up_result, write

from app.io.result import read_result
from app.parallel.slabs import Slabs


@pytest.fixture(scope="module")
def result():
    return made_up_result(64, 48, punch_radius=4.5)


def raised_everywhere(comm, kind, call):
    """Whether `call` raises `kind` on each rank; any other error is passed on."""
    try:
        call()
    except kind as error:
        return comm.allgather(str(error))
    raise AssertionError(f"rank {comm.rank}: no {kind.__name__}")


def unseen_folder():
    """Let this process open no file, as if the folder were on another machine's disk."""
    return mock.patch.object(Path, "open", side_effect=FileNotFoundError(2, "No such file or directory"))


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("block", [1, 16, 48])  # 48: all rows on rank 0, none on the others
def test_each_rank_writes_its_rows(comm, result, tmp_path, block):
    slabs = Slabs(48, comm.size, comm.rank, block)
    extra = {name: getattr(result, name)[slabs.rows] for name in FIELDS} | {
        "rank": np.full((slabs.local, 64), comm.rank, np.int32)
    }
    late = result.attributes | {"solve_seconds": 0.3 + comm.rank}  # differs from rank to rank
    write(tmp_path / "result.h5", comm, slabs, result, fields=extra, attributes=late)
    found = read_result(tmp_path / "result.h5")
    assert (found.extra.pop("rank") == np.repeat(np.arange(comm.size), slabs.counts)[:, None]).all()
    assert found.attributes["solve_seconds"] == 0.3
    found.attributes["solve_seconds"] = result.attributes["solve_seconds"]
    assert_same(found, result)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("together", [True, False])  # False: as with an h5py that knows no MPI
def test_the_file_is_that_of_one_rank(comm, result, tmp_path, together):
    if together and not h5py.get_config().mpi:
        pytest.skip("this h5py has no MPI")
    with mock.patch("h5py.get_config", return_value=SimpleNamespace(mpi=together)):
        write(tmp_path / "result.h5", comm, Slabs(48, comm.size, comm.rank), result)
    if comm.rank == 0:
        write(tmp_path / "serial.h5", MPI.COMM_SELF, Slabs(48), result)
        assert (tmp_path / "result.h5").read_bytes() == (tmp_path / "serial.h5").read_bytes()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize(("trouble", "rank"), [(full_disk, -1), (full_disk, 0), (unseen_folder, -1)])
def test_trouble_on_one_rank_leaves_the_previous_result(comm, result, tmp_path, trouble, rank):
    slabs, path, rank = Slabs(48, comm.size, comm.rank), tmp_path / "result.h5", rank % comm.size
    write(path, comm, slabs, result)
    before = path.read_bytes()
    comm.Barrier()
    with trouble() if comm.rank == rank else nullcontext():
        said = raised_everywhere(comm, OSError, lambda: write(path, comm, slabs, result))
    assert len(set(said)) == 1 and f"rank {rank}: " in said[0], said
    assert [f.name for f in tmp_path.iterdir()] == ["result.h5"]
    assert path.read_bytes() == before
