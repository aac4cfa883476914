"""Working storage that ranks share: the same products, without messages, and nothing that stays behind."""

import os

import numpy as np
import pytest
from cases import APPROACH, punch
from operators import BOXED, GRIDS, PERIODIC, make_convolution, random_field

from app import ContactSolver
from app.parallel import shared_memory
from app.parallel.communicator import Communicator
from app.parallel.shared_memory import Storage

SHAPES = {"one row": GRIDS["one row"], "odd": GRIDS["odd"], "many groups": GRIDS["many groups"], "box": BOXED}


def counting(comm, shared=True):
    counted = Communicator(comm)
    counted.shares_memory = shared
    return counted


@pytest.mark.mpi(2, 3, 5)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("grid", [*SHAPES.values(), *PERIODIC.values()], ids=[*SHAPES, *PERIODIC])
def test_shared_memory_does_not_change_products(comm, grid, dtype):
    found = []
    for shared in (False, True):
        counted = counting(comm, shared)
        product = make_convolution(counted, grid, dtype=dtype)
        for field in (random_field(grid, 1), random_field(grid, 2)):
            p = field[product.slabs.rows].astype(dtype)
            before, u = counted.traffic.copy(), np.empty_like(p)
            product.apply(p, u)
            mask = p > 0
            product.apply(p, p, mask)
            found.append((u, p))
        sent = counted.traffic.since(before)
        assert (sent.message_bytes == 0) == shared
        counted.shares_memory = False  # what is lent is shared all the same
        other = product.in_precision(np.float32)
        assert (product._storage.all is not None) == (other._storage.all is not None) == shared
    half = len(found) // 2
    for one, other in zip(found[:half], found[half:], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("what", ["memfd_create", "open", "readlink", "mmap"])
def test_all_ranks_send_if_one_cannot_share(comm, what, monkeypatch):
    def forbidden(*_arguments):
        raise PermissionError(what)

    if comm.rank == (0 if what == "memfd_create" else comm.size - 1):
        owner = {"mmap": shared_memory.mmap, "readlink": shared_memory.Path}.get(what, os)
        monkeypatch.setattr(owner, what, forbidden)
    found = Storage([100] * comm.size, comm.rank, counting(comm))
    assert found.all is None
    assert found.own.size == 100
    alone = Storage([100], 0, None)
    assert alone.all is None


@pytest.mark.mpi(2, 3)
def test_ranks_see_each_other_s_bytes(comm):
    counted = counting(comm)
    sizes = [5000 * rank for rank in range(comm.size)]
    here = Storage(sizes, comm.rank, counted)
    assert here.own.size == sizes[comm.rank]
    here.own[...] = comm.rank
    counted.exchange_barrier()
    for rank, (start, size) in enumerate(zip(here.starts, sizes, strict=False)):
        assert (here.all[start : start + size] == rank).all()
    assert not Storage([5001] * comm.size, comm.rank, counted).own.any()


@pytest.mark.mpi(2)
def test_closed_solvers_leave_no_open_files(comm):
    def open_files():
        return len(os.listdir("/proc/self/fd"))

    counts = []
    for _ in range(4):
        with ContactSolver(punch(160), "fast") as solver:
            solver.solve(approach=APPROACH)
        counts.append(open_files())
    assert counts[-1] == counts[1]
