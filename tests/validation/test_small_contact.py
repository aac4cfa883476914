"""Contacts of a few cells, found by load: hardly dearer than by approach, and the safeguard rests."""

import numpy as np
import pytest
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material
from app.verification.dense import DenseProblem

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


@pytest.mark.parametrize("periodic", [False, "spectral", "love"])
@pytest.mark.parametrize("far", [1e3, 1e9, 1e12, 1e15])
def test_asperities_among_cells_far_away(far, periodic):
    """On coarse grids all cells are far away, and the approach with them; the answer is that of the asperities."""
    rng, grid = np.random.default_rng(1), Grid(16, 16, 1.0, 1.0)
    high, among = 1e-3 * rng.random(6), rng.choice(grid.n, 6, replace=False)
    gap = far * (1 + rng.random(grid.shape))
    gap.flat[among] = high - high.min()
    problem = ContactProblem(grid, MATERIAL, gap, periodic=periodic)
    for load in (1e-9, 1e-3, 100.0):
        found, dense = solve(problem, None, None, load), DenseProblem(problem)
        error = dense.energy(found.pressure - dense.under(load, found.approach)[0])
        assert found.converged
        assert error <= (found.error_bound + 1e-14) * dense.energy(found.pressure)


@pytest.mark.parametrize("heights", ["plateaus", "summits"])
@pytest.mark.parametrize("symbol", ["spectral", "love"])
def test_pressures_are_proportional_to_a_light_load_on_what_is_equally_high(heights, symbol):
    rng, grid = np.random.default_rng(2), Grid(24, 12, 1.0, 1.0)
    plateaus = rng.integers(0, 3, grid.shape) * 1.0
    gap = plateaus if heights == "plateaus" else np.where(rng.random(grid.shape) < 0.02, 0.0, 1 + plateaus)
    problem, first = ContactProblem(grid, MATERIAL, gap, periodic=symbol), None
    for mean_pressure in 10.0 ** -np.arange(3, 19, 3):
        with ContactSolver(problem, options={"lcp_error_bound": 1e-4}) as solver:
            found = solver.solve(mean_pressure=mean_pressure)
        assert found.converged and not found.fallbacks
        first = found.pressure / mean_pressure if first is None else first
        np.testing.assert_allclose(found.pressure / mean_pressure, first, atol=1e-3 * first.max())


@pytest.mark.parametrize("method", [None, "norm", "fmg_lift"])
@pytest.mark.parametrize("periodic", [False, True], ids=["free", "periodic"])
def test_where_rounding_keeps_the_tolerance_from_being_met_the_load_is_and_the_advice_is_right(
    periodic, method
):
    gap = 1e-3 * np.random.default_rng(5).random((32, 32))
    problem = ContactProblem(Grid(32, 32, 1 / 32, 1 / 32), MATERIAL, gap, periodic=periodic)
    for load in (1e-5, 1.0, 30.0, 300.0):
        found = solve(problem, None, method, load, lcp_rtol=1e-16)
        assert found.load == pytest.approx(load, rel=1e-9)
        assert found.error_bound < 1e-11
        assert found.converged or "choose a larger one" in found.message, found.message


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
