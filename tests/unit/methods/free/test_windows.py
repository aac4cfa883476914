"""Windows of a grid."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.distance import UndeformedDistance


def bowl(n, height=1.0):
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    x, y = np.meshgrid(grid.x(), grid.y())
    return ContactProblem(grid, Material.combined(1.0, 0.0), height * (x**2 + y**2))


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_distance_of_a_window_is_freed_with_its_state(monkeypatch, kind):
    """PETSc would keep them until the solver is closed."""
    parts, part_of = [], UndeformedDistance.part_of
    monkeypatch.setattr(UndeformedDistance, "part_of", lambda *of: parts.append(part_of(*of)) or parts[-1])
    with ContactSolver(bowl(256)) as solver:
        solver.solve(**{kind: {"approach": 0.01, "load": 0.05}[kind]})
    assert len(parts) > 1  # of a coarse grid, too
    assert all(not part.rhs for part in parts)
