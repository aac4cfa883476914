"""Contacts of a few cells, found by load: hardly dearer than by approach, and the safeguard rests."""

import numpy as np
import pytest
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material

MATERIAL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(256, 256, (0.0, 1.0, 0.0, 1.0))
X, Y = np.meshgrid(GRID.x(), GRID.y())
SHAPES = {
    "sphere": ((X - 0.5) ** 2 + (Y - 0.5) ** 2) / 2,
    "cone": 0.1 * np.hypot(X - 0.5, Y - 0.5),
    "tilted plane": 0.01 * X + 0.003 * Y,
    "two corners": np.minimum((X - 0.02) ** 2 + (Y - 0.02) ** 2, (X - 0.98) ** 2 + (Y - 0.98) ** 2),
}


@pytest.mark.parametrize("gap", SHAPES.values(), ids=SHAPES.keys())
def test_a_light_load_costs_little_more_than_its_approach(gap):
    """Once the secant between two updates by one pressure confirmed whatever slope there was, grid after grid."""
    problem = ContactProblem(GRID, MATERIAL, gap)
    for load in (0.01, 0.1, 1.0, 10.0):
        by_load = solve(problem, None, "fast", load)
        assert by_load.converged and not by_load.fallbacks
        assert by_load.load == pytest.approx(load, rel=1e-6)
        by_approach = solve(problem, by_load.approach, "fast")
        assert by_load.operator_applications <= 3 * by_approach.operator_applications


@pytest.mark.parametrize("load", [0.1, 0.316, 1.0])
def test_progress_is_measured_from_when_the_load_was_met(load):
    """The first contact of noise is a cell or two without residual; then the load lets a thousand in."""
    gap = 0.01 * np.random.default_rng(0).random(GRID.shape)
    found = solve(ContactProblem(GRID, MATERIAL, gap), None, "fast", load)
    assert found.converged and not found.fallbacks
    assert found.operator_applications < 27


def test_levels_are_not_to_blame_for_cells_that_enter():
    gap = 0.002 * (2 - np.cos(16 * np.pi * X) - np.cos(16 * np.pi * Y))
    found = solve(ContactProblem(GRID, MATERIAL, gap), None, "fast", 0.05)
    assert found.converged
    assert found.operator_applications < 15


@pytest.mark.parametrize("aspect", [1.0, 1.7, 3.0, 10.0, 0.1])
@pytest.mark.parametrize("loading", [{"mean_pressure": 1000.0}, {"approach": 5e-3}], ids=["load", "approach"])
def test_fine_texture_on_a_part_of_a_flat_patch(aspect, loading):
    """Residuals that alternate from cell to cell: contact sets came back for ever where cells were stretched."""
    nx, ny = 300, 260
    i, j = np.arange(nx), np.arange(ny)[:, None]
    gap = np.where((i < nx // 3) & (j < ny // 3), (i + j) % 2, 1) * 1e-3
    problem = ContactProblem(Grid(nx, ny, 1e-3, aspect * 1e-3), Material.combined(80000.0, 0.3), gap)
    with ContactSolver(problem) as solver:
        found = solver.solve(**loading)
    assert found.converged and not found.fallbacks and found.operator_applications <= 40
