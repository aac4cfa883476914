"""Contact stiffness: a derivative, and its limits."""

import numpy as np
import pytest
from cases import hertz

from app import ContactProblem, ContactSolver, Grid, Material


def test_stiffness_is_the_derivative_of_the_load():
    with ContactSolver(hertz(128)) as solver:
        here = solver.solve(load=80000.0)
        stiffness, step = solver.stiffness(here), 800.0
        low, high = (solver.solve(load=80000.0 + sign * step) for sign in (-1, 1))
        assert solver.stiffness(solver.solve(approach=-1.0)) == 0
    assert stiffness == pytest.approx(2 * step / (high.approach - low.approach), rel=3e-3)
    assert stiffness == pytest.approx(hertz(128).reference(here.approach).stiffness, rel=5e-3)


@pytest.mark.parametrize("method", [None, "norm", "fmg_v11"])
def test_stiffness_where_contact_does_not_change_is_load_over_approach(method):
    grid = Grid.from_domain(24, 16, (0.0, 3.0, 0.0, 2.0))
    flat = ContactProblem(grid, Material.from_contact_modulus(1000.0), np.zeros(grid.shape))
    with ContactSolver(flat, method, {"lcp_rtol": 1e-9}) as solver:
        solution = solver.solve(approach=0.01)
        assert solver.stiffness(solution) == pytest.approx(solution.load / 0.01, rel=1e-7)


def test_stiffness_of_full_contact_is_infinite():
    grid = Grid.from_domain(16, 16, (0.0, 1.0, 0.0, 1.0))
    wave = 1e-4 * np.cos(2 * np.pi * grid.x()) + np.zeros(grid.shape)
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1000.0), wave, True)) as solver:
        assert solver.stiffness(solver.solve(mean_pressure=100.0)) == np.inf
        half = solver.solve(mean_pressure=0.1)
        low, high = (solver.solve(mean_pressure=p) for p in (0.099, 0.101))
        assert solver.stiffness(half) == pytest.approx(0.002 / (high.approach - low.approach), rel=0.3)
