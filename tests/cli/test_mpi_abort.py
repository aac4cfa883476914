"""Exceptions of programs on several ranks: which ones end all ranks."""

import pytest
from processes import run

from .test_api import PROBLEM

FAILING = (
    PROBLEM
    + """
import time
from mpi4py import MPI
from app import Listener
from app.parallel import mpi_abort
from app.methods.free.circulant import Circulant
rank, shared, sound = MPI.COMM_WORLD.rank, {"lcp_cells_per_rank": 64}, Circulant.precondition
def fails(self, *arguments):
    raise MemoryError("only here")
"""
)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "where",
    [
        "Circulant.precondition = fails if rank == 1 else sound\n"
        "with ContactSolver(problem, options=shared) as solver:\n    solver.solve(load=10.0)",
        "solve(problem, load=10.0)\nif rank == 1:\n    fails(None)\nsolve(problem, load=10.0)",
        "Listener.start = fails\nContactSolver(problem, listeners=[Listener()] * rank).solve(load=10.0)",
        "with ContactSolver(problem) as solver:\n    solve(problem, load=5.0, comm=MPI.COMM_SELF)\n"
        "    if rank == 1:\n        fails(None)\n    solver.solve(load=10.0)",
    ],
    ids=["in the solver", "between two solves", "in a listener", "after a solve of its own"],
)
def test_an_exception_on_one_rank_ends_all(ranks, where, tmp_path):
    program = tmp_path / "program.py"
    program.write_text(FAILING + where + "\nprint('not reached')\n")
    done = run(program, ranks=ranks, timeout=30)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("Traceback") == 1
    [line] = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert line.startswith("error: rank 1: ")
    assert line.endswith("; all ranks are ended")


@pytest.mark.ranks(2)
def test_an_exception_that_is_caught_or_concerns_no_other_rank_ends_nobody(ranks, tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        FAILING
        + """
mpi_abort.TIMEOUT = 0.1
Circulant.precondition = fails
with ContactSolver(problem, options=shared) as solver:
    try:
        solver.solve(load=10.0)
    except MemoryError:
        Circulant.precondition = sound
found = solve(problem, load=10.0, options=shared)
try:
    with ContactSolver(problem, options=shared):
        fails(None)
except MemoryError:
    pass
alone = solve(problem, load=10.0, comm=MPI.COMM_SELF)
assert abs(found.approach - alone.approach) < 1e-5 * alone.approach
if rank == 1:
    fails(None)
time.sleep(1)
print("done")
"""
    )
    done = run(program, ranks=ranks, timeout=30)
    assert (done.returncode, done.stdout) == (1, "done\n"), done.stderr
    assert "MPI_ABORT" not in done.stderr
    assert "error: " not in done.stderr
