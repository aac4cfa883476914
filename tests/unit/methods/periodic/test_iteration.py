"""Primal active set iteration."""

import warnings

import numpy as np
import periodic
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface, solve
from app.contact.active_set import CONVERGED
from app.methods.multilevel_product import MultilevelOperator
from app.methods.periodic import iteration
from app.methods.periodic.state import PrimalState
from app.methods.stopping import InexactStop


def levels_of(solver):
    """Return the multilevel B of the target grid, if it was created."""
    return solver._strategy.solver.operator.influence.multipliers.get("inverse")


@pytest.mark.parametrize("kind", ["spectral", "love"])
@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
def test_multilevel_products_find_the_same_pressure(share, kind):
    problem = periodic.rough(512, 512, 5, symbol=kind)
    approach = share * problem.gap.mean()
    with (
        ContactSolver(problem) as solver,
        ContactSolver(problem, options={"lcp_defect_correction": 0}) as plain,
    ):
        solution, expected = solver.solve(approach=approach), plain.solve(approach=approach)
        # Full contact at once.
        assert levels_of(plain) is None and (levels_of(solver).count > 0) == (share < 1)
    assert solution.converged and solution.fallbacks == 0
    size = expected.pressure.max()
    np.testing.assert_allclose(solution.pressure, expected.pressure, rtol=0, atol=2e-4 * size)
    assert solution.load == pytest.approx(expected.load, rel=5e-5)


def test_inaccurate_multilevel_product_only_costs_work(monkeypatch):
    """Any symmetric positive operator near B leads to the solution."""
    problem, apply = periodic.rough(512, 512, 5), MultilevelOperator.apply

    def worse(operator, p, out, rows=None):
        apply(operator, p, out, rows)
        if operator.shape == (512, 512):  # long waves 1.2 times, waves from cell to cell 0.8 times
            out += 0.05 * sum(np.roll(out, step, axis) for step in (-1, 1) for axis in (0, 1))

    with ContactSolver(problem) as solver:
        expected = solver.solve(approach=0.3 * problem.gap.mean())
        monkeypatch.setattr(MultilevelOperator, "apply", worse)
        before = levels_of(solver).count
        solution = solver.solve(approach=0.3 * problem.gap.mean())
        assert levels_of(solver).count > before
    assert solution.converged and solution.fallbacks == 0
    np.testing.assert_allclose(
        solution.pressure, expected.pressure, rtol=0, atol=2e-4 * expected.pressure.max()
    )
    assert solution.operator_applications < 2 * expected.operator_applications


def test_unreachable_tolerance_is_not_sought_by_multilevel_products():
    """Multilevel products end at their own error; an FFT corrects the rest."""
    problem = periodic.rough(512, 512, 5)
    with ContactSolver(problem) as solver, ContactSolver(problem, options={"ksp_rtol": 1e-6}) as strict:
        expected = solver.solve(approach=0.3 * problem.gap.mean())
        solution = strict.solve(approach=0.3 * problem.gap.mean())
    assert solution.converged and solution.fallbacks == 0
    assert solution.operator_applications < 1.5 * expected.operator_applications


@pytest.mark.parametrize("by_levels", [0, 0.05])
def test_drifted_pressure_is_recomputed_not_solved_further(by_levels):
    """In single precision, p is off by 5000 times the allowed error."""
    rng, n = np.random.default_rng(0), 512
    height = np.where(rng.random((n, n)) < 0.02, 1.0, 0.0) + 1e-3 * rng.normal(size=(n, n))
    grid = Grid(n, n, 1 / n, 1 / n)
    problem = ContactProblem(grid, periodic.MATERIAL, 0.02 * (height.max() - height), periodic=True)
    options = {"lcp_rtol": 6.6e-11, "lcp_defect_correction": by_levels}
    with ContactSolver(problem, options=options) as solver:
        solution = solver.solve(mean_pressure=3e-6 * periodic.MATERIAL.contact_modulus)
    assert solution.converged and solution.fallbacks == 0
    assert solution.operator_applications < 48


@pytest.mark.parametrize("loading", ["load", "approach"])
def test_negligible_changes_end_the_iteration(monkeypatch, loading):
    ends, verified, verify, steel = [], [], iteration.verify, Material.combined(80000.0, 0.3)
    monkeypatch.setattr(iteration, "verify", lambda *given: verified.append(None) or verify(*given))
    patch = Grid.from_domain(96, 96, (0, 1, 0, 1))

    def problem_of(seed):
        height = SelfAffineSurface(0.8, 1 / 4, 1 / 24, (1.0, 1.0), seed, rms_slope=0.1)
        return ContactProblem(patch, steel, surfaces=[height], periodic=True)

    for seed in range(1, 13):
        problem = problem_of(seed)
        deviation = problem.shape_on(patch).std()
        with ContactSolver(problem, options={"lcp_rtol": 1e-10}) as solver:
            exact = solver.solve(load=0.03 * steel.contact_modulus)
        verified.clear()
        solution = solve(problem, options={"lcp_rtol": 1e-4}, **{loading: getattr(exact, loading)})
        assert len(verified) == 1  # it passes at once
        gap = solution.gap[solution.contact]
        off = gap - gap.mean() if loading == "load" else gap
        assert np.sqrt(np.mean(off**2)) < 1e-4 * deviation
        assert np.linalg.norm(solution.pressure - exact.pressure) < 2e-3 * np.linalg.norm(exact.pressure)
        ends.append(solution.attributes["reason"])
    assert len(set(ends)) == 2

    exchange = PrimalState.exchange
    # They do matter.
    monkeypatch.setattr(PrimalState, "exchange", lambda *given: exchange(*given)._replace(moves=np.inf))
    for seed in range(1, 13):
        solution = solve(problem_of(seed), load=0.03 * steel.contact_modulus, options={"lcp_rtol": 1e-4})
        assert solution.attributes["reason"] == CONVERGED


@pytest.mark.parametrize(("cut_off", "seed"), [(4, 3), (4, 2), (8, 6)])
def test_no_single_cell_keeps_a_large_overlap(cut_off, seed):
    steel, patch = Material.combined(80000.0, 0.3), Grid.from_domain(256, 256, (0, 1, 0, 1))
    surface = SelfAffineSurface(0.8, 1 / 8, cut_off / 256, (1.0, 1.0), seed, rms_slope=0.1)
    problem = ContactProblem(patch, steel, surfaces=[surface], periodic=True)
    solution = solve(problem, mean_pressure=0.14 * steel.contact_modulus)
    assert solution.converged
    assert -solution.gap.min() < 1e-5 * problem.shape_on(patch).std()


def test_failed_verification_restores_the_contact_set(guessed, loading, pressure_of):
    primal, solver = guessed(loading)
    norm = solver.improve(primal, 0.0)[2]
    update = primal.exchange(solver, 0.0, 0.0, np.inf, norm)
    free = ~primal.contact
    primal.commit(solver)
    accuracy = iteration._Accuracy(1e-9)
    stop = InexactStop(1e-6, 100, True)
    verdict = iteration._judge(primal, solver.scratch, stop, accuracy.allowed)
    iteration._continue(verdict, primal, solver, accuracy, norm / np.sqrt(primal.cells), True)
    assert update.added and not verdict.solved and accuracy.verification_failed
    np.testing.assert_array_equal(free, ~primal.contact)
    np.testing.assert_array_equal(primal.w[primal.contact], primal.distance.b[primal.contact])
    np.testing.assert_allclose(primal.p, pressure_of(primal), rtol=0, atol=1e-11 * abs(primal.p).max())


@pytest.mark.parametrize("given", [{"approach": 1e-3}, {"mean_pressure": 10.0}])
def test_allowed_gap_of_nearly_flat_surfaces_is_that_of_flat_ones(given):
    """Heights of the size of rounding do not tighten the tolerance."""
    numbers, material = np.random.default_rng(2), Material.from_contact_modulus(1e4)
    for n in (3, 8, 16, 24, 64):
        for height in 10.0 ** np.arange(-16, -3):
            gap = numbers.random((n, n)) * height
            gap[numbers.random((n, n)) < 0.1] = np.nan
            gap[0, 0] = np.nan
            solution = solve(
                ContactProblem(Grid.from_domain(n, n, (0, 1, 0, 1)), material, gap, periodic=True), **given
            )
            assert solution.converged and solution.fallbacks == 0 and solution.operator_applications < 30
            assert solution.error_bound < 1e-4


def test_unsolved_problem_has_a_pressure_with_the_load():
    numbers, material = np.random.default_rng(4), Material.from_contact_modulus(1.0)
    for _ in range(60):
        gap = numbers.random((numbers.integers(1, 8), numbers.integers(2, 12)))
        gap[numbers.random(gap.shape) < 0.3] = np.nan
        if np.isnan(gap).all():
            continue
        problem = ContactProblem(Grid(*gap.shape[::-1], 1, 1), material, gap, periodic=True)
        with warnings.catch_warnings(action="ignore"):
            solution = solve(problem, load=1e-4, options={"lcp_max_it": 1, "ksp_max_it": 1})
        assert solution.pressure.min() == 0 or not np.isnan(gap).any()
        assert (solution.pressure[np.isnan(gap)] == 0).all() and (solution.pressure >= 0).all()
        assert solution.pressure.sum() == pytest.approx(1e-4)
