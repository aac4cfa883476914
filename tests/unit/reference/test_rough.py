"""Theories of rough contact."""

import numpy as np
import pytest
from scipy.special import erf

from app import ContactProblem, ContactSolver, Sphere, solve

from ..problems.from_options import rough_problem


def test_flat_rough_bodies_have_theories_of_the_contact_fraction():
    """At light loads both are the same line except for the factor pi / 2 of their slopes; other bodies have none."""
    problem = rough_problem("32")
    with ContactSolver(problem) as solver:
        path = solver.path(mean_pressure=[0.01, 0.02, 20.0])
        light, twice, heavy = path
    slope = light.problem["persson_fraction"] / (0.01 / (100 * light.rms_slope))
    assert slope == pytest.approx(np.sqrt(8 / np.pi), rel=1e-5)
    ratio = light.problem["bush_gibson_thomas_fraction"] / light.problem["persson_fraction"]
    assert ratio == pytest.approx(np.pi / 2, rel=1e-5)
    assert heavy.problem["persson_fraction"] == pytest.approx(erf(np.sqrt(2) * 20 / (100 * heavy.rms_slope)))
    assert np.isnan(heavy.problem["bush_gibson_thomas_fraction"])
    column = path.table["persson_fraction"]
    assert column[1] == twice.problem["persson_fraction"] and column[1] == pytest.approx(
        2 * column[0], rel=1e-4
    )
    ball = ContactProblem(problem.grid, problem.material, Sphere(10.0), surfaces=problem.surfaces)
    assert "persson_fraction" not in solve(ball, mean_pressure=0.01).problem
