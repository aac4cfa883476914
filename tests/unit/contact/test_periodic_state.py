"""The contact state on periodic patches."""

import numpy as np
import periodic
import pytest

from app import ContactProblem, ContactSolver, Material
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.halfspace.grid import Grid
from app.halfspace.operator import InfluenceOperator


def test_one_cell_stays_open_below_full_contact():
    problem = periodic.rough(12, 10, 2)
    operator = InfluenceOperator(problem.grid, problem.material.kernel)
    state = contact_state(operator, UndeformedDistance(operator, problem.gap))
    state.approach = 2 * problem.gap.mean()
    assert state.approach == pytest.approx(problem.gap.mean(), rel=1e-9)
    assert state.approach < problem.gap.mean()
    state.contact[...] = True
    state.before_iteration(1)
    assert np.flatnonzero(~state.contact) == problem.gap.argmax()
    energy, cells = operator.energy_of_contact()
    assert cells == problem.grid.n - 1
    assert energy == pytest.approx(operator.diagonal, rel=1e-9)  # p = 1 is p = -1 on what is open


def test_light_contact_is_independent_of_a_deeper_solve():
    """A single cell touches after a solve at a much larger approach."""
    grid, approach = Grid.from_domain(32, 32, (0, 1, 0, 1)), 1e-9
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = (x - 0.5) ** 2 + (y - 0.5) ** 2
    gap[16, 16], gap[15, 15], gap[15, 16], gap[16, 15] = 0, 0.01, 0.01, 0.01
    problem = ContactProblem(grid, Material.from_contact_modulus(1e3), gap, periodic=True)
    with ContactSolver(problem, options={"lcp_error_bound": 1e-8}) as solver:
        exact = approach / solver.hierarchy.target.diagonal
        for deeper in (None, 0.15):
            if deeper:
                solver.solve(approach=deeper)
            found = solver.solve(approach=approach)
            assert found.contact.sum() == 1
            assert abs(found.max_pressure / exact - 1) <= max(found.error_bound, 1e-13)
