"""Conditions, symmetries and scaling of the solution."""

from itertools import pairwise

import numpy as np
import pytest
from running import solve

from app import ContactProblem, Grid, Material

UNIT = Material.combined(1 / np.pi, 0.0)  # compliance 1

GRID = Grid(40, 31, 0.3, 0.2, x0=-6.0, y0=-3.1)


def bumps(x, y):
    """A shape without any symmetry, with several contact spots."""
    return (
        0.05 * (np.sin(2 * x + 1) + np.cos(3.1 * y + 0.4 * x)) + 0.02 * (x - 0.3) ** 2 + 0.03 * (y + 0.2) ** 2
    )


def solve_bumps(approach=0.05, grid=GRID, shape=bumps, material=UNIT, lcp_rtol=1e-12, **how):
    return solve(ContactProblem(grid, material, shape), approach, lcp_rtol=lcp_rtol, **how)


def test_load_contact_and_displacement_grow_with_the_approach():
    steps = [solve_bumps(approach=d) for d in np.linspace(-0.05, 0.3, 8)]
    loads = np.array([s.load for s in steps])
    assert (np.diff(loads) > 0).all()
    assert (np.diff(loads, 2) > 0).all()  # convex: contact can only get stiffer
    for before, after in pairwise(steps):
        assert (after.displacement >= before.displacement - 1e-12).all()
        assert (after.contact >= before.contact).all()


def test_work_of_the_load_is_the_elastic_energy():
    # dE/d(approach) = F, E = 1/2 p.u dx dy
    low, middle, high = (solve_bumps(approach=d) for d in (0.05 - 1e-4, 0.05, 0.05 + 1e-4))
    energy = [0.5 * GRID.cell_area * np.vdot(s.pressure, s.displacement) for s in (low, high)]
    assert (energy[1] - energy[0]) / 2e-4 == pytest.approx(middle.load, rel=1e-4)
