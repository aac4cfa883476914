"""Windows of a grid."""

import pytest
from cases import bowl

from app import ContactSolver
from app.contact.distance import UndeformedDistance


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_distance_of_a_window_is_freed_with_its_state(monkeypatch, kind):
    """PETSc would keep them until the solver is closed."""
    parts, part_of = [], UndeformedDistance.part_of
    monkeypatch.setattr(UndeformedDistance, "part_of", lambda *of: parts.append(part_of(*of)) or parts[-1])
    with ContactSolver(bowl(256)) as solver:
        solver.solve(**{kind: {"approach": 0.01, "load": 0.05}[kind]})
    assert len(parts) > 1  # of a coarse grid, too
    assert all(not part.rhs for part in parts)
