"""Estimated discretisation errors are upper bounds."""

import numpy as np
import pytest
from running import solve

from app import ContactProblem, Cylinder, Grid, Material
from app.contact.grid_errors import GridNumbers, estimate_errors

STEEL = Material.from_contact_modulus(1e5)


@pytest.mark.parametrize("grids", [3, 4, 5])
@pytest.mark.parametrize("ratio", [0.25, 0.5, 0.6, 0.7, 0.8, 0.9])
@pytest.mark.parametrize("sign", [1, -1])
def test_error_of_a_geometric_series_is_its_remainder(grids, ratio, sign):
    """The error on the finest grid is the remainder of the series."""
    pressures = [1 + sign * 0.1 * ratio**k for k in range(grids)]
    errors = estimate_errors([GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures], 0.0, "load")
    error = abs(pressures[-1] - 1) / pressures[-1]
    assert error * (1 - 1e-9) <= errors.max_pressure_error <= max(1.01, 2 / ratio) * error


def rounded_punch(x, y):
    return np.maximum(np.hypot(x, y) - 0.2, 0.0) ** 2 / 0.2


@pytest.mark.parametrize("shape", [rounded_punch, Cylinder(2.0, 0.53)])
@pytest.mark.parametrize("share", [1e-4, 3e-4])
def test_errors_of_edge_pressures_are_at_most_the_estimate(shape, share):
    """At rounded edges, and at sharp ones, where pressures grow with every refinement."""
    found = []
    for n in (64, 128, 256):
        grid = Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5))
        found.append(solve(ContactProblem(grid, STEEL, shape), None, None, load=share * 1e5))
    *coarse, best = found
    for solution in coarse:
        assert abs(solution.max_pressure / best.max_pressure - 1) <= solution.max_pressure_error


def test_differences_that_do_not_decrease_give_an_error_of_one():
    def error(*pressures):
        grids = [GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures]
        return estimate_errors(grids, 0.0, "load")

    slow = error(1.0, 2.0, 3.0, 4.0).max_pressure_error
    assert slow == error(0.5, 1.0, 2.0, 3.0, 4.0).max_pressure_error == 1.0
    assert error(1.0, 2.0, 2.5, 2.75).max_pressure_error < 1.0
