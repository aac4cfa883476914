"""Bounds of the pressure: projection, contact set, and their users."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.bounds import PressureBounds

SHAPE = (6, 7)


APP = Path(__file__).resolve().parents[3] / "app"


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def bounds(rng):
    return PressureBounds(rng.random(SHAPE) < 0.9)


def projected(bounds, p, cells):
    out = np.full(SHAPE, np.nan)
    return bounds.project(p, cells, out), out


def test_projection_is_the_nearest_allowed_pressure(bounds, rng):
    p, cells = rng.normal(size=SHAPE), rng.random(SHAPE) < 0.5
    total, out = projected(bounds, p, cells)
    np.testing.assert_array_equal(out, np.where(cells, np.clip(p, bounds.lower, bounds.upper), 0.0))
    assert total == pytest.approx(out.sum(), rel=1e-13)
    again = out.copy()
    bounds.project(again, cells, again)
    np.testing.assert_array_equal(again, out)


def test_contact_is_pressure_or_overlap(bounds, rng):
    _, p = projected(bounds, rng.normal(size=SHAPE), bounds.admissible)
    gap, admissible = rng.normal(size=SHAPE), bounds.admissible
    np.testing.assert_array_equal(bounds.contact(p, gap), admissible & ((p > 0) | (gap <= 0)))
    np.testing.assert_array_equal(bounds.contact(p, gap, 0.5), admissible & ((p > 0.5) | (gap <= 0)))
    overlap = bounds.overlap(p, gap)
    assert overlap.sum() == pytest.approx(gap[admissible & (p == 0) & (gap < 0)].sum(), rel=1e-13)


def test_release_removes_the_tension(bounds, rng):
    p, contact = rng.normal(size=SHAPE), rng.random(SHAPE) < 0.7
    p[~contact] = 0
    before, released, change = p.copy(), np.zeros(SHAPE, bool), np.zeros(SHAPE)
    total, tension = bounds.tension(p, contact)
    assert total == pytest.approx(p.sum(), rel=1e-12)
    assert bounds.release(p, contact, released, change) == (before < 0).sum()
    np.testing.assert_array_equal(released, before < 0)
    np.testing.assert_array_equal(before + change, p)
    assert tension == pytest.approx(change.sum(), rel=1e-12)
    assert bounds.tension(p, contact)[1] == 0
    assert not contact[released].any()


@pytest.mark.parametrize("method", ["fast", "mg_v11", "norm"])
def test_initial_pressure_is_projected(method):
    """A start from another problem may have pressures that are not allowed."""
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = (x**2 + y**2) / 20
    holed = np.where(np.hypot(x, y) < 0.2, np.nan, gap)
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1e3), gap), method) as solver:
        start = solver.solve(approach=0.02)
        pressure = np.where(x > 0.3, -start.pressure, start.pressure)
        solver.update(ContactProblem(grid, solver.problem.material, holed))
        cold = solver.solve(approach=0.02)
        for other in (start, replace(start, pressure=pressure)):
            assert_proved_equal(solver.solve(approach=0.02, start=other), cold)


def test_only_the_bounds_compare_and_clip_pressures():
    """No other module of the solvers compares a pressure with zero."""
    spelt = re.compile(
        r"\bp(\[\w+(, \w+)*\])? < 0|maximum\((\w+\.)?(p|pressure|values)\b|max\(p\[\w+\], 0|\.p > 0\b"
    )
    found = []
    for folder in ("contact", "methods", "multigrid"):
        for path in (APP / folder).rglob("*.py"):
            text = ast.unparse(ast.parse(path.read_text(encoding="utf-8")))  # without comments
            code = re.sub(r'""".*?"""', "", text, flags=re.DOTALL)
            found += [path.relative_to(APP).as_posix()] if spelt.search(code) else []
    assert set(found) <= {"contact/bounds.py", "contact/bounds_loops.py"}
