"""Active set iteration of the default method."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cases import APPROACH, hertz, punch, self_affine

from app import ContactSolver, Material, solve
from app.halfspace.operator import InfluenceOperator
from app.methods import multilevel_operators
from app.methods.free.solver import TrackingSolver
from app.methods.free.verification_product import VerificationProduct
from app.methods.multilevel_product import MultilevelOperator

PROBLEMS = {
    "hertz": (partial(hertz, 256), {"approach": APPROACH}),
    "punch": (partial(punch, 256), {"approach": 0.05}),
    "rough": (partial(self_affine, 256), {"approach": 0.015}),
    "rough, by load": (partial(self_affine, 256), {"load": 1500.0}),
}


@pytest.mark.parametrize(("problem", "control"), PROBLEMS.values(), ids=PROBLEMS.keys())
@pytest.mark.parametrize("precision", ["single", "double"])
def test_defect_correction_finds_the_same_pressure_with_less_work(problem, control, precision):
    how = {"lcp_rtol": 1e-8, "lcp_precision": precision}
    plain = solve(problem(), options=how | {"lcp_defect_correction": 0}, **control)
    solution = solve(problem(), options=how, **control)
    assert solution.converged
    assert not solution.fallbacks
    assert solution.operator_applications < 0.9 * plain.operator_applications
    assert np.linalg.norm(solution.pressure - plain.pressure) < 1e-5 * np.linalg.norm(plain.pressure)


@pytest.mark.parametrize("wrong", [0.5, 3.0])
def test_bad_multilevel_products_are_replaced_by_fft(monkeypatch, wrong):
    """A multilevel pass that leaves more than half of the residual is the last."""
    apply, nearly = MultilevelOperator.apply, []

    def wrongly(self, p, out, rows=None):
        apply(self, p, out, rows)
        if self is mine.get("influence"):
            out *= wrong

    with ContactSolver(self_affine(256), options={"lcp_rtol": 1e-7}) as solver:
        expected = solver.solve(approach=0.015)
    improve, mine = TrackingSolver.improve, {}

    def improve_and_tell(self, *arguments):
        mine["influence"] = self.operator.multipliers.get("influence")
        nearly.append(self.multilevel)
        return improve(self, *arguments)

    monkeypatch.setattr(TrackingSolver, "improve", improve_and_tell)
    monkeypatch.setattr(multilevel_operators.MultilevelOperator, "apply", wrongly)
    with ContactSolver(self_affine(256), options={"lcp_rtol": 1e-7}) as solver:
        solution = solver.solve(approach=0.015)
    assert solution.converged
    assert not nearly[-1]
    assert np.linalg.norm(solution.pressure - expected.pressure) < 1e-4 * np.linalg.norm(expected.pressure)


def test_few_verifications_fail(monkeypatch):
    """Without rehearsals every second verification failed."""
    products, plain = [], VerificationProduct.apply_on_all
    monkeypatch.setattr(
        VerificationProduct, "apply_on_all", lambda self, *a: (products.append(0), plain(self, *a))
    )
    with ContactSolver(punch(160)) as solver:
        loads = np.geomspace(100, 4e4, 10)
        for load in loads:
            assert solver.solve(load=load).converged
    assert len(loads) <= len(products) <= 1.3 * len(loads)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_few_verifications_fail_if_the_last_release_moves_the_approach(monkeypatch, seed):
    """Nearly full contact by load needs a rehearsal of the release."""
    n, products, plain = 192, [], InfluenceOperator.exact_displacement

    def counted(operator, *fields):
        if operator.grid.n == n * n:
            products.append(0)
        plain(operator, *fields)

    monkeypatch.setattr(InfluenceOperator, "exact_displacement", counted)
    problem = replace(self_affine(n, 8, seed), material=Material.from_contact_modulus(1e5))
    loads = 9e3, 1.2e4, 1.5e4, 1.8e4, 2.1e4, 2.4e4
    with ContactSolver(problem) as solver:
        for load in loads:
            assert solver.solve(load=load).converged
    assert len(loads) <= len(products) <= len(loads) + 1
