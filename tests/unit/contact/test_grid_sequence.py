"""The sequence of grids of a nested iteration."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material


@pytest.mark.parametrize("holes_first", [False, True])
def test_first_grid_depends_on_the_problem_only(holes_first):
    """Here the coarsest grid of one problem has no admissible cells."""
    grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    centres = -1 + (np.arange(8) + 0.5) / 4

    def holed(x, y):
        holes = (np.isclose(v[..., None], centres, atol=1e-9).any(axis=-1) for v in np.broadcast_arrays(x, y))
        return np.where(np.logical_and(*holes), np.nan, (x**2 + y**2) / 40)

    steel = Material.combined(80000, 0.3)
    problems = [ContactProblem(grid, steel, gap) for gap in (lambda x, y: (x**2 + y**2) / 40, holed)]
    first, second = problems[::-1] if holes_first else problems
    with ContactSolver(first) as solver, ContactSolver(second) as fresh:
        solver.solve(load=300)
        solver.update(second)
        again, alone = solver.solve(load=300), fresh.solve(load=300)
    np.testing.assert_array_equal(again.pressure, alone.pressure)
