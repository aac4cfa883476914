"""Theories of rough contact."""

import numpy as np
import pytest
from scipy.special import erf

from app import ContactProblem, ContactSolver, Sphere, solve
from app.reference.rough import persson_fraction, persson_hardness_fractions

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


def diffuse(relative, hardness, n=400, steps=400):
    """Diffuse a pressure between absorbing walls; the variance is 1/4 of (E* slope)^2."""
    width = hardness / n
    matrix = (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)) / (8 * steps * width**2)
    p = np.zeros(n)
    left = np.linspace(0, hardness, n + 1)[:-1]
    p[np.argmin(abs(left + width / 2 - relative))] = 1
    step = np.linalg.inv(np.eye(n) - matrix)
    lost = np.zeros(2)
    for _ in range(steps):
        p = step @ p
        lost += p[[0, -1]] / (8 * steps * width**2)
    return lost[0], p.sum(), lost[1]


@pytest.mark.parametrize(("relative", "hardness"), [(0.2, 0.7), (0.3, 1.3), (1.0, 1.3)])
def test_fractions_with_a_hardness_are_those_of_the_diffusion(relative, hardness):
    np.testing.assert_allclose(
        persson_hardness_fractions(relative, hardness), diffuse(relative, hardness), atol=5e-3
    )


def test_fractions_with_a_hardness_have_their_limits():
    p = np.array([0.0, 0.1, 0.7, 4.0])
    opened, elastic, plastic = persson_hardness_fractions(p, np.inf)
    np.testing.assert_allclose(elastic, persson_fraction(p), atol=1e-15)
    np.testing.assert_array_equal(plastic, 0)
    soft = persson_hardness_fractions(p / 1e3, 4e-3)
    np.testing.assert_allclose(soft, [1 - p / 4, 0 * p, p / 4], atol=1e-15)
    below, above = (persson_hardness_fractions(0.4, 1 + s) for s in (-1e-13, 1e-13))
    np.testing.assert_allclose(below, above, atol=1e-12)
    assert np.isnan(persson_hardness_fractions(1.1, 1.0)).all()
