"""A by levels is nearly A, and a solve that changes u by it finds the same pressure."""

import numpy as np
import pytest
from cases import APPROACH, hertz, punch

from app import ContactProblem, ContactSolver, Grid, Material, solve
from app.halfspace.influence import influence_quadrant
from app.halfspace.product import Convolution
from app.methods import multilevel_operators
from app.methods.free.solver import TrackingSolver
from app.methods.multilevel_operators import create_multilevel_influence
from app.methods.multilevel_product import MultilevelOperator
from app.problems.random_surfaces import SelfAffineSurface

GRIDS = {
    "square": (Grid(128, 128, 1.0, 1.0), 0.01),
    "odd": (Grid(257, 150, 1.0, 1.0), 0.01),
    "long cells": (Grid(131, 200, 5 / 3, 1.0), 0.025),
    "longer": (Grid(131, 300, 3.0, 1.0), 0.025),
    "longest": (Grid(1100, 140, 0.05, 1.0), 0.025),
    "four levels": (Grid(1030, 1024, 0.1, 0.1), 0.01),
}


@pytest.mark.parametrize(("grid", "off"), GRIDS.values(), ids=GRIDS.keys())
def test_it_is_nearly_the_product(grid, off):
    """Worst for noise; next to nothing for what is smooth; and symmetric."""
    ny, nx = grid.shape
    nearly, rng = create_multilevel_influence(grid, 0.5), np.random.default_rng(ny)
    exactly = Convolution(lambda rows: influence_quadrant(grid, 0.5, rows), grid.shape)
    y, x = np.mgrid[:ny, :nx]
    corner = np.zeros(grid.shape)
    corner[0, -1] = 1.0
    fields = {
        "noise": (rng.normal(size=grid.shape), off),
        "cells": (rng.random(grid.shape) < 0.1, off),
        "ones": (np.ones(grid.shape), 1e-3),
        "wave": (np.cos(2 * np.pi * (3 * x / nx + 2 * y / ny)), 2e-3),
        "corner": (corner, 2 * off),
    }
    products = []
    for field, allowed in fields.values():
        found, expected = np.empty(grid.shape), np.empty(grid.shape)
        nearly.apply(field.astype(float), found)
        exactly.apply(field.astype(float), expected)
        products.append(found)
        assert np.linalg.norm(found - expected) < allowed * np.linalg.norm(expected)
        assert np.vdot(field, found) == pytest.approx(np.vdot(field, expected), rel=off)
    gram = np.array([[np.vdot(field, found) for found in products] for field, _ in fields.values()])
    np.testing.assert_allclose(gram, gram.T, rtol=0, atol=1e-13 * abs(gram).max())


def test_far_away_it_is_the_influence_of_a_point():
    grid = Grid(600, 140, 1.0, 1.0)
    p, u = np.zeros(grid.shape), np.empty(grid.shape)
    p[70, 5] = 1.0
    create_multilevel_influence(grid, 1.0).apply(p, u)
    x = np.arange(200, 600)
    np.testing.assert_allclose(u[70, x], 1 / (x - 5), rtol=2e-3)


@pytest.mark.parametrize(
    "grid", [Grid(100, 500, 1.0, 1.0), Grid(50, 500, 4.0, 1.0)], ids=["square", "long cells"]
)
def test_there_is_none_on_small_grids(grid):
    assert create_multilevel_influence(grid, 1.0) is None


def rough():
    grid = Grid.from_domain(256, 256, (0, 1, 0, 1))
    height = SelfAffineSurface(0.8, 1 / 8, 4 / 256, (1.0, 1.0), 1, rms_slope=0.1).height(grid.x(), grid.y())
    return ContactProblem(grid, Material.combined(80000.0, 0.3), height.max() - height)


PROBLEMS = {
    "hertz": (lambda: hertz(256), {"approach": APPROACH}),
    "punch": (lambda: punch(256), {"approach": 0.05}),
    "rough": (rough, {"approach": 0.015}),
    "rough, by load": (rough, {"load": 1500.0}),
}


@pytest.mark.parametrize(("problem", "control"), PROBLEMS.values(), ids=PROBLEMS.keys())
@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_pressure_is_that_without_it_for_less_work(problem, control, precision):
    how = {"lcp_rtol": 1e-8, "lcp_precision": precision}
    plain = solve(problem(), options=how | {"lcp_defect_correction": 0}, **control)
    found = solve(problem(), options=how, **control)
    assert found.converged
    assert not found.fallbacks
    assert found.operator_applications < 0.9 * plain.operator_applications
    assert np.linalg.norm(found.pressure - plain.pressure) < 1e-5 * np.linalg.norm(plain.pressure)


@pytest.mark.parametrize("wrong", [0.5, 3.0])
def test_where_levels_do_not_help_products_take_over(monkeypatch, wrong):
    """A pass that leaves more than half of the residual is the last one of its kind."""
    apply, nearly = MultilevelOperator.apply, []

    def wrongly(self, p, out, rows=None):
        apply(self, p, out, rows)
        if self is mine.get("influence"):
            out *= wrong

    with ContactSolver(rough(), options={"lcp_rtol": 1e-7}) as solver:
        expected = solver.solve(approach=0.015)
    improve, mine = TrackingSolver.improve, {}

    def improve_and_tell(self, *arguments):
        mine["influence"] = self.operator.multipliers.get("influence")
        nearly.append(self.multilevel)
        return improve(self, *arguments)

    monkeypatch.setattr(TrackingSolver, "improve", improve_and_tell)
    monkeypatch.setattr(multilevel_operators.MultilevelOperator, "apply", wrongly)
    with ContactSolver(rough(), options={"lcp_rtol": 1e-7}) as solver:
        found = solver.solve(approach=0.015)
    assert found.converged
    assert not nearly[-1]
    assert np.linalg.norm(found.pressure - expected.pressure) < 1e-4 * np.linalg.norm(expected.pressure)
