"""Nested iteration of the primal form."""

import numpy as np
import periodic

from app import ContactProblem, ContactSolver, Grid, Material


def test_a_start_leaves_out_coarser_grids():
    problem = periodic.rough(64, 64, 8)
    approach = 0.3 * np.nanmean(problem.gap)
    with ContactSolver(problem) as solver:
        first = solver.solve(approach=approach)
        again = solver.solve(approach=approach, start=first)
    assert len(set(first.history["level"])) > 1
    assert len(set(again.history["level"])) == 1


def test_stiff_coating_under_a_light_load_takes_few_products():
    """A half-space takes 12 products."""
    n, rng = 256, np.random.default_rng(1)
    k = np.hypot(np.fft.fftfreq(n, 1 / n)[:, None], np.fft.fftfreq(n, 1 / n))
    spectrum = np.where((k > 0) & (k <= n / 8), np.maximum(k, 4) ** -1.8, 0)
    z = np.fft.ifft2(np.fft.fft2(rng.standard_normal((n, n))) * spectrum).real
    z *= 0.01 / z.std()
    coating = Material.coated((5.0, 1.0), (0.3, 0.3), 10.0)
    with ContactSolver(
        ContactProblem(Grid(n, n, 1.0, 1.0, periodic="spectral"), coating, z.max() - z)
    ) as solver:
        solution = solver.solve(mean_pressure=2e-5)
    assert solution.converged and not solution.fallbacks
    assert solution.operator_applications < 18
