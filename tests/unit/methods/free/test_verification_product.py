"""Verification product of a window."""

import gc
import weakref

import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material


def bowl(n, height=1.0):
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    x, y = np.meshgrid(grid.x(), grid.y())
    return ContactProblem(grid, Material.combined(1.0, 0.0), height * (x**2 + y**2))


def test_field_of_all_cells_is_freed_after_a_solve():
    with ContactSolver(bowl(160)) as solver:
        field = weakref.ref(solver.solve(approach=0.1).displacement)
        gc.collect()
        assert field() is None
