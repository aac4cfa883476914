"""The contact state and the steps of Sec. 4.1."""

import numpy as np
import pytest

from app.contact.distance import UndeformedDistance
from app.contact.state import ContactState, Displacement
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator

GRID = Grid(5, 4, 1.0, 0.5)


def set_pressure(state, p):
    with state.pressure as values:
        values.reshape(p.shape)[...] = p
    state.contact[...] = (p != 0) & state.admissible


def random_pressure(state, seed=1):
    p = np.random.default_rng(seed).normal(size=GRID.shape)
    return np.where(state.admissible, p, 0.0)


def test_expected_displacement_activates_cells(state):
    state.start_from_interpenetration()
    gap = state.gap()
    outside = np.argwhere(state.admissible & (gap > 0))
    cell = tuple(outside[0])
    expected = np.zeros(GRID.shape)
    expected[cell] = -2 * gap[cell]
    before = state.contact.copy()
    assert state.activate_penetrating(expected).added == 1
    assert np.argwhere(state.contact & ~before).tolist() == [list(cell)]


def test_first_contact_is_the_nearest_cell(state):
    state.approach = -10.0
    state.start_from_interpenetration()
    assert not state.cells_in_contact()
    state.first_contact()
    assert state.contact.sum() == 1
    assert state.shape[state.contact] == np.nanmin(state.shape)
    assert state.approach == pytest.approx(np.nanmin(state.shape), abs=1e-12)
    before = state.contact.copy()
    state.first_contact()  # there is contact now
    np.testing.assert_array_equal(state.contact, before)


def test_load_and_gaps_are_sums_over_cells(state):
    p = np.abs(random_pressure(state))
    set_pressure(state, p)
    state.compute_displacement()
    assert state.load == pytest.approx(p.sum() * GRID.cell_area, rel=1e-14)
    e = state.gap()
    where = state.contact | (state.admissible & (e <= 0))
    for gaps, cells in (state.on_contact(), state.contact), (state.on_contact_or_overlap(), where):
        assert gaps.cells == cells.sum()
        assert gaps.residual == pytest.approx(np.linalg.norm(e[cells]), rel=1e-13)
        assert gaps.rms == pytest.approx(np.sqrt(np.mean(e[cells] ** 2)), rel=1e-13)
        assert gaps.mean == pytest.approx(np.mean(e[cells]), rel=1e-12, abs=1e-14)
    h = state.distance.h_at(state.depth)
    assert state.on_contact(with_h=True).h == pytest.approx(np.linalg.norm(h[state.contact]), rel=1e-13)
    assert state.on_contact_or_overlap().load == pytest.approx(state.load, rel=1e-13)
    assert state.cells_in_contact() == np.count_nonzero(state.contact)
    u = state.u.copy()
    state.scale(1.5)
    np.testing.assert_allclose(state.p, 1.5 * p, rtol=1e-15)
    np.testing.assert_allclose(state.u, 1.5 * u, rtol=1e-15)
    assert state.displacement_status is Displacement.EXACT


def test_loads_are_reached_to_rounding_within_the_hardness():
    operator = InfluenceOperator(GRID, UNIT)
    hardness = np.where(np.arange(5) < 2, 3.0, np.inf) + np.zeros(GRID.shape)
    state = ContactState(operator, UndeformedDistance(operator, np.zeros(GRID.shape), hardness=hardness))
    set_pressure(state, np.where(np.arange(5) == 4, 1e6, 2.0) + np.zeros(GRID.shape))
    for load in 1e-6, 10.0, 24.0, 1e3:
        state.reach_load(load)
        assert state.load == pytest.approx(load, rel=1e-14)
        assert (state.p >= 0).all() and (state.p <= hardness).all()
        assert state.displacement_status is Displacement.STALE
    state.contact[:, 2:] = False
    state.reach_load(state.load + 1.0)  # the other cells are plastic
    assert state.load == pytest.approx(1e3, rel=1e-14)
    state.distribute_load(1e4)
    assert (state.p[:, :2] == 3.0).all() and not state.p[:, 2:].any()
    state.destroy()
    state.distance.destroy()


def test_approach_moves_to_the_next_cell_of_a_plateau():
    operator = InfluenceOperator(GRID, UNIT)
    shape = np.arange(20.0).reshape(GRID.shape)
    state = ContactState(operator, UndeformedDistance(operator, shape, hardness=np.full(GRID.shape, 1e-3)))
    set_pressure(state, np.where(shape < 3, 1e-3, 0.0))
    state.contact[...] = False
    state.compute_displacement()
    state.approach_next_cell()
    assert state.contact.sum() == 1 and state.contact.flat[3] and abs(state.gap()[state.contact]) < 1e-14
    state.retreat_to_cell()
    assert state.contact.sum() == 1 and state.contact.flat[2] and abs(state.gap()[state.contact]) < 1e-14
    state.destroy()
    state.distance.destroy()


def test_displacement_status_follows_changes_of_pressure(state):
    set_pressure(state, random_pressure(state))
    state.compute_displacement()
    np.testing.assert_allclose(
        state.u.reshape(-1), dense_matrix(GRID, UNIT) @ state.p.reshape(-1), rtol=1e-13
    )
    assert state.displacement_status is Displacement.EXACT
    correction = state.pressure.duplicate()
    correction.set(0)
    state.add(correction)
    assert state.displacement_status is Displacement.STALE
    correction.destroy()
    state.compute_displacement()
    assert state.release_tensile() > 0
    assert state.displacement_status is Displacement.STALE
