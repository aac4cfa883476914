"""Working in a window around contact: same answers, less work."""

import numpy as np
import pytest
from cases import APPROACH, hertz, punch
from running import assert_solves_lcp, solve

from app import ContactProblem, ContactSolver, Grid, Material
from app.halfspace.operator import InfluenceOperator


@pytest.mark.parametrize(
    ("problem", "approach"), [(hertz(200), APPROACH), (punch(163, 140), 0.01)], ids=["hertz", "rough"]
)
@pytest.mark.parametrize(
    ("method", "options"),
    [("fast", {}), ("fast", {"lcp_precision": "double"}), ("fast", {"lcp_window": 0.5})],
    ids=["default", "double", "wide"],
)
def test_the_answer_is_that_without_a_window(problem, approach, method, options):
    everywhere = solve(problem, approach, "fast", lcp_window=0, lcp_rtol=1e-9)
    for load in (None, everywhere.load):
        solution = solve(problem, approach, method, load, **(options | {"lcp_rtol": 1e-9}))
        assert_solves_lcp(solution)
        assert solution.approach == pytest.approx(approach, rel=1e-6)
        assert solution.load == pytest.approx(everywhere.load, rel=1e-6)
        highest = everywhere.pressure.max()
        np.testing.assert_allclose(solution.pressure, everywhere.pressure, rtol=0, atol=1e-5 * highest)
        np.testing.assert_allclose(
            solution.displacement, everywhere.displacement, rtol=0, atol=1e-6 * everywhere.displacement.max()
        )


def test_small_contact_in_a_large_patch_is_cheap():
    """All but the last word, one product, is done around the contact."""
    grid = Grid.from_domain(512, 512, (-1.0, 1.0, -1.0, 1.0))
    ball = ContactProblem(
        grid, Material.combined(80000.0, 0.3), lambda x, y: ((x - 0.6) ** 2 + (y + 0.3) ** 2) / 2
    )
    solution = solve(ball, 0.01, "fast")
    assert_solves_lcp(solution)
    assert solution.operator_applications < 2


@pytest.mark.parametrize("method", ["fast", "fmg_v11", "mg_v11", "norm"])
@pytest.mark.parametrize("radius", [0.003, 0.02])
def test_a_punch_that_coarse_grids_cannot_see(method, radius):
    grid = Grid.from_domain(256, 256, (-1.0, 1.0, -1.0, 1.0))
    place = grid.x()[201]

    def shape(x, y):
        return np.where((x - place) ** 2 + (y - place) ** 2 < radius**2, (x - place) ** 2, np.nan)

    problem = ContactProblem(grid, Material.combined(80000.0, 0.3), shape)
    by_approach = solve(problem, 0.001, method)
    assert_solves_lcp(by_approach)
    assert by_approach.contact.any()
    by_load = solve(problem, 0.001, method, by_approach.load)
    assert_solves_lcp(by_load)
    assert by_load.approach == pytest.approx(0.001, rel=1e-5)


def test_under_a_load_the_displacement_of_all_cells_is_that_of_the_pressure():
    problem = hertz(128)
    with ContactSolver(problem) as solver:
        for load in (20.0, 2000.0, 50000.0):
            solution = solver.solve(load=load)
            u = np.empty(problem.grid.shape)
            InfluenceOperator(problem.grid, problem.material.kernel).exact_displacement(solution.pressure, u)
            np.testing.assert_allclose(solution.displacement, u, rtol=0, atol=1e-13 * u.max())
