"""NORM, Sec. 3: the paper's Hertz contact, its limits, and holes."""

import numpy as np
import pytest
from cases import APPROACH, COUNTS, assert_counts_of_norm, hertz
from running import assert_solves_lcp, solve

from app import ContactProblem


@pytest.fixture(scope="module")
def solutions():
    return {n: solve(hertz(n), APPROACH) for n in COUNTS}


@pytest.mark.parametrize("n", COUNTS)
def test_iterations_on_hertz(solutions, n):
    assert_counts_of_norm(n, solutions[n])
    assert_solves_lcp(solutions[n])
    history = solutions[n].history
    assert history["iteration"] == list(range(1, solutions[n].iterations + 1))
    assert sum(history["inner_iterations"]) == solutions[n].inner_iterations
    assert history["changed_cells"][-1] == 0
    assert history["residual"][-1] == solutions[n].residual <= 1e-6
    assert history["contact_cells"][-1] == solutions[n].contact.sum()
    # On Hertz's problem C shrinks from the start set to the solution.
    assert sum(history["added_cells"]) == 0
    assert (np.diff(history["contact_cells"]) <= 0).all()


def test_load_and_maximum_on_the_finest_grid(solutions):
    assert solutions[256].load == pytest.approx(82004.6, abs=0.05)
    assert solutions[256].pressure.max() == pytest.approx(1631.15, abs=0.02)


@pytest.mark.parametrize("method", ["norm", "mg_v11"])
def test_holes_are_never_in_contact(method):
    problem = hertz(48)
    shape = problem.shape_on(problem.grid)
    holes = np.random.default_rng(3).random(shape.shape) < 0.15
    holes[:, 24] = True
    shape[holes] = np.nan
    solution = solve(ContactProblem(problem.grid, problem.material, shape), APPROACH, method)
    assert_solves_lcp(solution)
    assert not solution.contact[holes].any()
    assert (solution.pressure[holes] == 0).all()
    whole = solve(problem, APPROACH)
    assert solution.load < whole.load
    assert solution.pressure.max() > whole.pressure.max()  # what the holes cannot bear, others must


# ---------------------------------------------------------------------------------------- ends of the range


@pytest.mark.parametrize("approach", [-1.0, -1e-12])
def test_bodies_apart(approach):
    solution = solve(hertz(16), approach)
    assert_solves_lcp(solution)
    assert solution.load == 0
    assert not solution.contact.any()
    assert "touch" in solution.message
