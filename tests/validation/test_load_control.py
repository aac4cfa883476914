"""What a prescribed load costs against the approach it leads to, by count: self-affine surfaces to full contact."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid
from benchmarks.loads import MATERIAL, SLOPE, SPECTRA

RELATIVE_LOADS = (0.003, 0.02, 0.09, 0.4, 0.9, 2.0)  # mean pressure / (E* rms slope): contact from 1% to 99%
LIGHT = 12.0  # applications by approach: contacts of some hundred cells, which by approach are found almost at once


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("spectrum", SPECTRA[::2], ids=str)
@pytest.mark.parametrize("size", [128, 256])
def test_a_load_costs_little_more_than_its_approach(size, spectrum, seed):
    grid = Grid.from_domain(size, size, (0.0, 1.0, 0.0, 1.0))
    height = spectrum.height(grid, seed)
    ratios = []
    with ContactSolver(ContactProblem(grid, MATERIAL, height.max() - height)) as solver:
        for relative in RELATIVE_LOADS:
            load = relative * MATERIAL.contact_modulus * SLOPE
            by_load = solver.solve(load=load)
            by_approach = solver.solve(approach=by_load.approach)
            assert by_load.converged and by_approach.converged
            assert by_load.fallbacks == by_approach.fallbacks == 0
            assert by_load.load == pytest.approx(load, rel=1e-12)
            ratios.append(by_load.operator_applications / max(by_approach.operator_applications, LIGHT))
    assert max(ratios) <= 1.6
    assert np.mean(ratios) <= 1.25


def test_a_secant_of_two_residuals_is_not_believed():
    """On the grid before the last one it says that the load falls with the approach: once 291 applications."""
    grid = Grid.from_domain(512, 512, (0.0, 1.0, 0.0, 1.0))
    height = SPECTRA[2].height(grid, 1)
    with ContactSolver(ContactProblem(grid, MATERIAL, height.max() - height)) as solver:
        solution = solver.solve(load=0.02 * MATERIAL.contact_modulus * SLOPE)
    assert solution.converged and solution.fallbacks == 0 and solution.operator_applications <= 20
