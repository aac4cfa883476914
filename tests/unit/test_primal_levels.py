"""B by levels on periodic patches: nearly B, and a solve that multiplies by it finds the same pressure."""

from functools import partial

import numpy as np
import periodic
import pytest

from app import ContactProblem, ContactSolver, Grid
from app.halfspace.periodic_symbol import influence_symbol
from app.halfspace.product import PeriodicProduct
from app.methods.multilevel_operators import create_multilevel_inverse
from app.methods.multilevel_product import MultilevelOperator


def levels_of(solver):
    """B by levels of the target grid, if it has been made."""
    return solver._strategy.solver.operator.influence.multipliers.get("inverse")


GRIDS = {
    "square": (512, 512, 1.0, 0.035),
    "four levels": (1024, 1024, 1.0, 0.035),
    "once": (514, 258, 1.2, 0.035),
    "long cells": (256, 512, 1.7, 0.04),
    "longer": (512, 320, 0.3, 0.04),
    "longest": (512, 256, 20.0, 0.04),
}


@pytest.mark.parametrize("kind", ["spectral", "love"])
@pytest.mark.parametrize(("nx", "ny", "aspect", "off"), GRIDS.values(), ids=GRIDS.keys())
def test_it_is_nearly_the_inverse(nx, ny, aspect, off, kind):
    """Worst for noise; zero on constants; symmetric and positive."""
    grid = Grid(nx, ny, aspect, 1.0, periodic=kind)
    nearly, rng = create_multilevel_inverse(grid, 0.5), np.random.default_rng(ny)
    exactly = PeriodicProduct(partial(influence_symbol, grid, 0.5), grid.shape).inverse()
    y, x = np.mgrid[:ny, :nx]
    corner = np.zeros(grid.shape)
    corner[0, -1] = 1.0
    fields = {
        "noise": (rng.normal(size=grid.shape), off),
        "cells": ((rng.random(grid.shape) < 0.1).astype(float), off),
        "wave": (np.cos(2 * np.pi * (3 * x / nx + 2 * y / ny)), 5e-3),
        "corner": (corner, off),
    }
    products = []
    for field, allowed in fields.values():
        found, expected = np.empty(grid.shape), np.empty(grid.shape)
        nearly.apply(field, found)
        exactly.apply(field, expected)
        products.append(found)
        assert np.linalg.norm(found - expected) < allowed * np.linalg.norm(expected)
        assert np.vdot(field, found) == pytest.approx(np.vdot(field, expected), rel=off)
    gram = np.array([[np.vdot(field, found) for found in products] for field, _ in fields.values()])
    np.testing.assert_allclose(gram, gram.T, rtol=0, atol=1e-13 * abs(gram).max())
    found = np.empty(grid.shape)
    nearly.apply(np.ones(grid.shape), found)
    assert abs(found).max() < 1e-12 * abs(products[0]).max()


@pytest.mark.parametrize(("nx", "ny"), [(256, 256), (513, 600), (600, 513), (512, 130)])
def test_there_is_none_on_small_grids_and_odd_ones(nx, ny):
    assert create_multilevel_inverse(Grid(nx, ny, 1.0, 1.0, periodic="spectral"), 1.0) is None


@pytest.mark.parametrize("kind", ["spectral", "love"])
@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
def test_the_answer_is_the_same(share, kind):
    problem = periodic.rough(512, 512, 5, symbol=kind)
    approach = share * problem.gap.mean()
    with (
        ContactSolver(problem) as solver,
        ContactSolver(problem, options={"lcp_defect_correction": 0}) as plain,
    ):
        found, expected = solver.solve(approach=approach), plain.solve(approach=approach)
        assert levels_of(plain) is None and (levels_of(solver).count > 0) == (
            share < 1
        )  # full contact at once
    assert found.converged and found.fallbacks == 0
    size = expected.pressure.max()
    np.testing.assert_allclose(found.pressure, expected.pressure, rtol=0, atol=2e-4 * size)
    assert found.load == pytest.approx(expected.load, rel=5e-5)


def test_a_product_that_is_off_costs_work_alone(monkeypatch):
    """What is multiplied by levels is not believed: any symmetric positive operator near B ends in the answer."""
    problem, apply = periodic.rough(512, 512, 5), MultilevelOperator.apply

    def worse(operator, p, out, rows=None):
        apply(operator, p, out, rows)
        if operator.shape == (512, 512):  # long waves 1.2 times, waves from cell to cell 0.8 times
            out += 0.05 * sum(np.roll(out, step, axis) for step in (-1, 1) for axis in (0, 1))

    with ContactSolver(problem) as solver:
        expected = solver.solve(approach=0.3 * problem.gap.mean())
        monkeypatch.setattr(MultilevelOperator, "apply", worse)
        before = levels_of(solver).count
        found = solver.solve(approach=0.3 * problem.gap.mean())
        assert levels_of(solver).count > before
    assert found.converged and found.fallbacks == 0
    np.testing.assert_allclose(found.pressure, expected.pressure, rtol=0, atol=2e-4 * expected.pressure.max())
    assert found.operator_applications < 2 * expected.operator_applications


def test_a_residual_asked_for_in_vain_is_not_looked_for_by_levels():
    """They end where their own error is what is left, and a product tells the rest."""
    problem = periodic.rough(512, 512, 5)
    with ContactSolver(problem) as solver, ContactSolver(problem, options={"ksp_rtol": 1e-6}) as strict:
        expected = solver.solve(approach=0.3 * problem.gap.mean())
        found = strict.solve(approach=0.3 * problem.gap.mean())
    assert found.converged and found.fallbacks == 0
    assert found.operator_applications < 1.5 * expected.operator_applications


@pytest.mark.parametrize("by_levels", [0, 0.05])
def test_a_pressure_that_is_off_is_computed_anew_not_solved_further(by_levels):
    """Single precision leaves 1e-7: a verification that finds 5000 times what is allowed is about p, not the solver."""
    rng, n = np.random.default_rng(0), 512
    height = np.where(rng.random((n, n)) < 0.02, 1.0, 0.0) + 1e-3 * rng.normal(size=(n, n))
    grid = Grid(n, n, 1 / n, 1 / n)
    problem = ContactProblem(grid, periodic.MATERIAL, 0.02 * (height.max() - height), periodic=True)
    options = {"lcp_rtol": 6.6e-11, "lcp_defect_correction": by_levels}
    with ContactSolver(problem, options=options) as solver:
        found = solver.solve(mean_pressure=3e-6 * periodic.MATERIAL.contact_modulus)
    assert found.converged and found.fallbacks == 0
    assert found.operator_applications < 48
