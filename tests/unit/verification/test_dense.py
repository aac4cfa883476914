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


def limited_problem(seed):
    """Few cells with ties, a hardness of each cell, and holes."""
    rng = np.random.default_rng(seed)
    gap = rng.integers(0, 4, (2, 3)).astype(float) if seed % 3 else 3 * rng.random((2, 3))
    if seed % 5 == 0:
        gap.flat[rng.choice(6, 2)] = np.nan
    periodic = ("", "spectral")[seed % 2]
    hardness = rng.choice([0.1, 0.3, 0.5, 1.0, np.inf, np.inf], (2, 3))
    grid, material = Grid(3, 2, 1.0, 0.5), Material.combined(1.0, 0.0)
    return ContactProblem(grid, material, gap, periodic=periodic, hardness=hardness), hardness


@pytest.mark.parametrize("seed", range(20))
def test_lemke_and_pivoting_agree_with_a_hardness(seed):
    problem, hardness = limited_problem(seed)
    dense, mean = DenseProblem(problem), np.nanmean(problem.gap)
    inside, upper = dense.inside, hardness.ravel()[dense.inside]
    matrix = dense.matrix[np.ix_(inside, inside)]
    for approach in 0.6 * mean, 0.9 * mean, 1.2 * mean:
        if approach > mean and problem.periodic and np.isinf(upper).all():
            continue
        h = problem.gap.ravel()[inside] - approach
        p = solve_by_lemke(matrix, h, upper)
        e = h + matrix @ p
        assert (p >= 0).all() and (p <= upper).all()
        assert e[p < upper].min(initial=0) >= -1e-13 and e[p > 0].max(initial=0) <= 1e-13
        found = dense.at(approach).ravel()[inside].astype(float)
        np.testing.assert_allclose(found, p, rtol=0, atol=1e-13 * p.max())
        load = float(p.sum()) * problem.grid.cell_area
        for guess in 0.99 * approach, 1.01 * approach:
            by_load, smallest = dense.under(load, guess)
            np.testing.assert_allclose(by_load.ravel()[inside].astype(float), p, rtol=0, atol=1e-12 * p.max())
            if load:  # without an elastic cell it is at the lower end of an interval
                assert smallest <= approach * (1 + 1e-12)
                again = dense.at(smallest + 1e-12).ravel()[inside].astype(float)
                np.testing.assert_allclose(again, p, rtol=0, atol=1e-10)


@pytest.mark.parametrize("periodic", ["", "spectral"])
def test_largest_load_has_the_smallest_approach(periodic):
    rng = np.random.default_rng(1)
    gap, hardness = rng.random((4, 5)), 0.05 + 0.1 * rng.random((4, 5))
    grid, material = Grid(5, 4, 1.0, 0.5), Material.combined(1.0, 0.0)
    dense = DenseProblem(ContactProblem(grid, material, gap, periodic=periodic, hardness=hardness))
    p, approach = dense.under(dense.largest_load, 0.5)
    np.testing.assert_array_equal(p.astype(float), hardness)
    depths = approach - gap - (dense.matrix @ hardness.ravel()).reshape(gap.shape)
    assert abs(depths.min()) < 1e-14
    less, lower = dense.under(dense.largest_load * (1 - 1e-12), 0.5)
    assert ((less < hardness).sum(), (less > 0).all()) == (1, True) and lower < approach
    with pytest.raises(ValueError, match="larger than"):
        dense.under(dense.largest_load * (1 + 1e-12), 0.5)


def test_hardness_continues_beyond_full_contact():
    """Every cell but the lowest is elastic, then fewer, in an approach above the mean."""
    gap = np.array([[0.0, 1.0, 3.0, 1.0, 3.0, 1.0, 2.0]])
    grid, material = Grid(7, 1, 1.0, 1.0), Material.from_contact_modulus(1.0)
    full = DenseProblem(ContactProblem(grid, material, gap, "spectral")).at(gap.mean()).astype(float)
    hardness = 1.5 * full.max()
    dense = DenseProblem(ContactProblem(grid, material, gap, "spectral", hardness=hardness))
    np.testing.assert_array_equal(dense.at(gap.mean()).astype(float), full)
    p = dense.at(gap.mean() + 1e-9).astype(float)
    np.testing.assert_allclose(p, full + 0.5 * full.max(), rtol=0, atol=1e-8)
    assert (p == hardness).sum() == 1
    by_load, approach = dense.under(float(full.sum() + 0.1 * full.max()), 1.0)
    assert approach == gap.mean() and (by_load < hardness).all()
    assert (dense.at(gap.max() + 1).astype(float) == hardness).all()
