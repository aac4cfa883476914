"""Solutions and random problems for the checks."""

import warnings
from dataclasses import replace

import numpy as np

from app.api.solver import ContactSolver
from app.base.errors import NoteWarning
from app.halfspace.grid import ONE_WAY, SYMBOLS, Grid
from app.halfspace.material import Material
from app.options.method import list_methods
from app.problems.contact_problem import ContactProblem

UNIT = Material.combined(1 / np.pi, 0.0)  # material with compliance 1
# Kinds of patches: free, periodic with either symbol, and periodic in one direction.
PATCHES = "", "spectral", "love", "y"


def patches(quick):
    """Return the kinds of patches to check."""
    return ("", "spectral", "y") if quick else PATCHES


def patch_name(periodic):
    """Return the name of a kind of patch in figures."""
    return f"periodic in {periodic}" if periodic in ONE_WAY else periodic or "free"


def approach_at(problem, share):
    """Return the approach least gap + `share` * (mean gap - least gap) [mm]."""
    least = np.nanmin(problem.gap)
    return least + share * (np.nanmean(problem.gap) - least)


def solved(problem, method=None, comm=None, start=None, options=None, **loading):
    """Return the solution of a problem, converged or not, without warnings.

    Collective over `comm`.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "not converged", RuntimeWarning)
        warnings.simplefilter("ignore", NoteWarning)
        with ContactSolver(problem, method, options, comm) as solver:
            return solver.solve(start=start, **loading)


def methods(periodic):
    """Return the names of the method files for a kind of patch and all bodies."""
    other = "fast" if periodic in SYMBOLS else "primal"
    return [name for name in list_methods() if name not in ("film", other)]


def random_problem(rng, nx, ny, periodic="", holes=True):
    """Return a random problem of waves, noise or terraces.

    Half of the problems have holes. Cells are up to four times longer than wide.
    """
    x, y = 2 * np.pi * (np.arange(nx) + 0.5) / nx, 2 * np.pi * (np.arange(ny)[:, None] + 0.5) / ny
    waves = np.cos(x + rng.uniform(0, 6)) + np.cos(2 * y + rng.uniform(0, 6)) + np.cos(3 * x - y)
    noise = rng.normal(size=(ny, nx))
    height = [waves + 0.1 * noise, waves + noise, np.round(2 * waves + noise)][rng.integers(3)]
    gap = 0.01 * (height.max() - height)
    if holes and rng.random() < 0.5:
        gap[rng.random(gap.shape) < 0.1] = np.nan
    grid = Grid(nx, ny, 0.1, 0.1 * rng.choice([1.0, 0.7, 4.0]))
    return ContactProblem(grid, UNIT, gap, periodic=periodic)


def with_hardness(rng, problem, largest):
    """Return a problem with random hardness of each cell.

    The hardness is 5% to 105% of the `largest` pressure. In a third of the problems a fifth of the cells is elastic.
    """
    hardness = largest * (0.05 + rng.random(problem.grid.shape))
    if rng.random() < 1 / 3:
        hardness[rng.random(hardness.shape) < 0.2] = np.inf
    return replace(problem, hardness=hardness)


def difference(found, expected):
    """Return two fields' largest difference, divided by `expected`.

    The divisor is the largest expected value.
    """
    return float(abs(found - expected).max() / (abs(expected).max() or 1.0))
