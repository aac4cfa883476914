"""Flat punch and cone against their analytic solutions."""

import numpy as np
import pytest
from running import assert_solves_lcp, solve

from app import ContactProblem
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.reference import Cone, FlatCircularPunch


def analytic(contact, n, patch):
    """The problem of a reference solution on a square patch of n x n cells, and its grid."""
    grid = Grid.from_domain(n, n, (-patch, patch, -patch, patch))
    material = Material(contact.e_star, 0.0)
    return ContactProblem(grid, material, contact.undeformed_distance)


def test_flat_punch():
    # A circle of cells is a staircase: compared with the punch of the same area, the load is of first order.
    punch = FlatCircularPunch.from_approach(1.0, 100.0, 0.01)
    errors = []
    for n in (16, 32, 64, 128):
        problem = analytic(punch, n, 1.0)
        solution = solve(problem, punch.approach)
        assert_solves_lcp(solution)
        x, y = np.meshgrid(problem.grid.x(), problem.grid.y())
        np.testing.assert_array_equal(solution.contact, np.hypot(x, y) <= 1)
        radius = np.sqrt(solution.contact.sum() * problem.grid.cell_area / np.pi)
        same_area = FlatCircularPunch.from_approach(radius, punch.e_star, punch.approach)
        errors.append(abs(solution.load / same_area.load - 1))
    assert -np.polyfit([4, 5, 6, 7], np.log2(errors), 1)[0] == pytest.approx(1, abs=0.1)
    assert solution.load == pytest.approx(punch.load, rel=2e-3)
    middle = np.hypot(x, y) < 0.8
    np.testing.assert_allclose(solution.pressure[middle], punch.pressure(x, y)[middle], rtol=0.01)


def test_cone():
    cone = Cone.from_approach(0.05, 100.0, 0.05)  # radius 2/pi of the contact area
    errors, areas = [], []
    for n in (17, 33, 65, 129):  # odd: a cell on the tip
        problem = analytic(cone, n, 1.0)
        solution = solve(problem, cone.approach)
        assert_solves_lcp(solution)
        errors.append(abs(solution.load / cone.load - 1))
        areas.append(solution.contact.sum() * problem.grid.cell_area)
    assert errors[-1] < 2e-3
    assert -np.polyfit(np.log2([17, 33, 65, 129]), np.log2(errors), 1)[0] > 1
    assert areas[-1] == pytest.approx(cone.contact_area, rel=0.02)
