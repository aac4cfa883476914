"""The full multigrid scheme: prolongation to the next grid."""

import numpy as np
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem, Material
from app.methods import strategy
from app.methods.free.lift import lift


def test_lift_replaces_copy_in_any_unit_of_pressure(monkeypatch):
    grid, shape, trusted, found = hertz(32).grid, hertz(32).shape, [], []
    monkeypatch.setattr(strategy.lift, "lift", lambda *of: trusted.append(lift(*of)) or trusted[-1])
    for modulus in (82000.0, 82e-8):
        problem = ContactProblem(grid, Material.combined(modulus, 0.28), shape)
        found.append(solve(problem, APPROACH, "fmg_lift"))
    assert trusted and all(trusted)
    np.testing.assert_array_equal(found[0].contact, found[1].contact)
    assert found[0].history["changed_cells"] == found[1].history["changed_cells"]
