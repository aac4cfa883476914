"""Solvers on all ranks, on some of them, and what every rank hears of bad input."""

import gc
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough, punch
from mpi4py import MPI
from running import solve

from app import ContactProblem, ContactSolver, Grid, Listener, Material, Sphere, read_result, refine
from app.base.errors import InputError, OtherRankError

TIGHT = {"lcp_rtol": 1e-9, "lcp_cells_per_rank": 32}


def whole(solution):
    """Pressure of all rows, on every rank of the solution."""
    return np.vstack(solution.comm.allgather(solution.pressure))


def assert_close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * expected.max())


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("method", ["fast", "norm", "fmg_v11"])
def test_solvers_on_parts_of_the_ranks(comm, method):
    """One rank solves one problem while the others solve another; then all solve together."""
    mine = comm.Split(color=min(comm.rank, 1), key=comm.rank)
    problem, approach = (hertz(48), APPROACH) if comm.rank == 0 else (punch(48), 0.1)
    with (
        ContactSolver(problem, method, TIGHT, mine) as solver,
        ContactSolver(hertz(40), method, TIGHT) as all_of_us,
    ):
        first = solver.solve(approach=approach)
        together = all_of_us.solve(approach=APPROACH)
        for _ in range(min(comm.rank, 1)):  # as often as each part likes
            again = solver.solve(load=first.load)
            assert again.approach == pytest.approx(approach, rel=1e-6)
    assert first.comm.size == (1 if comm.rank == 0 else comm.size - 1)
    assert first.converged and together.converged
    assert_close(whole(first), solve(problem, approach, method, comm=MPI.COMM_SELF, **TIGHT).pressure)
    assert_close(whole(together), solve(hertz(40), APPROACH, method, comm=MPI.COMM_SELF, **TIGHT).pressure)
    mine.Free()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("method", ["fast", "fmg_v11"])
def test_an_updated_solver(comm, method):
    gap = punch(40).shape_on(punch(40).grid)
    gap[18:22, 18:22] = np.nan
    other = ContactProblem(punch(40).grid, punch(40).material, gap)
    with ContactSolver(punch(40), method, TIGHT, comm) as solver:
        before = solver.solve(approach=0.1)
        with pytest.raises(InputError, match="grid, material and surface compliance"):
            solver.update(hertz(40))
        solver.update(other)
        found = [solver.solve(approach=0.1), solver.solve(approach=0.1, start=before)]
    expected = solve(other, 0.1, method, comm=MPI.COMM_SELF, **TIGHT).pressure
    for solution in found:
        assert solution.converged
        assert_close(whole(solution), expected)


@pytest.mark.mpi(2, 3)
def test_communicators_come_back(comm):
    def lowest():
        fresh = comm.Dup()
        number = fresh.py2f()
        fresh.Free()
        return comm.allreduce(number, MPI.MAX)

    def use(times):
        for k in range(times):
            solver = ContactSolver(hertz(24), ("fast", "norm", "fmg_v11")[k % 3], TIGHT)
            solver.solve(approach=APPROACH)
            solver.close()
        gc.collect()
        return lowest()

    few = use(3)
    assert use(30) <= few + 1  # not one for each


@pytest.mark.mpi(2, 3)
def test_a_start_of_other_ranks_is_refused_on_all(comm):
    own = solve(hertz(24), APPROACH, comm=MPI.COMM_SELF)
    with ContactSolver(hertz(24)) as solver, pytest.raises(InputError, match="as many ranks"):
        solver.solve(approach=APPROACH, start=own)


@pytest.mark.mpi(2, 3)
def test_arguments_that_differ_between_ranks_are_refused_on_all(comm):
    with ContactSolver(hertz(24)) as solver:
        found = solver.solve(approach=APPROACH)
        with pytest.raises(InputError, match="start: not the same"):
            solver.solve(approach=APPROACH, start=found.gather())
        for numbers in ([1.0] * (1 + comm.rank), None if comm.rank else [1.0]):
            with pytest.raises(InputError, match="path: .*(not the same|exactly one)"):
                solver.path(load=numbers)
        assert solver.solve(approach=APPROACH).converged
    few = comm.Split(0 if comm.rank else MPI.UNDEFINED)
    if comm.rank:
        assert solve(hertz(8), APPROACH, comm=few).converged
        few.Free()
    else:
        with pytest.raises(InputError, match="none of its ranks"):
            solve(hertz(8), APPROACH, comm=few)


class Fails(Listener):
    """Fails on the ranks of one grid, at the end of its last iteration so far."""

    def __init__(self, grid, error):
        self.grid, self.error = grid, error

    def iteration(self, entry, state):
        if entry["level"] == self.grid:
            raise self.error("this one")


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("error", [RuntimeError, InputError])
@pytest.mark.parametrize("method", ["fast", "fmg_v11", "primal"])
def test_what_fails_on_a_grid_of_some_ranks_is_heard_by_those_who_wait(comm, method, error):
    if method == "primal":
        problem, method, prescribed = periodic_rough(64), None, {"load": 100.0}
    else:
        problem, prescribed = hertz(64), {"approach": APPROACH}
    with ContactSolver(problem, method, TIGHT, comm) as solver:
        before = solver.solve(**prescribed)
        told = set()
        for grid in sorted(set(before.history["level"])):
            failure = Fails(grid, error)
            solver.listeners.append(failure)
            with pytest.raises((error, OtherRankError), match="this one") as caught:
                solver.solve(**prescribed)
            solver.listeners.remove(failure)
            told |= set(comm.allgather(caught.type))
            again = solver.solve(**prescribed)
            assert again.max_pressure == pytest.approx(before.max_pressure, rel=1e-6)
    assert told == ({InputError} if error is InputError else {error, OtherRankError})


class NoPickles(MPI.Intracomm):
    """A communicator whose pickles are too large, as those of fields above 2 GiB are."""

    def gather(self, *arguments):
        raise SystemError("Negative size")


@pytest.mark.mpi(1, 2, 3)
def test_gathered_and_saved(comm, tmp_path):
    found = solve(punch(40, 36), 0.1, "fast")
    assert found.pressure.shape == (found.slabs.local, 40)
    gathered = replace(found, comm=NoPickles(comm)).gather()
    found.save(tmp_path / "found.h5")
    rows = comm.allgather(found.slabs.rows)
    if comm.rank:
        assert gathered is None
        return
    assert gathered.pressure.shape == gathered.gap.shape == gathered.contact.shape == (36, 40)
    np.testing.assert_array_equal(gathered.pressure[rows[0]], found.pressure)
    np.testing.assert_array_equal(gathered.gap[rows[0]], found.gap)
    assert (gathered.load, gathered.contact_cells) == (found.load, gathered.contact.sum())
    np.testing.assert_array_equal(gathered.y, gathered.grid.y())
    saved = read_result(tmp_path / "found.h5")
    np.testing.assert_array_equal(saved.pressure, gathered.pressure)
    assert saved.attributes["ranks"] == comm.size


def refusals(comm):
    """What cannot be done, the same on every rank or on the last one only."""
    last = comm.rank == comm.size - 1
    bad = np.zeros((8, 8))
    if last:
        bad[-1, -1] = np.inf

    def gap(x, y):
        if last:
            raise ValueError("this rank\ncannot")
        return x**2 + y**2

    grid, steel = Grid(8, 8, 1.0, 1.0), Material.combined(80000, 0.3)
    yield "exactly one", lambda: solve(hertz(8), None)
    yield "a number", lambda: solve(hertz(8), np.nan)
    yield "at least 0 N", lambda: solve(hertz(8), None, "fast", -1.0)
    yield "must be one of", lambda: solve(hertz(8), 0.1, "faster")
    yield "lcp_rtool", lambda: solve(hertz(8), 0.1, lcp_rtool=1e-3)
    yield "no effect", lambda: solve(hertz(8), 0.1, lcp_predictor=1.0)
    yield "ksp_rtoll", lambda: solve(hertz(8), 0.1, ksp_rtoll=1e-3)
    yield "this rank cannot", lambda: solve(ContactProblem(grid, steel, gap), 0.1)
    yield "a ContactProblem", lambda: solve(None if last else hertz(8), 0.1)
    yield "a mapping", lambda: ContactSolver(hertz(8), options=["lcp_rtol"] if last else None)
    yield "impossible in all cells", lambda: solve(ContactProblem(grid, steel, np.full((8, 8), np.nan)), 0.1)


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize("number", range(11))
def test_a_refusal_on_one_rank_is_an_error_on_all(comm, number):
    message, action = list(refusals(comm))[number]
    with pytest.raises(InputError, match=message):
        action()
    assert solve(hertz(8), APPROACH).converged  # no rank is left waiting


@pytest.mark.mpi(2)
@pytest.mark.parametrize(
    "other", [{"dx": 2.0}, {"periodic": "spectral"}, {"nx": 9}, {"shear_modulus": 70000.0}], ids=str
)
def test_problems_that_differ_between_ranks_are_refused(comm, other):
    grid, material = Grid(8, 8, 1.0, 1.0), Material.combined(80000, 0.3)
    if comm.rank:
        material = replace(material, **other) if "shear_modulus" in other else material
        grid = grid if "shear_modulus" in other else replace(grid, **other)
    problem = ContactProblem(grid, material, lambda x, y: x**2 + y**2)
    with pytest.raises(InputError, match="not the same on all ranks"):
        ContactSolver(problem)


@pytest.mark.mpi(2, 3)
def test_random_distances_without_a_seed_are_refused(comm):
    """They are others on every rank, and a patchwork of them would be solved."""
    first = hertz(8)

    def own(gap):
        return ContactProblem(first.grid, first.material, gap)

    gap, phase = np.random.default_rng(comm.rank).random((2, 8, 8))
    last_bits = 1e6 + np.random.default_rng(1).random((8, 8)) + 1e-9 * gap
    with ContactSolver(own(last_bits)) as solver:
        turned = np.random.default_rng(2).random((8, 8))
        turned = turned[:, :: -1 if comm.rank else 1]
        shifted = np.roll(turned if comm.rank == 0 else turned[:, ::-1], comm.rank, axis=1)
        for others in (
            gap,
            np.where(gap < 0.3, np.nan, 0.1),
            lambda x, y: x**2 + np.cos(x + phase[0, 0]),
            turned,
            shifted,
            lambda x, y: x**2 + (1 + comm.rank) * (y - first.grid.y().mean()) ** 2,
        ):
            with pytest.raises(InputError, match="not the same on all ranks; .* seed"):
                solve(own(others), 0.1)
            with pytest.raises(InputError, match="not the same on all ranks; .* seed"):
                solver.update(own(others))
        assert solver.solve(approach=1e6 + 0.1).converged


@pytest.mark.mpi(2, 3)
def test_a_start_is_the_same_on_all_ranks(comm):
    with ContactSolver(hertz(16)) as solver:
        starts = [solver.solve(load=load) for load in (5000.0, 8000.0)]
        for different in (
            starts[comm.rank % 2],
            None if comm.rank else starts[0],
            starts[0] if comm.rank else "x",
        ):
            with pytest.raises(InputError, match="loading or start: not the same on all ranks"):
                solver.solve(load=6000.0, start=different)
        assert solver.solve(load=6000.0, start=starts[0]).converged


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize(
    "other",
    [
        {"until": -1},
        {"until": 0.2},
        {"most_cells": 300},
        {"stiffness": True},
        {"options": 3},
        {"comm": "all"},
    ],
    ids=str,
)
def test_grids_are_refined_by_all_ranks_alike(comm, other):
    ball = ContactProblem(Grid.from_domain(8, 8, (-1, 1, -1, 1)), Material.combined(80000, 0.3), Sphere(10.0))
    refused = comm.size > 1 or not {"options", "comm"}.isdisjoint(other) or other.get("until") == -1
    if other == {"comm": "all"} and comm.size > 1:
        return  # who has no communicator cannot be waited for
    given = {"until": 0.3, "most_cells": 1000, "load": 100.0} | (other if comm.rank == comm.size - 1 else {})
    with pytest.raises(InputError, match="refine|options|comm") if refused else nullcontext():
        refine(ball, **given)


@pytest.mark.mpi(2, 3)
def test_what_is_saved_or_told_is_the_same_on_all_ranks(comm, tmp_path):
    last = comm.rank == comm.size - 1
    path = comm.bcast(tmp_path / "s.h5")
    found = solve(hertz(24), APPROACH)
    wear = np.arange(24.0 * 24).reshape(24, 24)
    for given, message in (
        ({"load" if last else "wear": wear}, "not the same on all ranks"),
        ({"load": wear}, "load exists already"),
        ({} if last else {"contact_patches": 1, "largest_patch": 1.0}, "not the same on all ranks"),
        ({"wear": wear} if last else {"wear": 1.0}, "not the same on all ranks"),
        ({"wear": wear if last else wear.astype(int)}, "types of fields: not the same on all ranks"),
        ({"wear": np.zeros(10**4)}, "must be an array of the cells, or less than 64 KB"),
    ):
        with pytest.raises(InputError, match=message):
            found.save(path, **given)
    for name, rows in (("all", wear), ("here", wear[found.slabs.rows])):
        found.save(path, wear=rows, kind=name)
        read = read_result(path)
        np.testing.assert_array_equal(read.extra["wear"], wear)
        assert read.attributes["kind"] == name
        comm.Barrier()
    found.save(path, comment="x" * 100_000)  # it is arrays that HDF5 wants to be small
    assert len(read_result(path).attributes["comment"]) == 100_000
    comm.Barrier()
    for given in (("foo" if last else "gap",), ("gap" if last else "pressure",), ("gap", 10 + last)):
        with pytest.raises(InputError, match="distribution"):
            found.distribution(*given)
    edges, density = found.distribution("gap", 10)
    assert density @ np.diff(edges) == pytest.approx(1)


@pytest.mark.mpi(1, 3)
@pytest.mark.parametrize("method", ["norm", "mg_v10"])
def test_the_grid_to_begin_with_does_not_depend_on_the_ranks(comm, method):
    """Small grids may be shared, too: then they are not solved directly, but are the same."""
    options = {"lcp_cells_per_rank": 16, "lcp_rtol": 1e-9}
    found, alone = (
        solve(hertz(48), None, method, load=2e4, comm=one, **options) for one in (comm, MPI.COMM_SELF)
    )
    assert found.iterations == alone.iterations
    assert set(found.history["level"]) == set(alone.history["level"])
    assert_close(whole(found), alone.pressure)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("cells", [8, 4])
def test_a_function_that_fails_on_one_rank_fails_on_all(comm, cells):
    """On the grid asked for, or on a coarser one."""
    fails = comm.rank == 0  # which has a part in all grids

    def gap(x, y):
        if fails and x.size == cells:
            raise KeyError("a mistake")
        return x**2 + y**2

    problem = ContactProblem(Grid(8, 8, 1.0, 1.0), Material.combined(80000, 0.3), gap)
    with pytest.raises(KeyError if fails else RuntimeError, match="a mistake"):
        solve(problem, 0.1, "fast")
    assert solve(hertz(8), APPROACH).converged
