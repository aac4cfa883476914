"""SNESVI, the reference solver."""

import warnings

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem, ContactSolver, Grid


def test_history_has_every_iteration_up_to_the_limit():
    solution = solve(hertz(12), APPROACH, None, lcp_type="snesvi")
    history = solution.history
    assert list(history["iteration"]) == list(range(1, solution.iterations + 1))
    assert sum(history["inner_iterations"]) == solution.inner_iterations
    assert history["residual"][-1] == pytest.approx(solution.residual, rel=1e-12)
    assert history["contact_cells"][-1] == np.count_nonzero(solution.contact)
    for limit in ("lcp_max_it", "snes_max_it"):
        stopped = solve(hertz(12), APPROACH, None, lcp_type="snesvi", **{limit: 2})
        assert not stopped.converged and stopped.iterations == 2


def test_a_second_solve_counts_its_own_work():
    with ContactSolver(hertz(12), options={"lcp_type": "snesvi"}) as solver:
        first, second = (solver.solve(approach=APPROACH) for _ in range(2))
    assert second.work_units == first.work_units > 0
    assert second.inner_iterations == first.inner_iterations > 0


def test_a_solve_starts_from_a_solution():
    with ContactSolver(hertz(16), options={"lcp_type": "snesvi"}) as solver:
        first = solver.solve(approach=APPROACH)
        again = solver.solve(approach=APPROACH, start=first)
    assert again.operator_applications < first.operator_applications / 2
    assert again.load == pytest.approx(first.load, rel=1e-5)


def test_no_pressure_acts_on_cells_that_may_not_touch():
    bodies = hertz(16)
    hole = np.zeros((16, 16), bool)
    hole[7:9, 6:9] = True
    pierced = ContactProblem(
        bodies.grid, bodies.material, np.where(hole, np.nan, bodies.shape_on(bodies.grid))
    )
    solution = solve(pierced, APPROACH, None, lcp_type="snesvi")
    default = solve(pierced, APPROACH, None)
    assert solution.converged and not solution.pressure[hole].any()
    np.testing.assert_allclose(solution.pressure, default.pressure, atol=1e-3 * default.max_pressure)


PROBLEM = hertz(16)


@pytest.mark.parametrize("length", [1e-12, 1e-16])
def test_the_solver_gives_up_with_a_reason_at_tiny_lengths(length):
    grid = Grid.from_domain(16, 16, (-10 * length, 10 * length, -6 * length, 6 * length))
    problem = ContactProblem(grid, PROBLEM.material, lambda x, y: (x**2 / 600 + y**2 / 326) / length)
    with (
        warnings.catch_warnings(),
        ContactSolver(problem, options={"lcp_type": "snesvi"}) as solver,
    ):
        warnings.simplefilter("ignore", RuntimeWarning)
        for _ in range(2):
            solution = solver.solve(approach=0.1 * length)
            assert solution.converged or solution.error_bound > 0.01 or "SNES" in solution.message
