"""Small periodic problems, and their solution by a method that shares nothing with ours."""

import numpy as np

from app import ContactProblem, Grid, Material
from app.verification.dense import DenseProblem

MATERIAL = Material.combined(1.0, 0.0)


def rough(nx, ny, seed, holes=0.0, symbol="spectral", noise=0.004):
    """Waves and noise."""
    grid, rng = Grid(nx, ny, 1 / nx, 0.8 / ny), np.random.default_rng(seed)
    x, y = (2 * np.pi * np.arange(n) / n for n in (nx, ny))
    height = 0.02 * (np.cos(x) + np.cos(2 * y + 1)[:, None]) + noise * rng.normal(size=grid.shape)
    gap = height.max() - height
    gap[rng.random(grid.shape) < holes] = np.nan
    return ContactProblem(grid, MATERIAL, gap, periodic=symbol)


def by_pivoting(problem, approach):
    """Pressure by pivoting on the dense matrix, and that matrix."""
    dense = DenseProblem(problem)
    return dense.at(approach).astype(float), dense.matrix
