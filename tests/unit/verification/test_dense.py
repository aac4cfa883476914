"""Exact solutions of small problems."""

from fractions import Fraction

import numpy as np
import pytest

from app import ContactProblem, Grid, Material
from app.verification.dense import DenseProblem, solve_by_lemke


@pytest.mark.parametrize("seed", range(20))
def test_lemke_and_pivoting_meet_all_conditions(seed):
    """Ties and zeros are likely, A is singular where the patch is periodic."""
    rng = np.random.default_rng(seed)
    periodic = ("", "spectral")[seed % 2]
    gap = rng.integers(0, 4, (2, 3)).astype(float)
    problem = ContactProblem(Grid(3, 2, 1.0, 0.5), Material.combined(1.0, 0.0), gap, periodic=periodic)
    dense, approach = DenseProblem(problem), 0.9 * gap.mean()
    p = solve_by_lemke(dense.matrix, gap.ravel() - approach)
    e = gap.ravel() - approach + dense.matrix @ p
    assert (p >= 0).all() and e.min() >= -1e-14 and abs(p * e).max() <= 1e-13
    np.testing.assert_allclose(dense.at(approach).ravel().astype(float), p, rtol=0, atol=1e-14 * p.max())
    for guess in 0.0, 0.99 * approach, 1.01 * approach:
        by_load, found = dense.under(float(p.sum()) * problem.grid.cell_area, guess)
        assert found == pytest.approx(approach, rel=1e-12)
        np.testing.assert_allclose(by_load.ravel().astype(float), p, rtol=0, atol=1e-12 * (p.max() or 1))


def test_pivoting_ends_at_the_edge_of_full_contact():
    """There rounding could take turns with the last cell."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        ny, nx = map(int, rng.integers(2, 9, 2))
        x, y = np.linspace(0, 1, nx), np.linspace(0, 1, ny)[:, None]
        gap = np.cos(7 * x + rng.uniform(0, 6)) + np.cos(5 * y + 2 * x)
        problem = ContactProblem(
            Grid(nx, ny, 0.1, 0.1), Material.combined(8e4, 0.3), gap, periodic="spectral"
        )
        full = DenseProblem(problem).at(gap.mean() + 1).astype(float)
        for less in 0, 1e-16, 1e-15:
            p = DenseProblem(problem).at(gap.mean() - less).astype(float)
            np.testing.assert_allclose(p, full, rtol=0, atol=1e-11 * full.max())


def test_pivoting_loses_no_digits_on_long_cells():
    """Coefficients are much larger than the eigenvalue of a wave across the cells."""
    wave = np.tile([1.0, 0.0, -1.0, 0.0], (16, 1))
    grid, material = Grid(4, 16, 1.0, 1e3), Material.from_contact_modulus(1.0)
    full = DenseProblem(ContactProblem(grid, material, wave, periodic="spectral")).at(2.0)
    # E* |q| / 2 times the displacement, and a constant
    np.testing.assert_allclose(full.astype(float), np.pi / 4 * (1 - wave), rtol=0, atol=1e-15)


@pytest.mark.parametrize("depth", [1e-13, 1e-17])
def test_mean_gaps_lose_no_digits_near_first_touch(depth):
    gap = np.array([[0.0, 1.0, 3.0, 1.0, 3.0, 1.0, 2.0]])  # with a mean of 11/7
    mean_gap = 11 / 7 - depth
    exact = float(Fraction(11, 7) - Fraction(mean_gap))
    problem = ContactProblem(
        Grid(7, 1, 1.0, 1.0), Material.from_contact_modulus(1.0), gap, periodic="spectral"
    )
    dense = DenseProblem(problem)
    by_approach, found = dense.at(exact), dense.with_mean_gap(mean_gap)
    np.testing.assert_allclose(found.astype(float), by_approach.astype(float), rtol=1e-14, atol=0)
