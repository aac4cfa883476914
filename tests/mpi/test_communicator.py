"""Rows that change place, ranks that have no part in a grid, and how often a solve talks."""

import numpy as np
import pytest
from cases import APPROACH, hertz, punch
from mpi4py import MPI
from running import assert_proved_equal, solve

from app import ContactSolver
from app.base.petsc import _counter
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.grid import Grid
from app.methods.multilevel_operators import multilevel_influence
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import temporary_options
from app.parallel.communicator import Communicator
from app.parallel.fetch import Fetch
from app.parallel.rank_groups import RankGroups
from app.parallel.reductions import minimum_over, sums_and_minima
from app.parallel.slabs import Slabs
from benchmarks.replay import Replay, record
from benchmarks.replay import hertz as recorded_problem


@pytest.mark.mpi(1, 2, 3, 5)
@pytest.mark.parametrize("dtype", [float, np.float32, bool])
def test_every_rank_gets_the_rows_it_wants(comm, dtype):
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


@pytest.mark.mpi(3, 5)
def test_first_ranks_have_a_communicator_and_others_do_not(comm):
    ranks = RankGroups(comm, 8)
    slabs, few = ranks.distribute(Grid(4, 5, 1.0, 1.0))  # 20 cells on 2 ranks
    assert slabs.size == 2
    assert (few is None) == (comm.rank >= 2)
    assert comm.allreduce(slabs.local) == 5
    assert few is None or (few.size, few.rank, few.allreduce(slabs.local)) == (2, comm.rank, 5)
    assert ranks.distribute(Grid(4, 4, 1.0, 1.0))[1] is few  # made once
    ranks.destroy()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(("n", "levels"), [(48, 0), (192, 1), (324, 2)])
@pytest.mark.parametrize("by_levels", [False, True])
@pytest.mark.parametrize("scattered", [False, True])
def test_a_step_of_conjugate_gradients_costs_two_reductions_and_four_exchanges(
    comm, n, levels, shared, by_levels, scattered
):
    """And two exchanges of rows with neighbours for the extension over the rim, two for each level with a stencil.

    Means over blocks, where contact is scattered, are summed with CG's own numbers.

    The largest grid's product, if it is not by levels, is one in a box, whose images take a reduction of their own. In
    memory that ranks share an exchange sends nothing.
    """
    counted = Communicator(comm)
    counted.shares_memory = shared
    hierarchy = Hierarchy(hertz(n).grid, 1.0, counted, cells_per_rank=10**6, dtype=np.float32)
    operator, traffic = hierarchy.target, hierarchy.comm.traffic
    counts = {}
    options = {
        "ksp_type": "python",
        "ksp_python_type": "app.methods.free.tracking_cg.TrackingCG",
        "ksp_norm_type": "unpreconditioned",
        "ksp_rtol": "1e-14",
        "pc_type": "python",
        "pc_python_type": "app.methods.free.circulant.Circulant",
        "pc_circulant_extend": "3",
        "pc_circulant_blocks": "16" if scattered else "0",
    }
    for steps in (1, 3):  # so few that the norm needs no summing anew
        with temporary_options("", {}, options | {"ksp_max_it": str(steps)}):
            solver = LinearSolver(hierarchy)
        nearly = multilevel_influence(operator) if by_levels else None
        if nearly is not None:
            solver.ksp.getPythonContext().multiply = nearly.apply
        b = solver.mat.createVecRight()
        operator.mask[...] = True
        operator.mask[:, 40:] = False
        if scattered:
            operator.mask[...] = np.logical_and.outer(*(np.arange(m) % 24 < 12 for m in operator.mask.shape))
        solver.set_contact()
        b.setArray(operator.mask.reshape(-1).astype(float))
        before = traffic.copy()
        _, iterations, failure = solver.solve(b, 0.0)
        assert (iterations, failure) == (steps, "")
        counts[steps] = traffic.since(before)
        b.destroy()
        solver.destroy()
    step = counts[3].since(counts[1])
    neighbours = 2 - (comm.rank == 0) - (comm.rank == comm.size - 1)
    in_box = levels == 2 and nearly is None
    assert step.small_collectives == 2 * (2 + in_box)
    assert step.all_to_alls == 2 * 4
    sent = 0 if shared else 4 * (comm.size - 1)
    exchanges = 2 + 2 * levels * (1 + (nearly is not None))
    assert step.messages == 2 * (sent + exchanges * neighbours)
    hierarchy.destroy()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("problem", [hertz(160), punch(160)], ids=["hertz", "punch"])
def test_a_solve_talks_as_often_as_the_model_says(comm, problem, monkeypatch):
    """The model of docs/notebook/scaling.md; a second solve makes no spectra, a third does the same."""
    products, spectra = [], []
    apply, set_kernel = EvenMultiplier.apply, EvenMultiplier.set_kernel
    monkeypatch.setattr(
        EvenMultiplier, "apply", lambda self, *a, **k: (products.append(self.comm), apply(self, *a, **k))[1]
    )
    monkeypatch.setattr(
        EvenMultiplier, "set_kernel", lambda self, *a: (spectra.append(self.comm), set_kernel(self, *a))[1]
    )
    with ContactSolver(problem, "fast", {"lcp_cells_per_rank": 512}) as solver:
        products.clear()
        spectra.clear()
        logged = _counter("petsc_isend_ct").value
        first = solver.solve(approach=0.1)
        logged = _counter("petsc_isend_ct").value - logged
        shared = [sum(used is not None for used in made) for made in (products, spectra)]
        again = solver.solve(approach=0.1).traffic
        assert 0 < again.messages < first.traffic.messages
        assert solver.solve(approach=0.1).traffic == again
    traffic, levels = first.traffic, len(set(first.history["level"]))
    steps, sets = sum(first.history["inner_iterations"]), len(first.history["level"])
    if comm.rank == 0:
        assert logged == traffic.messages  # as -log_view tells
        assert traffic.all_to_alls == 2 * shared[0] + shared[1]
    assert traffic.small_collectives <= 2 * steps + 3 * sets + 6 * levels + 10
    assert first.attributes["all_to_alls"] == traffic.all_to_alls > 0


@pytest.mark.mpi(8)
@pytest.mark.parametrize("method", ["fast", "fmg_v11"])
def test_many_ranks_of_which_small_grids_have_few(comm, method):
    options = {"lcp_cells_per_rank": 64, "lcp_rtol": 1e-9, "lcp_precision": "double"}
    if method != "fast":
        del options["lcp_precision"]
    here = solve(hertz(64), APPROACH, method, **options)
    pressure = np.vstack(comm.allgather(here.pressure))
    assert here.converged
    if comm.rank == 0:
        alone = solve(hertz(64), APPROACH, method, comm=MPI.COMM_SELF, **options)
        assert here.iterations == alone.iterations
        np.testing.assert_allclose(pressure, alone.pressure, rtol=0, atol=1e-8 * alone.max_pressure)


@pytest.mark.slow
@pytest.mark.mpi(16)
def test_sixteen_ranks(comm):
    here = solve(hertz(64), APPROACH, "fast", lcp_cells_per_rank=64)
    assert here.converged
    assert min(comm.allgather(here.slabs.local)) == max(comm.allgather(here.slabs.local)) == 4


@pytest.mark.mpi(2)
def test_a_communicator_counts_what_is_sent(comm):
    counted = Communicator(comm)
    rows = np.ones((3, 4), np.float32)
    request = counted.Isend(rows, 1 - comm.rank)
    counted.Recv(np.empty_like(rows), 1 - comm.rank)
    request.Wait()
    counted.Alltoallv([np.ones(2), [1, 1]], [np.empty(2), [1, 1]])
    assert counted.allreduce(1) == 2
    found = counted.traffic
    assert (found.messages, found.all_to_alls, found.small_collectives) == (3, 1, 1)
    assert found.message_bytes == rows.nbytes + 2 * 8


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("cells", [3000, 9000, 20000])
def test_windows_of_grids_that_some_ranks_have_no_part_in(comm, cells):
    here = solve(hertz(160), APPROACH, "fast", lcp_cells_per_rank=cells)
    alone = solve(hertz(160), APPROACH, "fast", comm=MPI.COMM_SELF)
    assert here.converged
    assert here.iterations == alone.iterations
    whole = here.gather()
    if comm.rank == 0:
        assert_proved_equal(whole, alone)


@pytest.mark.mpi(1, 2, 3)
def test_sums_and_minima_by_one_reduction(comm):
    counted = Communicator(comm)
    for size in (0, 1, 5):  # of either
        ours = np.arange(size) + 10.0 * comm.rank
        sums, lowest = sums_and_minima(counted, ours, -ours)
        np.testing.assert_array_equal(
            sums, np.sum([np.arange(size) + 10 * r for r in range(comm.size)], axis=0)
        )
        np.testing.assert_array_equal(lowest, -(np.arange(size) + 10 * (comm.size - 1)))
    assert counted.traffic.small_collectives == 3


@pytest.mark.mpi(2, 3)
def test_a_replay_sends_what_ranks_send(comm):
    """From a record of two ranks that share all grids, for any number of ranks and cells on a rank."""
    first_two = comm.Split(comm.rank < 2, comm.rank)
    recorded = comm.bcast(record(160, first_two) if comm.rank < 2 else None)
    first_two.Free()
    problem, approach = recorded_problem(160)
    for cells in (512, 4000):
        options = {"lcp_cells_per_rank": cells, "lcp_shared_memory": "false"}
        with ContactSolver(problem, "fast", options, comm) as solver:
            real = solver.solve(approach=approach).traffic
        replayed = Replay(recorded, comm.size, cells=cells).traffic
        assert (replayed.messages, replayed.all_to_alls) == (real.messages, real.all_to_alls)
        assert replayed.message_bytes == pytest.approx(real.message_bytes, rel=0.02)
        # The loading is compared before a solve counts. After it the rest is broadcast, and unused options are found.
        assert replayed.small_collectives == real.small_collectives + 3


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("last", [False, True])
def test_minima_know_what_is_no_number(comm, last):
    """MPI.MIN tells NaN or not, depending on which rank has it."""
    here = comm.rank == (comm.size - 1 if last else 0)
    found = minimum_over(comm, [[comm.rank, np.nan if here else 1.0]])
    np.testing.assert_array_equal(found, [[0.0, np.nan]])
