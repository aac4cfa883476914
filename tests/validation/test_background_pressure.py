"""A background pressure: p - p0 solves the problem with the distance h + A p0 and the hardness H - p0."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, read_result
from app.base.mpi import MPI
from app.verification.dense import DenseProblem
from app.verification.solving import solved

STEEL = Material.combined(80000, 0.3)
COATED = Material.coated((4e5, 2e5), (0.2, 0.3), 0.1)


def random_problem(seed, periodic=None, material=STEEL, hardness=None, grid=None):
    """Return a rough problem with a background pressure, and the problem of the contact alone."""
    rng = np.random.default_rng(seed)
    grid = grid or Grid.from_domain(9, 7, (-1, 1, -0.5, 1.0))
    gap, background = 0.001 * rng.random(grid.shape), rng.choice([300.0, 20.0])
    if rng.random() < 0.5:
        background = background * rng.random(grid.shape)
    if rng.random() < 0.3 and not periodic:
        gap[rng.random(gap.shape) < 0.2] = np.nan
    if hardness and rng.random() < 0.5:
        hardness = hardness * (0.5 + rng.random(grid.shape))
    problem = ContactProblem(
        grid, material, gap, periodic=periodic, hardness=hardness, background_pressure=background
    )
    field = np.broadcast_to(background, grid.shape)
    raised = (DenseProblem(problem).matrix @ field.ravel()).reshape(grid.shape)
    upper = None if hardness is None else hardness - field
    alone = ContactProblem(problem.grid, material, gap + raised, hardness=upper)
    return problem, alone, field


@pytest.mark.parametrize("hardness", [None, 4000.0])
@pytest.mark.parametrize(
    ("periodic", "material"), [(None, STEEL), (True, STEEL), ("x", STEEL), (None, COATED), (True, COATED)]
)
def test_random_problems_against_the_dense_solver(periodic, material, hardness):
    for seed in range(12):
        problem, alone, field = random_problem(seed, periodic, material, hardness)
        dense = DenseProblem(alone)
        carried = field.sum() * problem.grid.cell_area
        load = carried + min(1500 * np.random.default_rng(seed).random(), 0.9 * dense.largest_load)
        found = solved(problem, load=load)
        net = found.pressure - field
        exact, approach = dense.under(load - carried, found.approach)
        assert found.converged and found.load == load
        assert dense.energy(net - exact) <= found.error_bound * dense.energy(net) * (1 + 1e-6)
        assert found.approach == pytest.approx(approach, rel=1e-3, abs=1e-6)
        assert (net >= 0).all() and np.nanmin(found.gap) >= -1e-6
        assert found.mean_pressure == pytest.approx(found.pressure.mean(), rel=1e-9)
        assert found.max_pressure == found.pressure.max()
        if hardness:
            assert found.problem["largest_load"] == pytest.approx(carried + dense.largest_load, rel=1e-9)
        if found.contact.all():  # on a periodic patch the approach does not determine the load
            continue
        by_approach = solved(problem, approach=found.approach)
        assert by_approach.load == pytest.approx(load, rel=1e-3)


def test_without_background_nothing_changes():
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    plain, none = (ContactProblem(grid, STEEL, Sphere(20), background_pressure=p0) for p0 in (None, 0.0))
    assert np.array_equal(solved(plain, load=100).pressure, solved(none, load=100).pressure)
    tiny = ContactProblem(grid, STEEL, Sphere(20), background_pressure=1e-9)
    change = solved(tiny, load=100).pressure - solved(plain, load=100).pressure
    assert abs(change).max() < 1e-2


def test_uniform_pressure_on_a_periodic_patch_only_adds_to_the_load():
    """There a constant pressure displaces nothing."""
    grid = Grid.from_domain(32, 32, (0, 1, 0, 1))
    x = grid.x()
    wave = 1e-3 * np.cos(2 * np.pi * x) * np.cos(2 * np.pi * grid.y()[:, None])
    plain = solved(ContactProblem(grid, STEEL, wave, periodic=True), mean_pressure=100)
    raised = solved(
        ContactProblem(grid, STEEL, wave, periodic=True, background_pressure=30), mean_pressure=130
    )
    np.testing.assert_allclose(raised.pressure, plain.pressure + 30, rtol=1e-5, atol=1e-2)
    assert raised.mean_gap == pytest.approx(plain.mean_gap, rel=1e-6)
    assert raised.approach == pytest.approx(plain.approach, rel=1e-6)


def test_moments_and_a_start_from_a_solution():
    problem, _, _ = random_problem(5)
    carried = problem.grid.area * np.mean(problem.background_pressure)
    with ContactSolver(problem) as solver:
        solver.quiet = True
        first = solver.solve(load=carried + 100)
        again = solver.solve(load=carried + 100, start=first)
    x, y, area = first.x, first.y[:, None], problem.grid.cell_area
    assert first.moment_x == pytest.approx((first.pressure * x).sum() * area)
    assert first.moment_y == pytest.approx((first.pressure * y).sum() * area)
    assert first.pressure_centre_x == pytest.approx((first.pressure * x).sum() / first.pressure.sum())
    assert again.iterations == 1
    np.testing.assert_allclose(again.pressure, first.pressure, rtol=1e-5, atol=1e-3)


def test_results_files_keep_it(tmp_path):
    problem, _, field = random_problem(1)
    found = solved(problem, load=2000)
    found.save(tmp_path / "a.h5")
    result = read_result(tmp_path / "a.h5")
    number = np.ndim(problem.background_pressure) == 0
    assert np.array_equal(
        result.background_pressure if number else result.extra["background_pressure"],
        problem.background_pressure if number else field,
    )
    assert np.array_equal(result.pressure, found.pressure)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"background_pressure": -1}, "background_pressure: -1; must be 0, or"),
        ({"background_pressure": 10, "hardness": 5}, "background_pressure: 10; must be below the hardness"),
        ({"background_pressure": np.ones((2, 2))}, r"has shape \(2, 2\)"),
        ({"background_pressure": "much"}, "must be a number from 0"),
    ],
)
def test_wrong_values_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        ContactProblem(Grid.from_domain(8, 8, (0, 1, 0, 1)), STEEL, np.zeros((8, 8)), **arguments)


@pytest.mark.parametrize("loading", [{"load": 5}, {"mean_pressure": 5}])
def test_loads_below_that_of_the_background_are_refused(loading):
    grid = Grid.from_domain(8, 8, (0, 1, 0, 1))
    problem = ContactProblem(grid, STEEL, Sphere(10), background_pressure=10)
    with pytest.raises(InputError, match="must be at least 10 N.*, which the background pressure carries"):
        solved(problem, **loading)
    limited = ContactProblem(grid, STEEL, Sphere(10), background_pressure=10, hardness=50)
    with pytest.raises(InputError, match="must be at most 50 N"):
        solved(limited, **{name: 100 for name in loading})


@pytest.mark.parametrize("material", [Material.layer(5.0, 0.45, 0.2), Material.combined(80000, 0.3)])
def test_approaches_count_the_uniform_displacement_of_the_background(material):
    grid = Grid.from_domain(12, 10, (-1, 1, -0.8, 0.8), periodic=True)
    compliance = 0.01 if material.is_half_space else 0.0
    problem = ContactProblem(
        grid, material, Sphere(25), background_pressure=0.2, surface_compliance=compliance
    )
    with ContactSolver(problem) as solver:
        touching = solver.solve(load=0.2 * grid.area).approach
        for approach in (touching - 0.2, touching / 2, touching + 0.001):
            found = solver.solve(approach=approach)
            assert found.converged and found.approach == pytest.approx(approach, rel=1e-6)
            e = Sphere(25).shape_on(grid) - approach + found.displacement
            np.testing.assert_allclose(found.gap, e.clip(min=0), atol=1e-6)
            assert (found.pressure.max() > 0.2) == (approach > touching)


@pytest.mark.parametrize("periodic", [None, "y"])
def test_a_tilt_may_be_prescribed_with_the_load_or_the_approach(periodic):
    problem, alone, field = random_problem(5, periodic, hardness=4000.0)
    tilt = (0.002, 0.0 if periodic else -0.001)
    by_load = solved(problem, load=1.5 * field.sum() * problem.grid.cell_area, tilt=tilt)
    by_approach = solved(problem, approach=by_load.approach, tilt=tilt)
    assert by_load.converged and by_approach.converged and by_load.contact.any()
    contact = solved(alone, approach=by_load.approach, tilt=tilt)
    for found in by_load, by_approach:
        np.testing.assert_allclose(found.pressure, contact.pressure + field, atol=1e-4 * found.max_pressure)
        assert (found.tilt_x, found.tilt_y) == tilt


@pytest.mark.mpi(2, 3)
def test_ranks_agree(comm):
    grid = Grid.from_domain(64, 48, (-1, 1, -0.5, 1.0))
    problem, _, _ = random_problem(3, grid=Grid.from_domain(9, 7, (-1, 1, -0.5, 1.0)))
    rough = np.random.default_rng(2).random(grid.shape) * 1e-3
    problem = ContactProblem(grid, STEEL, rough, background_pressure=100 * (1 + rough))
    with ContactSolver(problem, comm=comm) as solver:
        solver.quiet = True
        shared = solver.solve(load=2000).gather()
    if comm.rank == 0:
        alone = solved(problem, comm=MPI.COMM_SELF, load=2000)
        np.testing.assert_allclose(shared.pressure, alone.pressure, rtol=1e-6, atol=1e-3)
        assert shared.max_pressure == pytest.approx(alone.max_pressure, rel=1e-6)
        assert shared.moment_x == pytest.approx(alone.moment_x, rel=1e-6)
