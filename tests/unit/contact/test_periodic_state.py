"""The contact state on periodic patches."""

import numpy as np
import periodic
import pytest

from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.halfspace.operator import InfluenceOperator


def test_one_cell_stays_open_below_full_contact():
    problem = periodic.rough(12, 10, 2)
    operator = InfluenceOperator(problem.grid, problem.material.kernel)
    state = contact_state(operator, UndeformedDistance(operator, problem.gap))
    state.approach = 2 * problem.gap.mean()
    assert state.approach == pytest.approx(problem.gap.mean(), rel=1e-9)
    assert state.approach < problem.gap.mean()
    state.contact[...] = True
    state.leave_full_contact()
    assert np.flatnonzero(~state.contact) == problem.gap.argmax()
    energy, cells = operator.energy_of_contact()
    assert cells == problem.grid.n - 1
    assert energy == pytest.approx(operator.diagonal, rel=1e-9)  # p = 1 is p = -1 on what is open
