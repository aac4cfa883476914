"""The paper's problems."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipkm1

from app import ContactProblem, FlatPunch, Grid, Material, Paraboloid, SelfAffineSurface
from app.problems.random_surfaces import WavySurface
from app.reference import CappedLineContact

APPROACH = 0.1091  # of Hertz's problem
COUNTS = {32: (5, 73), 64: (7, 122), 128: (8, 176), 256: (9, 250)}  # NORM: active set and CG iterations


def hertz(nx, ny=None):
    """Sec. 5.1."""
    grid = Grid.from_domain(nx, ny or nx, (-10.0, 10.0, -6.0, 6.0))
    return ContactProblem(grid, Material.combined(82000.0, 0.28), Paraboloid(300.0, 163.0))


def punch(nx, ny=None):
    """Sec. 5.2: rough contact."""
    surface = WavySurface((12, 10), 0.8, 0.1, 7, (12.0, 10.0), (-6.0, -5.0))
    grid = Grid.from_domain(nx, ny or nx, (-6.0, 6.0, -5.0, 5.0))
    return ContactProblem(grid, Material.combined(80000.0, 0.28), FlatPunch(8.97), surfaces=[surface])


def self_affine(n, shortest_cells=4, seed=1, hurst=0.8, rolloff=1 / 8):
    """Self-affine surface under a flat rigid body, patch of 1 mm; the rms slope is 0.1."""
    grid = Grid.from_domain(n, n, (0.0, 1.0, 0.0, 1.0))
    surface = SelfAffineSurface(hurst, rolloff, shortest_cells / n, (1.0, 1.0), seed, rms_slope=0.1)
    height = surface.height(grid.x(), grid.y())
    return ContactProblem(grid, Material.combined(80000.0, 0.3), height.max() - height)


def periodic_rough(n, cutoff=1 / 16):
    """Self-affine surface under a flat rigid body, periodic on 1 mm; the same on every grid; the rms slope is 0.1."""
    grid = Grid.from_domain(n, n, (0.0, 1.0, 0.0, 1.0), "spectral")
    surface = SelfAffineSurface(0.8, 0.25, cutoff, (1.0, 1.0), 3, rms_slope=0.1)
    return ContactProblem(grid, Material.combined(80000.0, 0.3), surfaces=[surface])


def bowl(n):
    """A paraboloid; contacts of small approaches need a window only."""
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    return ContactProblem(grid, Material.combined(1.0, 0.0), grid.x() ** 2 + grid.y()[:, None] ** 2)


def sphere_pressure(n, half=1.2):
    """Hertz's pressure under a sphere with p0 = 1 and a = 1, as means over parts of the cells, and its grid."""
    grid, fine = (Grid.from_domain(cells, cells, (-half, half, -half, half)) for cells in (n, 8 * n))
    p = np.sqrt(np.maximum(1 - fine.x() ** 2 - fine.y()[:, None] ** 2, 0))
    return p.reshape(n, 8, n, 8).mean(axis=(1, 3)), grid


def assert_counts_of_norm(n, solution):
    """Compare with `COUNTS`."""
    # The count of CG iterations depends on round-off: the problem is symmetric about both axes, so only
    # round-off makes unsymmetric components, which grow until CG has to remove them.
    outer, inner = COUNTS[n]
    assert solution.iterations == outer
    assert solution.inner_iterations == pytest.approx(inner, rel=0.03, abs=3)


def capped_line(radius, e_star, a, c):
    """`CappedLineContact` with half-width a and plastic half-width c < a."""
    rest = (a - c) * (a + c) / a**2
    k, e = ellipkm1(rest), ellipe(1 - rest)
    load = np.pi * e_star * a**2 / (2 * radius) * (e / k - rest / 2)
    return CappedLineContact(radius, e_star, float(np.pi * e_star * a / (4 * radius * k)), float(load))
