"""Estimated discretisation errors are near the true ones."""

from copy import copy

import numpy as np
import pytest

import app
from app import ContactProblem, Cylinder, Grid, Material, Sphere
from app.contact.grid_errors import GridErrors, GridNumbers, estimate_errors
from benchmarks import grid_errors
from benchmarks.grid_errors import BODIES, Comparison

STEEL = Material.from_contact_modulus(1e5)
LEAST, MOST = 0.7, 10.0  # of estimated over true errors


@pytest.mark.parametrize(
    ("name", "n", "error"),
    [
        *[
            ("log-crowned roller", n, e)
            for n, e in ((12, 0.107), (16, 0.12), (24, 0.098), (32, 0.087), (64, 0.055))
        ],
        ("log-crowned roller, default patch", 256, 0.0105),
        ("sphere, by load", 12, 0.022),
    ],
)
def test_errors_of_maximum_pressures_on_coarse_grids(name, n, error):
    """Two coarse grids agree by chance, or the pressure has a peak in two end cells."""
    found = BODIES[name].solve(n)
    right = found.attributes.get("analytic_max_pressure") if "sphere" in name else 2285.5
    assert abs(found.max_pressure / right - 1) == pytest.approx(error, rel=0.02)
    assert LEAST * error < found.max_pressure_error < MOST * error


def test_the_error_of_an_area_grows_where_few_cells_span_the_contact():
    found = BODIES["sphere, by load"].solve(16)
    error = abs(found.contact_area / found.attributes["analytic_contact_area"] - 1)
    assert LEAST * error < found.contact_area_error < 2 * error


@pytest.mark.parametrize(
    ("name", "grids"),
    [
        ("sphere, by load", (24, 32, 64, 128)),
        ("sphere, by approach", (24, 32, 64, 128)),
        ("log-crowned roller", (32, 64, 128)),
        ("arc-crowned roller", (32, 64, 128)),
        ("cylinder with sharp ends", (64, 128)),
        ("cone", (64, 128)),
        ("elliptic paraboloid", (32, 64, 128)),
        ("punch with rounded edge", (24, 64, 128)),
        ("annulus", (24, 32, 64, 128)),
        ("two balls", (64, 128)),
        ("coated sphere", (32, 64, 128)),
        ("rough sphere", (24, 32, 64)),
        ("wavy cylinder, periodic in y", (64, 128)),
        ("rough surface, periodic", (128, 256)),
    ],
)
def test_estimates_are_near_the_true_errors(name, grids, monkeypatch):
    """docs/notebook/grid-errors.md has more grids. Contacts are ten cells wide or wider."""
    monkeypatch.setattr(grid_errors, "FINE", (256, 512))
    body = copy(BODIES[name])  # without its right values
    for n in grids:
        solution = body.solve(n)
        for quantity in grid_errors.QUANTITIES:
            if getattr(solution, f"{quantity}_error") > 0:
                comparison = Comparison(body, n, solution, quantity)
                assert comparison.allowed, (n, quantity, comparison.estimated, comparison.true)


def test_a_maximum_pressure_at_the_hardness_has_no_error():
    grid = Grid.from_domain(64, 64, (-0.4, 0.4, -0.4, 0.4))
    found = app.solve(ContactProblem(grid, STEEL, Sphere(10), hardness=800.0), load=100)
    assert found.max_pressure == 800 and found.max_pressure_error == 0 < found.approach_error


def rounded_punch(x, y):
    return np.maximum(np.hypot(x, y) - 0.2, 0.0) ** 2 / 0.2


@pytest.mark.parametrize("shape", [rounded_punch, Cylinder(2.0, 0.53)])
@pytest.mark.parametrize("share", [1e-4, 3e-4])
def test_errors_of_edge_pressures_are_not_underestimated(shape, share):
    """At rounded edges, and at sharp ones, where pressures grow with every refinement."""
    found = []
    for n in (64, 128, 256):
        grid = Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5))
        found.append(app.solve(ContactProblem(grid, STEEL, shape), load=share * 1e5))
    *coarse, best = found
    for solution in coarse:
        assert LEAST * abs(solution.max_pressure / best.max_pressure - 1) <= solution.max_pressure_error


def grids_of(*pressures):
    return [GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures]


def pressure_error(*pressures, change=0.0):
    return estimate_errors(grids_of(*pressures), 0.0, ["approach"], change).max_pressure_error


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_estimate_is_the_error_of_any_order(order):
    """Two grids that agree by chance lower it little."""
    values = [1 + 0.3 * 2.0 ** (-order * level) for level in range(5)]
    error = abs(1 - 1 / values[-1])
    assert error * (1 - 1e-12) <= pressure_error(*values) <= 2.4 * error
    assert pressure_error(*values[:-1], values[-2] + 1e-9) >= (values[-3] - values[-2]) / 6


def test_a_maximum_pressure_is_no_better_than_an_unresolved_pressure():
    assert pressure_error(1.0, 1.0001, change=0.2) == 0.2
    assert pressure_error(1.0, 1.0001, change=0.01) < 1e-3
    assert pressure_error(1.0, 1.0001, change=float("nan")) == pytest.approx(1e-4, rel=1e-3)


@pytest.mark.parametrize("growth", [1.0, 2**0.5])
def test_the_error_of_a_divergent_number_is_one(growth):
    """Pressures that grow like the logarithm, or the root, of the number of cells; and those of a rigid punch."""
    steps = np.cumsum(growth ** np.arange(5))
    assert pressure_error(*(1 + steps)) == 1
    # Two differences cannot know.
    assert 0.25 < pressure_error(*(1 + steps)[:3]) < 1
    assert np.isnan(pressure_error(1.0))


def test_only_a_maximum_pressure_may_not_converge():
    grids = [GridNumbers(1.0, 10.0**-k, 1.0, 10.0**-k) for k in range(4)]
    errors = estimate_errors(grids, 0.0, ["load"])
    assert errors.approach_error == errors.contact_area_error == 0.99


def test_errors_without_a_coarser_grid_are_unknown():
    assert np.isnan(GridErrors().largest)
    assert np.isnan(estimate_errors(grids_of(1.0), 0.0, ["load"]).load_error)
