"""Strategies: starting from a solution, and what a method can solve for."""

import numpy as np
import pytest
import running
from cases import APPROACH, hertz, periodic_rough, punch
from running import assert_proved_equal, assert_solves_lcp

from app import ContactProblem, ContactSolver, Grid, Material, solve
from app.base.errors import InputError

from ..api.solvers import punch_on, solver_of


@pytest.mark.parametrize("method", ["fast", "norm", "mg", "fmg"])
@pytest.mark.parametrize("by_load", [False, True], ids=["approach", "load"])
def test_a_start_saves_work_and_keeps_the_solution(method, by_load):
    with solver_of(method, hertz(64), lcp_rtol=1e-9) as solver:
        first = solver.solve(approach=APPROACH)
        cold = solver.solve(approach=1.01 * APPROACH)
        loading = {"load": cold.load} if by_load else {"approach": cold.approach}
        warm = solver.solve(**loading, start=first)
        same = solver.solve(**loading, start=cold)
    assert_solves_lcp(warm, 1e-9)
    highest = cold.pressure.max()
    np.testing.assert_allclose(warm.pressure, cold.pressure, rtol=0, atol=1e-6 * highest)
    np.testing.assert_array_equal(warm.contact, cold.contact)
    assert warm.operator_applications < 1.5 * cold.operator_applications
    assert same.operator_applications < 0.6 * cold.operator_applications


def test_any_solution_on_the_grid_is_a_start():
    problem = hertz(32)
    expected = solve(problem, approach=APPROACH, options={"lcp_rtol": 1e-9})
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        starts = [
            solver.solve(approach=-1.0),
            solver.solve(load=0),
            solver.solve(approach=1.0),
            solve(problem, approach=0.05, method="norm"),
            solve(punch_on(problem.grid), approach=0.1),
        ]
        for start in starts:
            for loading in ({"approach": APPROACH}, {"load": expected.load}):
                found = solver.solve(**loading, start=start)
                assert_solves_lcp(found, 1e-9)
                assert found.load == pytest.approx(expected.load, rel=1e-7)
                np.testing.assert_array_equal(found.contact, expected.contact)


def test_reference_solvers_refuse_a_load():
    with solver_of("snesvi") as solver, pytest.raises(InputError, match="prescribed approach, not a load"):
        solver.solve(load=1.0)


def test_reference_solvers_report_the_residual_of_the_paper():
    found = running.solve(punch(24), 0.1, None, lcp_type="snesvi", lcp_max_it=1)
    e, h, contact = found.gap, found.undeformed_distance, found.contact
    assert found.residual == pytest.approx(
        np.linalg.norm(e[contact]) / np.linalg.norm(h[~np.isnan(h)]), rel=1e-9
    )
    assert (e[~contact] < 0).any()  # which counts against the solution, but is not in (5.1)


@pytest.mark.parametrize("method", ["fast", "fmg_v11", "norm", "primal"])
def test_a_start_from_another_material_is_solved_anyway(method):
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1), periodic=method == "primal")
    soft, hard = (
        ContactProblem(grid, Material.combined(modulus, 0.3), lambda x, y: (x**2 + y**2) / 40)
        for modulus in (80e3, 160e3)
    )
    other = solve(hard, approach=0.01, method=method)
    with ContactSolver(soft, method) as solver:
        expected, found = solver.solve(approach=0.01), solver.solve(approach=0.01, start=other)
    assert found.load == pytest.approx(expected.load, rel=1e-4)
    assert found.load == pytest.approx(other.load / 2, rel=1e-4)


def test_a_start_from_a_moved_gap_costs_no_digits():
    grid, rng = Grid.from_domain(94, 90, (0, 1, 0, 1)), np.random.default_rng(3)
    material, gaps = Material.combined(80000, 0.3), 0.01 * rng.random((2, 90, 94)) + [[[5.0]], [[0.0]]]
    with ContactSolver(ContactProblem(grid, material, gaps[0])) as solver:
        before = solver.solve(mean_pressure=0.024)
        solver.update(ContactProblem(grid, material, gaps[1]))
        found, fresh = solver.solve(mean_pressure=15.0, start=before), solver.solve(mean_pressure=15.0)
    assert found.approach == pytest.approx(fresh.approach, rel=1e-4)
    np.testing.assert_allclose(found.undeformed_distance, gaps[1] - found.approach, rtol=0, atol=1e-14)


def test_a_start_may_have_pressure_in_a_new_hole():
    problem = hertz(64)
    with ContactSolver(problem) as solver:
        before = solver.solve(approach=APPROACH)
        gap = problem.shape_on(problem.grid)
        gap[28:36, 28:36] = np.nan
        assert before.contact[28:36, 28:36].any()
        solver.update(ContactProblem(problem.grid, problem.material, gap))
        found, fresh = solver.solve(approach=APPROACH, start=before), solver.solve(approach=APPROACH)
    assert_solves_lcp(found)
    assert_proved_equal(found, fresh)


@pytest.mark.parametrize("kind", ["mean_pressure", "approach", "mean_gap"])
def test_a_start_saves_work_on_a_periodic_patch(kind):
    with ContactSolver(periodic_rough(128)) as solver:
        near = solver.solve(mean_pressure=500.0)
        again = solver.solve(approach=near.approach, start=near)
        loading = {kind: 1.005 * getattr(near, kind)}
        cold, warm = solver.solve(**loading), solver.solve(**loading, start=near)
    assert again.iterations == 1
    assert again.operator_applications < 0.4 * near.operator_applications
    assert_proved_equal(again, near)
    assert warm.operator_applications < cold.operator_applications
    assert_proved_equal(warm, cold)
    assert warm.approach == pytest.approx(cold.approach, rel=1e-4)


@pytest.mark.parametrize("method", ["fmg_v11", "fmg_lift"])
def test_a_later_solve_is_equal_to_the_first(method):
    """It uses the same solvers of coarser grids."""
    with ContactSolver(hertz(64), method) as solver:
        first = solver.solve(approach=APPROACH)
        solver.solve(approach=0.5 * APPROACH)
        again = solver.solve(approach=APPROACH)
    np.testing.assert_array_equal(again.pressure, first.pressure)
    assert again.operator_applications == pytest.approx(first.operator_applications, rel=1e-12)
    for name in ("inner_iterations", "contact_cells", "work_units"):
        assert again.history[name] == pytest.approx(first.history[name], rel=1e-12)
