"""Projected Newton's method."""

import numpy as np
import periodic
import pytest
from cases import APPROACH, hertz, punch, self_affine
from mpi4py import MPI
from running import assert_solves_lcp, solve
from scipy.optimize import nnls

from app.contact.distance import UndeformedDistance
from app.contact.history import History, Listener
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.halfspace.product import DenseProduct
from app.methods import progress
from app.methods.free import nested
from app.methods.free.solver import TrackingSolver
from app.methods.periodic import nested as primal_nested
from app.methods.safeguard import ProjectedNewton
from app.methods.stopping import InexactStop
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import SolverOptions


def positive_definite(n, rng, condition):
    """Return a random matrix with eigenvalues from 1 to the condition number."""
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return (q * np.geomspace(1, condition, n)) @ q.T


def least(a, h):
    """Minimise p.Ap / 2 + h.p, p >= 0, by Lawson and Hanson's method."""
    factor = np.linalg.cholesky(a)
    return nnls(factor.T, -np.linalg.solve(factor, h), maxiter=1000)[0]


class Energy(Listener):
    """Record f after each iteration."""

    def __init__(self, a, h):
        self._a, self._h = a, h
        self.values = []

    def of(self, p):
        return 0.5 * p @ self._a @ p + self._h @ p

    def iteration(self, entry, state):
        self.values.append(self.of(state.p.reshape(-1)))


@pytest.mark.parametrize("ksp_rtol", [0.5, 1e-10])
@pytest.mark.parametrize("condition", [3.0, 1e4])
@pytest.mark.parametrize("seed", range(6))
def test_energy_decreases_for_any_positive_definite_problem(seed, condition, ksp_rtol):
    rng = np.random.default_rng(seed)
    grid = Grid(6, 5, 1.0, 1.0)
    a = positive_definite(grid.n, rng, condition)
    h = rng.normal(size=grid.n)
    inadmissible = rng.random(grid.n) < 0.1
    hierarchy = Hierarchy(grid, UNIT, MPI.COMM_SELF)
    operator = hierarchy.target
    operator.product = operator.exact_product = DenseProduct(a, grid.shape)
    distance = UndeformedDistance(operator, np.where(inadmissible, np.nan, h).reshape(grid.shape))
    state = contact_state(operator, distance)
    energy = Energy(a, np.where(inadmissible, 0.0, h))
    start = np.where(inadmissible, 0.0, rng.normal(size=grid.n))
    state.pressure.setArray(start)
    with SolverOptions("", {"ksp_type": "cg", "pc_type": "none", "ksp_rtol": str(ksp_rtol)}).inserted():
        solver = LinearSolver(hierarchy)
    stop = InexactStop(rtol=1e-10, max_it=500)
    outcome = ProjectedNewton(state, solver, stop).run(History([energy]))
    assert outcome.converged, outcome
    inside = ~inadmissible
    expected = np.zeros(grid.n)
    expected[inside] = least(a[np.ix_(inside, inside)], h[inside])
    p = state.p.reshape(-1)
    np.testing.assert_allclose(p, expected, rtol=0, atol=1e-8)
    values = np.array([energy.of(np.maximum(start, 0)), *energy.values])
    assert len(values) == outcome.iterations + 1
    above = values - energy.of(expected)
    rounding = 1e-12 * above[0]
    assert (np.diff(above)[above[:-1] > rounding] < 0).all()
    assert abs(above[-1]) < rounding
    for part in (solver, state, distance):
        part.destroy()


PROBLEMS = {
    "hertz": (hertz(64), APPROACH),
    "rough": (punch(64), 0.01),
    "self-affine": (self_affine(64), 0.004),
    "near full contact": (self_affine(64), 0.02),
}


@pytest.fixture(scope="module")
def fast():
    """Return solutions without the safeguard."""
    return {name: solve(*problem, "fast", lcp_rtol=1e-9) for name, problem in PROBLEMS.items()}


@pytest.mark.parametrize("by_load", [False, True], ids=["approach", "load"])
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_safeguard_finds_the_solution_of_the_iteration(fast, name, by_load, precision, monkeypatch):
    expected, (problem, approach) = fast[name], PROBLEMS[name]
    assert expected.fallbacks == 0
    monkeypatch.setattr(progress, "PATIENCE", 0)
    load = expected.load if by_load else None
    solution = solve(problem, approach, "fast", load, lcp_rtol=1e-9, lcp_precision=precision)
    assert solution.fallbacks > 0
    assert_solves_lcp(solution, 1e-9)
    assert solution.load == pytest.approx(expected.load, rel=1e-12 if by_load else 1e-7)
    assert solution.approach == pytest.approx(approach, rel=1e-7)
    np.testing.assert_array_equal(solution.contact, expected.contact)
    highest = expected.pressure.max()
    np.testing.assert_allclose(solution.pressure, expected.pressure, rtol=0, atol=1e-5 * highest)


def test_safeguard_of_a_light_load_is_accurate_to_rounding(monkeypatch):
    """Much larger distances cost no digits of u."""
    monkeypatch.setattr(progress, "PATIENCE", 0)
    problem, _ = PROBLEMS["hertz"]
    solution = solve(problem, None, "fast", 1e-5)
    assert solution.fallbacks > 0
    u = np.empty(problem.grid.shape)
    InfluenceOperator(problem.grid, problem.material.kernel).displacement(solution.pressure, u)
    assert u.max() < 1e-6 * np.nanmax(solution.undeformed_distance)
    np.testing.assert_allclose(solution.displacement, u, rtol=0, atol=1e-13 * u.max())


def test_failed_linear_solver_starts_the_safeguard(monkeypatch):
    improve, failed = TrackingSolver.improve, []

    def fails_once(solver, state, *how):
        its, failure, norm = improve(solver, state, *how)
        if state.grid.n == 64**2 and not failed:
            failed.append(True)
            failure = "DIVERGED_INDEFINITE_MAT"
        return its, failure, norm

    expected = solve(punch(64), 0.01, "fast")
    monkeypatch.setattr(TrackingSolver, "improve", fails_once)
    solution = solve(punch(64), 0.01, "fast")
    assert failed and solution.converged and solution.fallbacks == 1
    assert solution.load == pytest.approx(expected.load, rel=1e-5)


@pytest.mark.parametrize("load", [None, 1e5])
def test_failed_certificate_starts_the_safeguard(load, monkeypatch):
    """No residual is small enough for a pressure that is negative outside C; the safeguard projects it."""
    improve = TrackingSolver.improve

    def leaves_tension(solver, state, *how):
        result = improve(solver, state, *how)
        if state.grid.n == 64**2:
            state.values[0, 0] = -1.0
            state.displacement_status = Displacement.STALE
        return result

    expected = solve(punch(64), 0.01, "fast", load)
    monkeypatch.setattr(TrackingSolver, "improve", leaves_tension)
    solution = solve(punch(64), 0.01, "fast", load)
    assert_solves_lcp(solution)
    assert solution.fallbacks == 1 and solution.error_bound < 0.01
    np.testing.assert_allclose(solution.load, expected.load, rtol=1e-5)


class Uphill:
    """Linear solver with an ascent direction."""

    def __init__(self, length):
        self._length = length

    def set_contact(self):
        pass

    def solve(self, defect, allowed):
        direction = defect.copy()
        direction.scale(-self._length)
        return direction, 1, ""


@pytest.mark.parametrize(("length", "reason"), [(1.0, "no step"), (np.inf, "not a finite number")])
def test_unsolved_pressure_vanishes_outside_contact(length, reason, monkeypatch):
    """The last system leaves out cells that are nearly free."""
    operator = InfluenceOperator(Grid(6, 5, 1.0, 1.0), UNIT)
    state = contact_state(operator, UndeformedDistance(operator, np.ones((5, 6))))
    state.values[2, 1:4] = 1.0, 1e-3, 1e-4
    monkeypatch.setattr(History, "start", lambda *_: None)
    outcome = ProjectedNewton(state, Uphill(length), InexactStop(1e-10, 10)).run(History())
    assert not outcome.converged and reason in outcome.reason
    np.testing.assert_array_equal(state.contact, state.p > 0)
    state.destroy()


def test_safeguard_reports_the_iteration_limit(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0)
    for load in (None, 3e4):
        solution = solve(punch(64), 0.01, "fast", load, lcp_max_it=2)
        assert not solution.converged
        assert "safeguard" in solution.message
        assert np.isfinite(solution.pressure).all() and (solution.pressure >= 0).all()


@pytest.mark.parametrize("method", ["fast", "primal"])
def test_fallbacks_count_every_safeguarded_grid(method, monkeypatch):
    problem, approach = PROBLEMS["self-affine"]
    if method == "primal":
        problem = periodic.rough(64, 64, 8, 0.0)
        approach = 0.8 * np.nanmean(problem.gap)
    numbers = []
    plain = nested.solve_safeguarded

    def solve_safeguarded(hierarchy, number, *arguments):
        numbers.append(number)
        return plain(hierarchy, number, *arguments)

    for module in (nested, primal_nested):
        monkeypatch.setattr(module, "solve_safeguarded", solve_safeguarded)
    monkeypatch.setattr(progress, "PATIENCE", 0)
    solution = solve(problem, approach, method, lcp_rtol=1e-9, lcp_coarse_rtol=1e-9)
    assert solution.fallbacks == len(set(numbers)) > 1
