"""Unloading with a hardness: laws of the residual surface and of load paths that go down."""

from dataclasses import replace

import numpy as np
import pytest
from cases import hertz, periodic_rough, self_affine

from app import ContactProblem, ContactSolver, Grid, Listener, Material, read_result
from app.api.load_path import _slopes
from app.base.errors import InputError
from app.problems.problem import Problem

TIGHT = {"lcp_rtol": 1e-11, "lcp_precision": "double"}
LOADS = [4e4, 9e4, 6e4, 1e3, 0.0, 7e4, 9e4, 1.2e5]


def capped(n=32):
    """Hertz's problem with a hardness far below its largest pressure."""
    return replace(hertz(n), hardness=1000.0)


def rough():
    return replace(self_affine(32), hardness=2000.0)


def load(problem):
    """Return a load that makes a part of the contact plastic."""
    return 0.15 * problem.hardness * problem.grid.area


@pytest.mark.parametrize("make", [capped, rough])
def test_unloading_is_elastic(make):
    problem = make()
    with ContactSolver(problem, options=TIGHT) as solver:
        loaded = solver.solve(load=load(problem))
        solver.update(replace(problem, surfaces=(loaded.residual_surface(),)))
        approaches = np.linspace(loaded.approach, solver.touching, 6)
        steps = [solver.solve(approach=approach) for approach in approaches]
        apart = solver.solve(approach=solver.touching - 1e-6)
    tolerance = 1e-6 * problem.hardness
    assert all((step.pressure <= loaded.pressure + tolerance).all() for step in steps)
    assert (np.diff([step.load for step in steps]) < 0).all() and steps[-1].load == 0
    assert (apart.gap > 0).all() and not apart.contact.any()
    volumes = [step.plastic_volume for step in (loaded, *steps, apart)]
    assert volumes == pytest.approx([loaded.plastic_volume] * len(volumes), rel=1e-8)
    assert steps[-1].indentation > 0  # counted from the first touch of the bodies before the load


def test_gap_minus_plastic_depth_is_the_deformed_distance(tmp_path):
    problem = capped()
    with ContactSolver(problem) as solver:
        loaded, *others = list(solver.path(load=[9e4, 6e4, 0.0]))
    for solution in loaded, *others:
        e = problem.shape_on(problem.grid) - solution.approach + solution.displacement
        np.testing.assert_allclose(solution.gap - solution.plastic_depth, e, atol=1e-12)
        assert solution.gap[solution.plastic].max(initial=0) == 0 <= solution.plastic_depth.min()
        assert solution.mean_gap == pytest.approx(np.maximum(solution.gap, 0).mean(), rel=1e-5)
        assert solution.mean_plastic_depth == pytest.approx(solution.plastic_depth.mean(), rel=1e-12)
        np.testing.assert_array_equal(solution.plastic_depth > 0, loaded.plastic_depth > 0)
        assert "surfaces" not in solution.attributes  # a residual surface is no roughness
        assert ("indented by earlier loads" in solution.summary()) == (solution is not loaded)
        assert (loaded.pressure == problem.hardness)[solution.plastic_depth > 0].all()


def test_a_path_goes_on_after_unloading_as_if_there_had_been_none():
    with ContactSolver(capped()) as solver:
        path, direct = solver.path(load=LOADS), solver.path(load=[4e4, 9e4, 1.2e5])
        steps, loaded = list(path), list(direct)
    for step, other in (1, 1), (6, 1), (7, 2):
        np.testing.assert_array_equal(steps[step].pressure, loaded[other].pressure)
        np.testing.assert_array_equal(steps[step].plastic_depth, loaded[other].plastic_depth)
    table = path.table
    grows = np.diff(table["plastic_volume"]) > 1e-12
    assert list(np.flatnonzero(grows)) == [0, 6] and (np.diff(table["plastic_volume"]) > -1e-12).all()
    assert (table["plastic_area"][[2, 3, 4, 5]] == 0).all()
    assert table["indentation"][4] > 0 == table["load"][4]


def test_a_path_without_hardness_forgets_its_loads():
    with ContactSolver(hertz(32)) as solver:
        path = list(solver.path(load=[9e4, 4e4]))
        np.testing.assert_array_equal(path[1].pressure, solver.solve(load=4e4).pressure)
        assert path[0].plastic is path[0].plastic_depth is None
        assert path[0].plastic_volume == 0 and "plastic_volume" not in path[0].attributes
        with pytest.raises(InputError, match="the problem has no hardness"):
            path[0].residual_surface()


def test_a_result_file_has_the_residual_surface_of_its_solution(tmp_path):
    with ContactSolver(capped()) as solver, ContactSolver(hertz(32)) as elastic:
        *_, unloaded = solver.path(load=[9e4, 4e4])
        unloaded.save(tmp_path / "unloaded.h5")
        elastic.solve(load=4e4).save(tmp_path / "elastic.h5")
    depth = read_result(tmp_path / "unloaded.h5").residual_surface().depth
    np.testing.assert_array_equal(depth, unloaded.residual_surface().depth)
    with pytest.raises(InputError, match="the problem has no hardness"):
        read_result(tmp_path / "elastic.h5").residual_surface()


@pytest.mark.parametrize("steps", [1, 2, 3, 6])
def test_a_resumed_path_has_the_same_rows(steps):
    with ContactSolver(capped()) as solver:
        whole = solver.path(load=LOADS)
        solutions = list(whole)
        resumed = solver.path(load=LOADS, rows=whole.rows[:steps])
        for solution, other in zip(resumed, solutions[steps:], strict=True):
            np.testing.assert_array_equal(solution.gap, other.gap)
    for name, column in whole.table.items():
        np.testing.assert_array_equal(resumed.table[name], column)


def test_mean_gaps_of_a_path_are_means_of_e():
    gaps = [0.004, 0.0015, 0.003, 0.0015, 0.001, -0.002, -0.0019, -0.003]
    with ContactSolver(replace(periodic_rough(32), hardness=3000.0)) as solver:
        path = solver.path(mean_gap=gaps)
        steps = list(path)
        resumed = solver.path(mean_gap=gaps, rows=path.rows[:2])
        assert next(iter(resumed)).load == steps[2].load < steps[1].load == steps[3].load < steps[4].load
    assert steps[7].load > steps[5].load > steps[6].load > 0  # unloading from negative gaps, too
    table = path.table
    assert table["mean_gap"] - table["mean_plastic_depth"] == pytest.approx(gaps, rel=1e-12)
    for step in steps:
        assert step.mean_gap == pytest.approx(step.gap.clip(min=0).mean(), rel=1e-4)


def test_after_each_step_the_solver_has_its_own_problem():
    class Interruption(Listener):
        armed = False

        def iteration(self, entry, state):
            if self.armed:
                self.armed = False
                raise KeyboardInterrupt

    listener, problem = Interruption(), capped()
    with ContactSolver(problem, listeners=[listener]) as solver:
        before, path = solver.solve(load=5e4), solver.path(load=[9e4, 5e4, 4e4])
        next(iter(path))
        next(iter(path))
        for listener.armed in False, True:
            if listener.armed:
                with pytest.raises(KeyboardInterrupt):
                    next(iter(path))
            assert solver.problem is problem
            np.testing.assert_array_equal(solver.solve(load=5e4).pressure, before.pressure)
        last = list(solver.path(load=[9e4, 4e4]))[-1]
        np.testing.assert_array_equal(next(iter(path)).pressure, last.pressure)


def test_own_problems_can_unload():
    grid = hertz(32).grid

    class Bowl(Problem):
        name, hardness = "bowl", 1000.0

        def shape_on(self, grid, rows=slice(None)):
            return hertz(32).shape_on(grid, rows)

    with ContactSolver(Bowl(grid, hertz(32).material)) as solver:
        own = list(solver.path(load=[9e4, 5e4]))
    problem = ContactProblem(grid, hertz(32).material, hertz(32).shape_on(grid), hardness=1000.0)
    with ContactSolver(problem) as solver:
        given = list(solver.path(load=[9e4, 5e4]))
    assert own[1].max_pressure < 1000 and own[1].approach == pytest.approx(given[1].approach, rel=1e-4)


@pytest.mark.parametrize("hardness", [1e6, np.inf])
def test_bodies_without_indentation_unload_on_the_same_curve(hardness):
    class Bowl(Problem):
        def shape_on(self, grid, rows=slice(None)):
            return hertz(32).shape_on(grid, rows)

    Bowl.hardness = hardness
    with ContactSolver(Bowl(hertz(32).grid, hertz(32).material)) as solver:
        up, down = list(solver.path(load=[4e4, 9e4])), list(solver.path(load=[9e4, 4e4]))
    np.testing.assert_array_equal(up[0].pressure, down[1].pressure)


def test_stiffness_by_differences_is_that_of_its_branch():
    """A load of 2 is met at three approaches: while loading, unloading and loading again."""
    load = np.array([1.0, 2.0, 3.0, 2.0, 1.0, 2.0, 3.0, 4.0])
    approach = np.array([1.0, 2.0, 3.0, 2.8, 2.6, 2.8, 3.0, 4.0])
    slopes = _slopes({"load": load, "approach": approach, "plastic_volume": np.zeros(8)})
    assert slopes == pytest.approx([1, 1, 1, 5, 5, 5, 1, 1])


def random_problem(seed):
    """Rough body with holes, and a hardness that is infinite in some cells; free or periodic."""
    rng = np.random.default_rng(seed)
    grid = Grid.from_domain(*map(int, rng.integers(4, 16, 2)), (0, 1, 0, 1))
    gap = 1e-2 * rng.random(grid.shape)
    gap[rng.random(grid.shape) < 0.1] = np.nan
    hardness = np.where(rng.random(grid.shape) < 0.2, np.inf, rng.uniform(2, 4, grid.shape))
    material = Material.from_contact_modulus(1000.0)
    return ContactProblem(grid, material, gap, periodic=bool(seed % 2), hardness=hardness)


@pytest.mark.parametrize("seed", range(12))
def test_laws_of_unloading_hold_for_random_bodies(seed):
    problem, loads = random_problem(seed), np.array([0.5, 1.0, 0.6, 0.2, 0.0, 0.8, 1.0, 1.3])
    with ContactSolver(problem, options=TIGHT) as solver:
        path = solver.path(load=loads)
        steps = list(path)
        solver.update(replace(problem, surfaces=[steps[1].residual_surface()]))
        again = solver.solve(load=1.0)
    tolerance = 1e-4 * steps[1].max_pressure
    assert path.converged and steps[1].plastic.any()
    assert again.pressure == pytest.approx(steps[1].pressure, abs=tolerance)
    for step in steps[2:6]:
        assert (step.pressure <= np.minimum(steps[1].pressure, problem.hardness) + tolerance).all()
        np.testing.assert_array_equal(step.plastic_depth, steps[1].plastic_depth)
    assert (np.diff(path.table["approach"][1:5]) < 0).all()
    assert (steps[7].plastic_depth >= steps[1].plastic_depth - 1e-7).all()
