"""Primal form with a hardness."""

from dataclasses import replace

import numpy as np
import periodic
import pytest
from operators import random_field

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.loading import PrescribedApproach
from app.contact.prescribed_load import PrescribedLoad
from app.verification.dense import DenseProblem

MATERIAL = Material.from_contact_modulus(1000)


def random_problem(seed):
    """Make a problem of few cells, its dense problem, and a loading."""
    rng = np.random.default_rng(seed)
    nx, ny = rng.choice([3, 4, 7, 8, 12, 16], 2)
    grid = Grid(nx, ny, rng.choice([0.1, 0.03]), 0.1)
    (x, y) = (2 * np.pi * np.arange(n) / n for n in (nx, ny))
    shapes = (
        rng.normal(size=grid.shape),
        np.cos(x) + np.cos(2 * y + 1)[:, None] + 0.1 * rng.normal(size=grid.shape),
        np.minimum((x - 3) ** 2 + (y - 3)[:, None] ** 2, 2),
    )
    size = 10.0 ** rng.uniform(-4, -2)
    gap = size * shapes[seed % 3]
    if seed % 4 == 0:
        gap[rng.random(grid.shape) < 0.15] = np.nan
    hardness = size * 1000 * np.pi / max(nx * grid.dx, ny * grid.dy) * 10 ** rng.uniform(-2, 0.5)
    where = rng.random(grid.shape) < 0.5
    fields = hardness, hardness * np.exp(rng.normal(size=grid.shape)), np.where(where, hardness, np.inf)
    problem = ContactProblem(
        grid, MATERIAL, gap - np.nanmin(gap), periodic=True, hardness=fields[seed // 3 % 3]
    )
    dense = DenseProblem(problem)
    largest = min(dense.largest_load, grid.area * 3 * hardness)
    share = rng.uniform(0.05, 1.0)
    loadings = (
        {"load": share * largest},
        {"approach": 2 * share * np.nanmean(problem.gap)},
        {"load": 0.999 * largest},
    )
    return problem, dense, loadings[seed // 2 % 3]


def pressure_by_pivoting(dense, loading, approach):
    return (dense.under(loading["load"], approach)[0] if "load" in loading else dense.at(approach)).astype(
        float
    )


def energy(dense, pressure):
    """Return the energy norm; constants do not count."""
    return dense.energy(pressure - pressure.mean() if dense.inside.all() else pressure)


@pytest.mark.parametrize("seed", range(24))
def test_pressure_is_that_by_pivoting(seed):
    """Without the safeguard, and with an error below the bound."""
    problem, dense, loading = random_problem(seed)
    with ContactSolver(problem) as solver:
        solution = solver.solve(**loading)
    assert solution.converged and not solution.fallbacks, solution.message
    p = solution.pressure
    assert ((p >= 0) & (p <= problem.hardness)).all()
    assert solution.load == pytest.approx(loading.get("load", solution.load), rel=1e-12)
    expected = pressure_by_pivoting(dense, loading, solution.approach)
    rounding = 1e-13 * abs(expected).max() * np.sqrt(dense.matrix[0, 0])
    assert energy(dense, p - expected) <= solution.error_bound * energy(dense, p) + rounding
    # A plastic cell overlaps, an open one does not.
    slack = 1e-4 * np.nanstd(problem.gap)
    e = solution.gap if solution.plastic_depth is None else solution.gap - solution.plastic_depth
    inside = ~np.isnan(problem.gap)
    assert (e >= -slack)[inside & (p < problem.hardness)].all()
    assert (e <= slack)[inside & (p > 0)].all()


@pytest.mark.parametrize("shape", ["waves", "steps"])
@pytest.mark.parametrize("missing", [1e-2, 1e-3, 1e-6, 1e-9])
def test_loads_just_below_the_largest(shape, missing):
    """Few cells are elastic; those of steps are all alike but for their places."""
    n = 16
    x = 2 * np.pi * np.arange(n) / n
    gap = {
        "waves": 0.05 * (1 - np.cos(x)[:, None] * np.cos(x)),
        "steps": 0.01 * (np.random.default_rng(1).random((n, n)) < 0.5),
    }[shape]
    problem = ContactProblem(Grid(n, n, 0.1, 0.1), MATERIAL, gap, periodic=True, hardness=30.0)
    load = (1 - missing) * 30 * problem.grid.area
    with ContactSolver(problem) as solver:
        solution = solver.solve(load=load)
    assert solution.converged and not solution.fallbacks and solution.iterations <= 20
    expected, approach = DenseProblem(problem).under(load, solution.approach)
    np.testing.assert_allclose(
        solution.pressure, expected.astype(float), rtol=0, atol=0.05 * missing * 30 * n**2
    )
    assert solution.approach == pytest.approx(approach, rel=1e-4)


def test_a_start_keeps_plastic_cells():
    problem = replace(periodic.rough(64, 64, 8), hardness=0.03)
    with ContactSolver(problem) as solver:
        first = solver.solve(load=0.3 * 0.03 * problem.grid.area)
        again = solver.solve(load=first.load, start=first)
    assert first.plastic.any() and again.converged
    assert len(set(again.history["level"])) == 1 and again.iterations <= first.iterations
    np.testing.assert_allclose(again.pressure, first.pressure, rtol=0, atol=2e-4 * 0.03)


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_each_step_keeps_the_stored_pressure_and_the_loading(steps, holes, loading, pressure_of):
    """p = B w + mean pressure is stored minus H in plastic cells."""
    hardness = 3000.0
    primal, solver = steps(loading, holes, hardness=hardness)
    primal.w[...] = random_field(primal.grid, 8) * 0.01

    def check(stored, w=None):
        expected = pressure_of(primal, w) - hardness * primal.plastic
        np.testing.assert_allclose(stored, expected, rtol=0, atol=1e-11 * max(hardness, abs(expected).max()))
        assert not (primal.contact & primal.plastic).any()
        assert not ((primal.contact | primal.plastic) & ~primal.admissible).any()
        assert (primal.inverse.mask == ~primal.contact).all()

    primal.start(solver)
    primal.guess(solver)
    check(primal.p)
    seen = 0
    for _ in range(4):
        before = np.linalg.norm(primal.p[~primal.contact])
        solver.improve(primal, 0.0)
        w = primal.w + solver.change
        check(solver.carried, w)
        assert np.linalg.norm(solver.carried[~primal.contact]) < 0.9 * before
        old, plastic, e = primal.contact.copy(), primal.plastic.copy(), w - primal.distance.b
        p = solver.carried.copy()
        update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
        opened = ~old & ~plastic & primal.admissible & (e < 0)
        assert (primal.plastic == (plastic & (e <= 0)) | (old & (p > hardness))).all()
        assert (primal.contact == (old & (p >= 0) & (p <= hardness)) | opened | (plastic & (e > 0))).all()
        assert update.cells == primal.contact.sum()
        seen += primal.plastic.sum()
        primal.close_captured_gaps(solver)
        check(primal.p)
        assert (primal.w == primal.distance.b)[primal.contact].all()
    assert seen > 0


def test_only_the_worst_cell_changes_if_sets_come_back(steps):
    primal, solver = steps(PrescribedLoad(1e2), hardness=300.0)
    primal.start(solver)
    contact, p = np.zeros(primal.w.shape, bool), np.zeros(primal.w.shape)
    contact[3:6, 4:7], p[3, 4], p[4, 5] = True, -7.0, 301.0
    solver.change[...] = 0.0
    for cells in (2, 1):
        primal.contact[...], primal.plastic[...], solver.carried[...] = contact, False, p
        update = primal.exchange(solver, 0.5, -np.inf, np.inf, 0.0)
        assert update.released == cells
    assert not primal.contact[3, 4] and primal.contact[4, 5] and not primal.plastic.any()


def test_contact_is_not_empty_under_a_load(steps):
    """If all cells leave contact, the lowest ones become plastic until they carry the load."""
    primal, solver = steps(PrescribedLoad(1e2), hardness=300.0)
    primal.start(solver)
    primal.guess(solver)
    solver.improve(primal, 0.0)
    solver.carried[primal.contact] = 301.0
    update = primal.exchange(solver, 0.0, -np.inf, np.inf, 0.0)
    carried = 300.0 * np.count_nonzero(primal.plastic)
    wanted = 1e2 / primal.grid.cell_area
    assert update.cells == np.count_nonzero(primal.contact) > 0
    assert carried <= wanted < carried + 300.0 * update.cells
    e = primal.w + solver.change - primal.distance.b
    assert e[primal.plastic].max(initial=-np.inf) <= 1e-15 and abs(e[primal.contact]).max() <= 1e-15


@pytest.mark.parametrize("loading", [{"load": 0.9999}, {"approach": 1.2}])
def test_coarse_grids_may_carry_less(loading):
    """Coarse cells are elastic or without area where fine ones are not."""
    problem = periodic.rough(26, 22, 3, 0.0 if "approach" in loading else 0.3)
    hardness = np.full(problem.gap.shape, np.inf if "approach" in loading else 0.02)
    hardness[::2, ::2] = 0.02
    problem = replace(problem, hardness=hardness)
    with ContactSolver(problem) as solver:
        if "load" in loading:
            cells = np.count_nonzero(~np.isnan(problem.gap))
            solution = solver.solve(load=loading["load"] * 0.02 * cells * problem.grid.cell_area)
        else:
            solution = solver.solve(approach=loading["approach"] * problem.gap.mean())
    assert solution.converged and not solution.fallbacks and solution.plastic.any()


def test_approach_beyond_full_contact_needs_a_plastic_cell(steps):
    """With all cells in contact, the one nearest to the hardness becomes plastic."""
    depth = 1.01 * np.nanmean(periodic.rough(24, 16, 3).gap)
    primal, solver = steps(PrescribedApproach(depth, depth), hardness=300.0)
    primal.w[...] = primal.distance.b
    primal.start(solver)
    primal.contact[...], primal.inverse.mask[...] = True, False
    solver.set_contact()
    solver.carried[...], solver.change[...] = 100.0, 0.0
    solver.carried[3, 4] = 200.0
    primal.exchange(solver, 0.0, -np.inf, np.inf, 0.0)
    assert np.argwhere(primal.plastic).tolist() == [[3, 4]] and not primal.contact[3, 4]
    assert solver.carried[3, 4] == pytest.approx(0, abs=1e-12)
    assert solver.carried[0, 0] == pytest.approx(200.0)
