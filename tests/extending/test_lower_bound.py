"""A lower bound of the pressure, against projected Gauss-Seidel sweeps on all cells."""

import numpy as np
import pytest

from app import ContactProblem, Grid, Material, Sphere
from app.halfspace.influence import dense_matrix

GRID, STEEL = Grid.from_domain(9, 8, (-1, 1, -1, 1)), Material.isotropic(210e3, 0.3)


def sweeps(matrix, h, lower, upper):
    """Pressure between two bounds that satisfies the contact conditions, by sweeps over all cells."""
    p = np.maximum(lower, 0 * h)
    for _ in range(200):
        for i in range(h.size):
            p[i] = np.clip(p[i] - (h[i] + matrix[i] @ p) / matrix[i, i], lower[i], upper[i])
    return p


@pytest.mark.parametrize("lowest", [-30.0, 5.0, "array"])
@pytest.mark.parametrize("hardness", [None, 300.0])
def test_pressure_is_that_of_sweeps(example, lowest, hardness):
    lowest = -40 * np.random.default_rng(1).random(GRID.shape) if lowest == "array" else lowest
    problem = ContactProblem(GRID, STEEL, Sphere(100), hardness=hardness)
    options = {"approach": 0.003, "method": "norm"}
    pressure, solution = example("lower_bound").solve_bounded(problem, lowest, **options)
    assert solution.converged and (pressure >= lowest).all()
    h, bounds = (problem.shape_on(GRID) - 0.003).ravel(), np.broadcast_to(lowest, GRID.shape).ravel()
    upper = np.full(h.size, hardness or np.inf)
    expected = sweeps(dense_matrix(GRID, problem.kernel), h, bounds, upper)
    assert pressure.ravel() == pytest.approx(expected, abs=1e-5 * expected.max())


def test_load_is_that_of_the_pressure(example):
    problem = ContactProblem(GRID, STEEL, Sphere(100))
    for loading in ({"load": 20.0}, {"mean_pressure": 20.0 / GRID.area}):
        pressure, _ = example("lower_bound").solve_bounded(problem, -30.0, **loading)
        assert pressure.sum() * GRID.cell_area == pytest.approx(20.0, rel=1e-6)
        assert pressure.min() == -30.0
