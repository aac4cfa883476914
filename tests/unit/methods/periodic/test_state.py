"""Unknowns of the primal form, step by step."""

import numpy as np
import pytest
from operators import random_field

from app.contact.prescribed_load import PrescribedLoad


def test_solver_resumes_without_a_product(guessed, loading, pressure_of):
    """w and p change at `commit` only; changes add up from set to set."""
    primal, solver = guessed(loading)
    state = primal.state
    w, p, norms = primal.w.copy(), state.p.copy(), []
    for _ in range(3):
        norms.append(solver.improve(primal, 0.0)[2])
        primal.exchange(solver, 0.0, -np.inf, np.inf, norms[-1])  # releases only
        assert primal.pending and (primal.w == w).all()
        np.testing.assert_allclose(state.p - p, (state.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
        expected = pressure_of(primal, w + solver.change)
        np.testing.assert_allclose(solver.carried, expected, rtol=0, atol=1e-11 * abs(expected).max())
    with primal.shown(solver):
        np.testing.assert_array_equal(state.p, solver.carried)
    np.testing.assert_allclose(state.p - p, (state.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
    primal.commit(solver)
    assert not primal.pending and not primal.approximate
    np.testing.assert_allclose(primal.w, w + solver.change, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(state.p, solver.carried)
    taken = primal.w.copy()
    primal.commit(solver)  # there is nothing more
    assert (primal.w == taken).all()


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_each_step_keeps_p_and_the_loading(steps, loading, holes, pressure_of):
    """p = B w + mean pressure; prescribed means hold; w = b on C."""
    primal, solver = steps(loading, holes)
    state, given = primal.state, not primal.loading.approach_is_known
    primal.w[...] = random_field(state.grid, 8) * 0.01

    def check(closed=True):
        np.testing.assert_allclose(state.p, pressure_of(primal), rtol=0, atol=1e-11 * abs(state.p).max())
        if given:
            assert state.load == pytest.approx(primal.loading.load, rel=1e-9)
        else:
            assert primal.depth == pytest.approx(primal.prescribed_depth, rel=1e-9)
        assert not state.contact[~state.admissible].any()
        assert (primal.inverse.mask == ~state.contact).all()
        if closed:
            assert (primal.w == state.distance.b)[state.contact].all()

    primal.start(solver)
    primal.guess(solver)
    check()
    for _ in range(4):
        before = state.p[~state.contact]
        solver.improve(primal, 0.0)
        p, w = solver.carried.copy(), primal.w + solver.change
        np.testing.assert_allclose(p, pressure_of(primal, w), rtol=0, atol=1e-11 * abs(p).max())
        assert np.linalg.norm(p[~state.contact]) < 0.9 * np.linalg.norm(before)
        old = state.contact.copy()
        wrong = state.contact & (p < 0), ~state.contact & state.admissible & (w < state.distance.b)
        update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
        assert (state.contact == (old & ~wrong[0]) | wrong[1]).all()
        expected = state.contact.sum(), wrong[1].sum(), wrong[0].sum()
        assert (update.cells, update.added, update.released) == expected
        moves = (w - state.distance.b)[wrong[1]], p[wrong[0]] / solver.preconditioner.stiffness
        assert update.moves == pytest.approx(np.linalg.norm(np.concatenate(moves)), rel=1e-6)
        check(closed=False)
        primal.close_captured_gaps(solver)
        check()


def test_one_cell_stays_in_contact_under_a_load(guessed):
    primal, solver = guessed(PrescribedLoad(1e2))
    before = primal.state.contact.copy()
    solver.carried[...] = -1.0
    solver.change[...] = 1.0
    update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
    assert (update.cells, update.changed) == (before.sum(), 0)
    assert (primal.state.contact == before).all() and (primal.inverse.mask == ~before).all()


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_start_from_a_pressure_corrects_it_for_overlap(steps, holes):
    """Overlaps are short waves, for which the centre of B is nearly B."""
    primal, solver = steps(PrescribedLoad(1e2), holes)
    primal.w[...] = primal.state.distance.b.mean() + 1e-3 * primal.state.distance.b
    primal.refresh()
    before = primal.state.p.copy()
    primal._has_pressure = True
    primal.start(solver)
    corrected = primal.state.p.copy()
    primal.refresh(exact=True)
    moved, missing = primal.state.p - before, primal.state.p - corrected
    assert primal.state.cells_in_contact() and np.linalg.norm(moved) > 0
    assert np.linalg.norm(missing) < 0.3 * np.linalg.norm(moved)
