"""Messages of a replayed solve."""

import pytest

from app import ContactSolver
from benchmarks.replay import Replay, record
from benchmarks.replay import hertz as recorded_problem


@pytest.mark.mpi(2, 3)
def test_replay_sends_as_many_messages_as_a_solve(comm):
    """From a record of two ranks that share all grids, for any number of ranks and cells on a rank."""
    first_two = comm.Split(comm.rank < 2, comm.rank)
    recorded = comm.bcast(record(160, first_two) if comm.rank < 2 else None)
    first_two.Free()
    problem, approach = recorded_problem(160)
    for cells in (512, 4000):
        options = {"lcp_cells_per_rank": cells, "lcp_shared_memory": "false"}
        with ContactSolver(problem, "fast", options, comm) as solver:
            before = solver.comm.traffic.copy()
            real = solver.solve(approach=approach).traffic
            ours = comm.bcast(solver.comm.traffic.since(before).small_collectives)
        replayed = Replay(recorded, comm.size, cells=cells).traffic
        assert (replayed.messages, replayed.all_to_alls) == (real.messages, real.all_to_alls)
        assert replayed.message_bytes == pytest.approx(real.message_bytes, rel=0.02)
        assert replayed.small_collectives == ours  # without PETSc's own
