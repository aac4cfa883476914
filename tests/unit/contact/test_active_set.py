"""The active set iteration: order of the steps of Sec. 4.1, by hand."""

import numpy as np
import pytest
from cases import periodic_rough
from running import solve

from app import Grid
from app.contact.active_set import active_set
from app.contact.distance import UndeformedDistance
from app.contact.history import History
from app.contact.loading import PrescribedApproach
from app.contact.state import ContactState
from app.contact.stopping import StoppingTest
from app.halfspace.influence import dense_matrix
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator


def make_state(shape, approach=0.0):
    """State on a row of unit cells of compliance 1."""
    operator = InfluenceOperator(Grid(len(shape), 1, 1.0, 1.0), UNIT)
    state = ContactState(operator, UndeformedDistance(operator, np.array([shape], float)))
    state.approach = approach
    return state


class FixedPressure:
    """A linear solver whose solution gives a fixed pressure."""

    level, work_units = 0, 0.0

    def __init__(self, state, pressure):
        self._state, self._pressure = state, np.array(pressure, float)
        self._correction = state.pressure.duplicate()

    def set_contact(self):
        pass

    def solve(self, right, allowed):
        self._correction.setArray(self._pressure - self._state.pressure.getArray(readonly=True))
        return self._correction, 1, ""

    def destroy(self):
        self._correction.destroy()


def run_one_iteration(shape, contact, pressure, approach=0.0):
    """Run one iteration from a contact set, with the pressure of the linear solver."""
    state = make_state(shape, approach)
    state.contact[...] = [contact]
    history, solver = History(), FixedPressure(state, pressure)
    active_set(state, solver, PrescribedApproach(approach), StoppingTest(max_it=1), history)
    p = state.p.reshape(-1)
    found = p.tolist(), state.contact[0].astype(int).tolist(), state.u[0].copy(), history.entries[0]
    for part in (solver, state, state.distance):
        part.destroy()
    return found


def counts(entry):
    return tuple(entry[name] for name in ("contact_cells", "added_cells", "dropped_cells", "changed_cells"))


A = dense_matrix(Grid(3, 1, 1.0, 1.0), UNIT)


def test_tensile_pressure_is_removed_before_u_is_computed():
    p, contact, u, entry = run_one_iteration([-2, 1, 5], [1, 1, 0], [1.0, -0.5, 0])
    assert p == [1, 0, 0]
    np.testing.assert_allclose(u, A @ [1, 0, 0], rtol=1e-14)
    assert contact == [1, 0, 0]
    assert counts(entry) == (1, 0, 1, 1)


def test_released_cell_enters_again_if_it_overlaps_without_its_tension():
    # h between: with the pull of cell 1 itself it would overlap, without it does not, and the other way round.
    pull = A @ [1, -0.5, 0]
    free = A @ [1, 0, 0]
    assert pull[1] < free[1]
    between = -(pull[1] + free[1]) / 2
    assert run_one_iteration([-2, between, 5], [1, 1, 0], [1.0, -0.5, 0])[1] == [1, 0, 0]
    deeper = -free[1] - 1e-9
    _, contact, _, entry = run_one_iteration([-2, deeper, 5], [1, 1, 0], [1.0, -0.5, 0])
    assert contact == [1, 1, 0]
    assert counts(entry) == (2, 0, 0, 0)


def test_overlapping_and_touching_cells_enter():
    u2 = (A @ [1, 0, 0])[2]
    for h2, expected in ((-u2 - 1e-9, 1), (-u2, 1), (-u2 + 1e-9, 0)):
        _, contact, _, entry = run_one_iteration([0, 5, h2], [1, 0, 0], [1.0, 0, 0])
        assert contact == [1, 0, expected]
        assert counts(entry) == (1 + expected, expected, 0, expected)


def test_cells_with_positive_pressure_stay_whatever_their_gap():
    # Only the sign of the pressure decides: the linear solver need not have converged.
    _, contact, _, entry = run_one_iteration([7, -7, 9], [1, 1, 0], [1.0, 2.0, 0])
    assert contact == [1, 1, 0]
    expected = np.linalg.norm(np.array([7, -7]) + (A @ [1, 2, 0])[:2]) / np.linalg.norm([7, -7, 9])
    assert entry["residual"] == pytest.approx(expected, rel=1e-14)


def test_inadmissible_cells_never_enter():
    _, contact, u, entry = run_one_iteration([-1, np.nan, -1], [1, 0, 0], [0, 0, 0])
    assert contact == [1, 0, 1]
    assert np.isfinite(u).all()
    assert counts(entry) == (2, 1, 0, 1)


@pytest.mark.parametrize("method", ["norm", "fmg_v11"])
def test_iteration_limit_counts_iterations_in_a_row(method):
    """A search for a load makes several such rows."""
    solution = solve(periodic_rough(32), None, method, load=20.0, lcp_max_it=1)
    assert not solution.converged
    assert solution.message.startswith("1 active set iterations in a row were not enough")
    assert solution.iterations > 1
