"""Dilute contact of periodic patches on lists of cells: the answers of the method on all cells, with right bounds."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material
from app.base.errors import InputError
from app.halfspace import periodic_list_product
from app.halfspace.operator import InfluenceOperator
from app.methods.free import dilute
from app.multigrid import solver_cache

HALF_SPACE = Material.from_contact_modulus(1.0)
BODIES = {
    "half-space": HALF_SPACE,
    "coating": Material.coated(young=(20.0, 1.0), poisson=(0.3, 0.3), thickness=8.0),
}
TIGHT = {"lcp_rtol": 1e-11, "lcp_precision": "double"}


@pytest.fixture
def forced(monkeypatch):
    """Solve small grids on lists, and count the solves that did so."""
    for name, value in {"_MIN_CELLS": 64, "_MIN_NODES": 12, "_MARGIN": 8}.items():
        monkeypatch.setattr(periodic_list_product, name, value)
    monkeypatch.setattr(dilute, "MIN_CELLS", 5000)
    for name in ("MAX_COST", "MAX_COST_PERIODIC", "MAX_GROWN_COST", "MAX_CHECK_COST", "MAX_SHARE"):
        monkeypatch.setattr(dilute, name, np.inf)
    done, solve = [], dilute.DiluteContact.solve

    def counted(*args):
        result = solve(*args)
        done.append(result is not None)
        return result

    monkeypatch.setattr(dilute.DiluteContact, "solve", counted)
    return done


def patch(periodic, dx=1.0):
    return Grid(128, 96 if dx == 1.0 else 144, dx, 1.0, periodic=periodic)


def surface(grid, rng):
    """Return balls, one across the corner, and a spike that vanishes in coarse cells [mm]."""
    y, x = np.ogrid[: grid.ny, : grid.nx]
    places = [(0.3, 0.4, 0.0), *((*rng.random(2), 0.2 * rng.random()) for _ in range(4)), (0.0, 0.0, 0.01)]
    gap = np.inf
    for j, i, height in places:
        dy, dx = np.abs(y - j * grid.ny), np.abs(x - i * grid.nx)
        dy, dx = np.minimum(dy, grid.ny - dy), np.minimum(dx, grid.nx - dx)
        gap = np.minimum(gap, 0.05 * (dx**2 + dy**2) + height)
    gap[grid.ny // 2, grid.nx // 2] = 0.05
    return gap


def solve(problem, options=None, **loading):
    with ContactSolver(problem, options=options) as solver:
        return solver.solve(**loading)


@pytest.mark.parametrize("bodies", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("periodic", ["spectral", "love", "x", "y"])
@pytest.mark.parametrize("dx", [1.0, 1.6])
def test_lists_give_the_solution_up_to_their_bound(dx, periodic, bodies, forced, monkeypatch):
    grid = patch(periodic, dx)
    problem = ContactProblem(grid, bodies, surface(grid, np.random.default_rng(3)))
    operator, u = InfluenceOperator(grid, problem.kernel), np.empty(grid.shape)

    def energy(p):
        operator.exact_displacement(p, u)
        return np.sqrt(max(np.vdot(p, u), 0.0))

    for rtol in (1e-4, 1e-8):
        for load in (0.01, 1.0):
            with monkeypatch.context() as usual:
                usual.setattr(dilute, "MIN_CELLS", 10**9)
                exact = solve(problem, TIGHT, load=load)
            other = "mean_gap" if grid.doubly_periodic else "approach"
            for loading in ({"load": load}, {other: getattr(exact, other)}):
                found, count = solve(problem, {"lcp_rtol": rtol}, **loading), len(forced)
                assert count and forced[-1] and found.converged and not found.fallbacks
                allowed = found.error_bound * energy(found.pressure) + exact.error_bound * energy(
                    exact.pressure
                )
                assert energy(found.pressure - exact.pressure) <= 1.001 * allowed
                assert found.mean_gap == pytest.approx(exact.mean_gap, rel=1e-4)
                gap = np.vdot(found.pressure, found.gap)
                assert abs(gap) <= 1e-2 * found.pressure.sum() * np.abs(found.gap).max()


def test_the_displacement_needs_no_product_on_all_cells(forced):
    grid = patch("spectral")
    problem = ContactProblem(grid, HALF_SPACE, surface(grid, np.random.default_rng(3)))
    with ContactSolver(problem) as solver:
        found, target = solver.solve(load=0.1), solver.hierarchy.target
        made = {"exact_product", "exact_inverse"}
        assert forced == [True] and not made & vars(target).keys()
        u = found.displacement
        assert not made & vars(target).keys()
    whole = np.empty(grid.shape)
    InfluenceOperator(grid, problem.kernel).exact_displacement(found.pressure, whole)
    np.testing.assert_allclose(u, whole, atol=1e-7 * u.max())


@pytest.mark.parametrize("periodic", ["spectral", "x"])
@pytest.mark.parametrize("ratio", [0.05, 1.0, 1.2])
def test_a_start_is_used_on_lists(ratio, periodic, forced, monkeypatch):
    grid = patch(periodic)
    problem = ContactProblem(grid, HALF_SPACE, surface(grid, np.random.default_rng(3)))
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        first = solver.solve(load=0.1)
        found = solver.solve(load=ratio * 0.1, start=first)
        back = solver.solve(approach=first.approach, start=found)
    assert forced == [True] and found.converged and not found.fallbacks
    assert set(found.history["level"]) == {max(first.history["level"])}
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    usual = solve(problem, {"lcp_rtol": 1e-9}, load=ratio * 0.1)
    np.testing.assert_allclose(found.pressure, usual.pressure, atol=1e-5 * usual.max_pressure)
    np.testing.assert_allclose(back.pressure, first.pressure, atol=1e-5 * first.max_pressure)


@pytest.mark.parametrize("coarsest", [16, 70])
@pytest.mark.parametrize("periodic", ["spectral", "x"])
def test_options_are_read_if_no_grid_keeps_its_solver(periodic, coarsest, forced, monkeypatch):
    monkeypatch.setattr(solver_cache, "MAX_CACHED_CELLS", 0)
    grid = patch(periodic)
    problem = ContactProblem(grid, HALF_SPACE, surface(grid, np.random.default_rng(3)))
    found = solve(problem, {"lcp_coarsest": coarsest}, load=0.1)
    assert found.converged and forced == [True]
    with pytest.raises(InputError, match="ksp_nonsense"):
        solve(problem, {"lcp_coarsest": coarsest, "ksp_nonsense": 1}, load=0.1)


def test_a_hardness_in_both_directions_is_solved_on_all_cells(forced):
    grid = patch("spectral")
    problem = ContactProblem(grid, HALF_SPACE, surface(grid, np.random.default_rng(3)), hardness=0.5)
    with ContactSolver(problem) as solver:
        assert solver.solve(load=0.1).converged
        assert solver.solve(load=0.12).converged
    assert forced == []


@pytest.mark.parametrize(("periodic", "hardness"), [("spectral", None), ("x", None), ("x", 0.2)])
def test_holes_and_hardness_are_those_on_all_cells(periodic, hardness, forced, monkeypatch):
    grid = patch(periodic)
    gap = surface(grid, np.random.default_rng(3))
    gap[20:25, 30:60] = gap[38, 38] = np.nan  # beside and in a contact spot
    problem = ContactProblem(grid, HALF_SPACE, gap, hardness=hardness)
    found = solve(problem, {"lcp_rtol": 1e-9}, load=0.5)
    assert forced == [True]
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    usual = solve(problem, {"lcp_rtol": 1e-9}, load=0.5)
    assert (found.contact == usual.contact).all()
    np.testing.assert_allclose(found.pressure, usual.pressure, atol=1e-5 * usual.pressure.max())
    for name in ("mean_gap", "contact_area", "approach", "max_pressure"):
        assert getattr(found, name) == pytest.approx(getattr(usual, name), rel=1e-5)


def test_a_load_that_needs_all_cells_is_solved_after_a_dilute_one(forced, monkeypatch):
    grid = patch("spectral")
    problem = ContactProblem(grid, HALF_SPACE, surface(grid, np.random.default_rng(3)))
    monkeypatch.setattr(dilute, "MAX_SHARE", 0.05)
    with ContactSolver(problem) as solver:
        few, many = solver.solve(load=0.01), solver.solve(mean_pressure=0.5)
    assert forced == [True, False] and few.converged and many.converged
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    usual = solve(problem, mean_pressure=0.5)
    np.testing.assert_allclose(many.pressure, usual.pressure, atol=1e-5 * usual.pressure.max())
