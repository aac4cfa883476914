"""Estimated discretisation errors are upper bounds."""

import numpy as np
import pytest
from running import solve

from app import ContactProblem, Cylinder, Grid, Material
from app.contact.grid_errors import GridNumbers, estimate_errors

STEEL = Material.from_contact_modulus(1e5)


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


def grids_of(*pressures):
    return [GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures]


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_estimate_bounds_the_error_of_any_order(order):
    """With order 1 it is the error itself, with 2 at most 6 times; two grids that agree by chance do not lower it."""
    values = [1 + 0.3 * 2.0 ** (-order * level) for level in range(5)]
    error = abs(1 - 1 / values[-1])
    estimated = estimate_errors(grids_of(*values), 0.0, "approach").max_pressure_error
    assert error * (1 - 1e-12) <= estimated <= 6.1 * error
    by_chance = grids_of(*values[:-1], values[-2])
    assert (
        estimate_errors(by_chance, 0.0, "approach").max_pressure_error
        >= (values[-3] - values[-2]) / 2 / values[-2]
    )


@pytest.mark.parametrize("growth", [1.0, 2**0.5])
def test_the_error_of_a_divergent_number_is_one(growth):
    """Pressures that grow like the logarithm, or the root, of the number of cells; and those of a rigid punch."""
    steps = np.cumsum(growth ** np.arange(5))
    assert estimate_errors(grids_of(*(1 + steps)), 0.0, "approach").max_pressure_error == 1
    # Two grids cannot know.
    assert estimate_errors(grids_of(*(1 + steps)[:2]), 0.0, "approach").max_pressure_error < 1
    assert np.isnan(estimate_errors(grids_of(1.0), 0.0, "approach").load_error)


def test_small_changes_count_as_convergence():
    """A rough punch on 256 x 256 cells, 97% in contact: finer grids say that its area is 0.3% too large."""
    areas = 0.9756, 0.9759, 0.9711, 0.9669
    grids = [GridNumbers(1.0, 1.0, 1.0, area) for area in areas]
    slow = [GridNumbers(1.0, 1.0, 1.0, area) for area in (0.9796, 0.9754, 0.9711, 0.9669)]
    for numbers in grids, slow:
        assert 0.003 < estimate_errors(numbers, 0.0, "load").contact_area_error < 0.05


def test_an_estimated_error_is_at_most_one():
    grids = [GridNumbers(1.0, 1.0, 1.0, area, 0.25**k) for k, area in enumerate((50.0, 10.0, 1.0))]
    assert estimate_errors(grids, 0.0, "load").contact_area_error == 1.0


def test_scatter_of_the_contact_edge_counts_as_convergence():
    """README's ball at 256 x 256: 11272, 2844, 716 and 180 cells in contact; larger steps would have to fall."""
    cells = np.array([180, 716, 2844, 11272]) / 4.0 ** np.arange(4)
    for times, least, most in ((1, 5e-3, 0.02), (3, 0.25, 0.3)):
        areas = cells[-1] + times * (cells - cells[-1])
        grids = [GridNumbers(1.0, 1.0, 1.0, area, 0.25**k) for k, area in enumerate(areas)]
        assert least <= estimate_errors(grids, 0.0, "load").contact_area_error <= most
