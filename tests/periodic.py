"""Small periodic problems, and their solution by a method that shares nothing with ours."""

import numpy as np

from app import ContactProblem, Grid, Material
from app.halfspace.influence import dense_matrix

MATERIAL = Material(1.0, 0.0)


def rough(nx, ny, seed, holes=0.0, symbol="spectral", noise=0.004):
    """Waves and noise."""
    grid, rng = Grid(nx, ny, 1 / nx, 0.8 / ny), np.random.default_rng(seed)
    x, y = (2 * np.pi * np.arange(n) / n for n in (nx, ny))
    height = 0.02 * (np.cos(x) + np.cos(2 * y + 1)[:, None]) + noise * rng.normal(size=grid.shape)
    gap = height.max() - height
    gap[rng.random(grid.shape) < holes] = np.nan
    return ContactProblem(grid, MATERIAL, gap, periodic=symbol)


def by_pivoting(problem, approach):
    """Pressure by block principal pivoting on the dense matrix (Judice and Pires), and that matrix."""
    matrix, h = dense_matrix(problem.grid, problem.material.compliance), (problem.gap - approach).ravel()
    inside = np.flatnonzero(~np.isnan(h))
    a, h = matrix[np.ix_(inside, inside)], h[inside]
    contact, fewest, patience = h < 0, len(h) + 1, 3
    while True:
        p = np.zeros(len(h))
        p[contact] = np.linalg.solve(a[np.ix_(contact, contact)], -h[contact])
        e = h + a @ p
        wrong = (contact & (p < -1e-13 * abs(p).max())) | (~contact & (e < -1e-13 * abs(h).max()))
        if not wrong.any():
            break
        patience = 3 if wrong.sum() < fewest else patience - 1
        fewest = min(fewest, wrong.sum())
        flips = wrong if patience > 0 else np.arange(len(h)) == np.flatnonzero(wrong)[-1]
        contact = contact ^ flips
        contact[np.argmax(h)] &= not contact.all()  # A is singular on all cells
    full = np.zeros(problem.grid.n)
    full[inside] = np.maximum(p, 0)
    return full.reshape(problem.grid.shape), matrix
