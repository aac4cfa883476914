"""Verification: figures and their limits, exact solutions of small problems, the document and the command."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from app import ContactProblem, Grid, Material
from app.api import solver
from app.contact.certificate import certify
from app.verification import certificates, document, oracles, verify
from app.verification.check import Check, Figure, fit_order
from app.verification.dense import DenseProblem, solve_by_lemke


@pytest.mark.parametrize(
    ("value", "least", "most", "passed", "limit"),
    [
        (1.0, -np.inf, np.inf, True, ""),
        (np.nan, -np.inf, 1.0, False, "≤ 1"),
        (1.0, 1.0, np.inf, True, "≥ 1"),
        (0.9, 1.0, 2.0, False, "1 to 2"),
        (0, 0, 0, True, "0"),
    ],
)
def test_a_figure_keeps_its_limits_or_not(value, least, most, passed, limit):
    figure = Figure("what", value, least, most)
    assert (figure.passed, figure.limit) == (passed, limit)


def test_fitted_order_is_the_slope_of_errors():
    assert fit_order([10, 20, 40], [3.0, 3.0 / 8, 3.0 / 64]) == pytest.approx(3)


@pytest.mark.parametrize("seed", range(20))
def test_lemke_and_pivoting_meet_all_conditions(seed):
    """Ties and zeros are likely, A is singular where the patch is periodic."""
    rng = np.random.default_rng(seed)
    periodic = ("", "spectral")[seed % 2]
    gap = rng.integers(0, 4, (2, 3)).astype(float)
    problem = ContactProblem(Grid(3, 2, 1.0, 0.5), Material.combined(1.0, 0.0), gap, periodic=periodic)
    dense, approach = DenseProblem(problem), 0.9 * gap.mean()
    p = solve_by_lemke(dense.matrix, gap.ravel() - approach)
    e = gap.ravel() - approach + dense.matrix @ p
    assert (p >= 0).all() and e.min() >= -1e-14 and abs(p * e).max() <= 1e-13
    np.testing.assert_allclose(dense.at(approach).ravel().astype(float), p, rtol=0, atol=1e-14 * p.max())
    for guess in 0.0, 0.99 * approach, 1.01 * approach:
        by_load, found = dense.under(float(p.sum()) * problem.grid.cell_area, guess)
        assert found == pytest.approx(approach, rel=1e-12)
        np.testing.assert_allclose(by_load.ravel().astype(float), p, rtol=0, atol=1e-12 * (p.max() or 1))


def test_pivoting_ends_at_the_edge_of_full_contact():
    """There rounding could take turns with the last cell."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        ny, nx = map(int, rng.integers(2, 9, 2))
        x, y = np.linspace(0, 1, nx), np.linspace(0, 1, ny)[:, None]
        gap = np.cos(7 * x + rng.uniform(0, 6)) + np.cos(5 * y + 2 * x)
        problem = ContactProblem(
            Grid(nx, ny, 0.1, 0.1), Material.combined(8e4, 0.3), gap, periodic="spectral"
        )
        full = DenseProblem(problem).at(gap.mean() + 1).astype(float)
        for less in 0, 1e-16, 1e-15:
            p = DenseProblem(problem).at(gap.mean() - less).astype(float)
            np.testing.assert_allclose(p, full, rtol=0, atol=1e-11 * full.max())


def test_pivoting_loses_no_digits_on_long_cells():
    """Coefficients are much larger than the eigenvalue of a wave across the cells."""
    wave = np.tile([1.0, 0.0, -1.0, 0.0], (16, 1))
    grid, material = Grid(4, 16, 1.0, 1e3), Material.from_contact_modulus(1.0)
    full = DenseProblem(ContactProblem(grid, material, wave, periodic="spectral")).at(2.0)
    # E* |q| / 2 times the displacement, and a constant
    np.testing.assert_allclose(full.astype(float), np.pi / 4 * (1 - wave), rtol=0, atol=1e-15)


@pytest.mark.parametrize("depth", [1e-13, 1e-17])
def test_mean_gaps_lose_no_digits_near_first_touch(depth):
    gap = np.array([[0.0, 1.0, 3.0, 1.0, 3.0, 1.0, 2.0]])  # with a mean of 11/7
    mean_gap = 11 / 7 - depth
    exact = float(Fraction(11, 7) - Fraction(mean_gap))
    problem = ContactProblem(
        Grid(7, 1, 1.0, 1.0), Material.from_contact_modulus(1.0), gap, periodic="spectral"
    )
    dense = DenseProblem(problem)
    by_approach, found = dense.at(exact), dense.with_mean_gap(mean_gap)
    np.testing.assert_allclose(found.astype(float), by_approach.astype(float), rtol=1e-14, atol=0)


@pytest.mark.parametrize(("factor", "passes"), [(1.0, True), (0.01, False), (100.0, False), (np.inf, False)])
@pytest.mark.parametrize("measure", [certificates.of_anything, certificates.of_answers])
def test_a_certificate_has_to_be_right_and_to_say_something(monkeypatch, measure, factor, passes):
    def scaled(state, *wanted):
        proof = certify(state, *wanted)
        return replace(proof, error_bound=factor * proof.error_bound)

    monkeypatch.setattr(certificates, "certify", scaled)
    monkeypatch.setattr(solver, "certify", scaled)
    assert all(figure.passed for figure in measure(True)) == passes


def test_a_method_that_never_converges_is_compared_with_nothing(monkeypatch):
    def gives_up(problem, method, **how):
        assert method == "fmg_v11"
        return SimpleNamespace(converged=False, pressure=np.full(problem.grid.shape, 77.0))

    monkeypatch.setattr(oracles, "methods", lambda periodic: ["fmg_v11"])
    monkeypatch.setattr(oracles, "solved", gives_up)
    figures = oracles.every_method(True)
    assert figures and not any(figure.passed for figure in figures)


@pytest.fixture
def checks(monkeypatch):
    """Two checks in place of all, of which one fails."""
    good = Check(
        "good", "Good", "Law.", lambda quick: [Figure("order of it", 2.0, 1.5, points=((8, 16), (0.4, 0.1)))]
    )
    bad = Check("bad", "Bad", "Law.", lambda quick: [Figure("error", 1.0, most=0.5), Figure("told", 3.0)])
    monkeypatch.setattr(document, "SECTIONS", {"Analytic solutions": (good, bad)})
    monkeypatch.setattr(document, "CHECKS", {check.name: check for check in (good, bad)})


def test_the_document_has_every_figure_and_the_command_fails_with_one(checks, tmp_path, capsys):
    assert verify.main(["-o", str(tmp_path)]) == 1
    text = (tmp_path / "verification.md").read_text()
    assert "1 of 2 limits are not kept" in text and "**FAIL**" in text and "--only bad" in text
    assert "error: 1, must be ≤ 0.5" in capsys.readouterr().out
    assert (tmp_path / document.ORDERS).is_file() and document.ORDERS in text
    assert not (tmp_path / document.SHARPNESS).exists()


def test_one_check_alone(checks, tmp_path):
    assert verify.main(["-o", str(tmp_path), "--only", "good", "--quick"]) == 0
    text = (tmp_path / "verification.md").read_text()
    assert "All 1 limits are kept" in text and "--only good --quick" in text and "Bad" not in text


def test_bad_input_is_one_line(checks, tmp_path, capsys):
    assert verify.main(["-o", str(tmp_path), "--only", "better"]) == 2
    assert capsys.readouterr().err == "error: --only better: unknown; allowed: good, bad\n"
    assert verify.main(["-o", str(tmp_path / "a" / "b")]) == 2
