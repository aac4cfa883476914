"""Unknowns of the primal form, step by step."""

import numpy as np
import pytest
from operators import random_field

from app.contact.prescribed_load import PrescribedLoad
from app.contact.state import Displacement


def test_solver_resumes_without_a_product(guessed, loading, pressure_of):
    """w and p change at `commit` only; changes add up from set to set."""
    primal, solver = guessed(loading)
    w, p, norms = primal.w.copy(), primal.p.copy(), []
    for _ in range(3):
        norms.append(solver.improve(primal, 0.0)[2])
        primal.exchange(solver, 0.0, -np.inf, np.inf, norms[-1])  # releases only
        assert primal.pending and (primal.w == w).all()
        np.testing.assert_allclose(primal.p - p, (primal.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
        expected = pressure_of(primal, w + solver.change)
        np.testing.assert_allclose(solver.carried, expected, rtol=0, atol=1e-11 * abs(expected).max())
    with primal.shown(solver):
        np.testing.assert_array_equal(primal.p, solver.carried)
    np.testing.assert_allclose(primal.p - p, (primal.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
    primal.commit(solver)
    assert not primal.pending and not primal.approximate
    np.testing.assert_allclose(primal.w, w + solver.change, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(primal.p, solver.carried)
    taken = primal.w.copy()
    primal.commit(solver)  # there is nothing more
    assert (primal.w == taken).all()


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_each_step_keeps_p_and_the_loading(steps, loading, holes, pressure_of):
    """p = B w + mean pressure; prescribed means hold; w = b on C."""
    primal, solver = steps(loading, holes)
    given = not primal.loading.approach_is_known
    primal.w[...] = random_field(primal.grid, 8) * 0.01

    def check(closed=True):
        np.testing.assert_allclose(primal.p, pressure_of(primal), rtol=0, atol=1e-11 * abs(primal.p).max())
        if given:
            assert primal.load == pytest.approx(primal.loading.load, rel=1e-9)
        else:
            assert primal.depth == pytest.approx(primal.prescribed_depth, rel=1e-9)
        assert not primal.contact[~primal.admissible].any()
        assert (primal.inverse.mask == ~primal.contact).all()
        if closed:
            assert (primal.w == primal.distance.b)[primal.contact].all()

    primal.start(solver)
    primal.guess(solver)
    check()
    for _ in range(4):
        before = primal.p[~primal.contact]
        solver.improve(primal, 0.0)
        p, w = solver.carried.copy(), primal.w + solver.change
        np.testing.assert_allclose(p, pressure_of(primal, w), rtol=0, atol=1e-11 * abs(p).max())
        assert np.linalg.norm(p[~primal.contact]) < 0.9 * np.linalg.norm(before)
        old = primal.contact.copy()
        wrong = primal.contact & (p < 0), ~primal.contact & primal.admissible & (w < primal.distance.b)
        update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
        assert (primal.contact == (old & ~wrong[0]) | wrong[1]).all()
        expected = primal.contact.sum(), wrong[1].sum(), wrong[0].sum()
        assert (update.cells, update.added, update.released) == expected
        moves = (w - primal.distance.b)[wrong[1]], p[wrong[0]] / solver.preconditioner.stiffness
        assert update.moves == pytest.approx(np.linalg.norm(np.concatenate(moves)), rel=1e-6)
        check(closed=False)
        primal.close_captured_gaps(solver)
        check()


def test_a_state_that_is_handed_out_is_valid(guessed, loading):
    primal, solver = guessed(loading)
    solver.improve(primal, 0.0)
    primal.commit(solver)
    primal.meet_load(primal.project(solver.scratch))
    state, u = primal.hand_out(), np.empty(primal.w.shape)
    state.operator.exact_displacement(state.p, u)
    np.testing.assert_array_equal(state.u, u)
    assert state.displacement_status is Displacement.EXACT and (state.p >= 0).all()
    assert (state.contact == ~primal.inverse.mask).all() and not state.p[~state.contact].any()
    if loading.approach_is_known:
        assert state.depth == loading.depth_on(state.distance)
    else:
        assert state.load == pytest.approx(loading.load, rel=1e-12)
        assert state.on_contact().mean == pytest.approx(0, abs=1e-12 * abs(u).max())
    state.destroy()


def test_one_cell_stays_in_contact_under_a_load(guessed):
    primal, solver = guessed(PrescribedLoad(1e2))
    before = primal.contact.copy()
    solver.carried[...] = -1.0
    solver.change[...] = 1.0
    update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
    assert (update.cells, update.changed) == (before.sum(), 0)
    assert (primal.contact == before).all() and (primal.inverse.mask == ~before).all()


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_start_from_a_pressure_corrects_it_for_overlap(steps, holes):
    """Overlaps are short waves, for which the centre of B is nearly B."""
    primal, solver = steps(PrescribedLoad(1e2), holes)
    primal.w[...] = primal.distance.b.mean() + 1e-3 * primal.distance.b
    primal.refresh()
    before = primal.p.copy()
    primal._has_pressure = True
    primal.start(solver)
    corrected = primal.p.copy()
    primal.refresh(exact=True)
    moved, missing = primal.p - before, primal.p - corrected
    assert primal.cells_in_contact() and np.linalg.norm(moved) > 0
    assert np.linalg.norm(missing) < 0.3 * np.linalg.norm(moved)
