"""Bounds of the pressure: projection, contact set, and their users."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, Material
from app.base.errors import InputError
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


def test_steps_are_projected(bounds, rng):
    _, p = projected(bounds, rng.normal(size=SHAPE), bounds.admissible)
    step = rng.normal(size=SHAPE)
    _, expected = projected(bounds, p + step, bounds.admissible)
    np.testing.assert_allclose(p + bounds.change(p, step), expected, rtol=0, atol=1e-15)
    contact = rng.random(SHAPE) < 0.5
    there = p + bounds.to_bound(p, contact)
    np.testing.assert_array_equal(there[contact], p[contact])
    assert not bounds.between(there)[~contact].any()


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


def test_mean_pressures_make_waves_allowed(rng):
    bounds, waves = PressureBounds(np.ones(SHAPE, bool)), rng.normal(size=SHAPE)
    least, most = bounds.mean_pressures(waves)
    assert (waves + least).min() == 0
    assert most == np.inf
    assert bounds.mean_pressures(waves[:0])[0] == -np.inf  # a rank without rows


@pytest.mark.parametrize("kind, allowed", [("load", 12.0), ("mean_pressure", 12.0 / 4)])
def test_load_above_the_largest_is_refused(kind, allowed):
    grid = Grid.from_domain(8, 8, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1.0), np.zeros((8, 8)), hardness=3.0)
    with ContactSolver(problem) as solver:
        solver.check(**{kind: allowed})
        with pytest.raises(
            InputError, match=f"^{kind} .*: no cell carries more than its hardness; it must be at most"
        ) as error:
            solver.check(**{kind: 1.01 * allowed})
    assert "\n" not in str(error.value)


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
    assert set(found) <= {"contact/bounds.py", "contact/bounds_kernels.py", "contact/capped_kernels.py"}
