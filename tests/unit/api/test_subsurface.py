"""Stresses below a solution."""

import numpy as np
import pytest

import app.subsurface
from app import ContactProblem, Grid, Material, Sphere, read_result, solve
from app.api.subsurface import find_poisson_ratio, stress
from app.base.errors import InputError
from app.halfspace.stress.subsurface import SubsurfaceStress, von_mises

GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
BALL = ContactProblem(GRID, Material.from_contact_modulus(1e5), Sphere(10))


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("body 0: allowed: 1, 2", lambda: stress(solve(BALL, approach=0.001), body=0)),
        ("x nan: must be a finite", lambda: stress(solve(BALL, approach=0.001), 0.3).line([0.1], np.nan, 0.0)),
        ("y '0': must be a finite", lambda: stress(solve(BALL, approach=0.001), 0.3).section([0.1], y="0")),
        ("at least one", lambda: stress(solve(BALL, approach=0.001), 0.3).line([], 0.0, 0.0)),
        ("read_result", lambda: stress("ball.h5")),
        ("is SubsurfaceStress; needed: a Solution", lambda: stress(SubsurfaceStress(np.zeros(GRID.shape), GRID, 0.3))),
        ("from 0 to 0.5", lambda: SubsurfaceStress(np.zeros(GRID.shape), GRID, "0.3")),
    ],
)  # fmt: skip
def test_wrong_questions_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_stress_is_part_of_the_documented_module():
    assert app.subsurface.stress is stress


def test_stress_of_a_solution_is_that_of_its_file(tmp_path):
    grid = Grid.from_domain(32, 24, (-1, 1, -0.75, 0.75), periodic=True)
    problem = ContactProblem(
        grid, Material.from_contact_modulus(1e5), lambda x, y: 0.01 * np.cos(np.pi * x) + 0 * y, periodic=True
    )
    solution = solve(problem, mean_pressure=100)
    solution.save(tmp_path / "waves.h5")
    with pytest.raises(InputError, match="Poisson's ratio of the body is not known"):
        stress(solution)
    one = stress(solution, 0.3).plane(0.1)
    other = stress(read_result(tmp_path / "waves.h5"), 0.3).plane(0.1)
    assert von_mises(one) == pytest.approx(von_mises(other))
    assert one[2].mean() == pytest.approx(-100)


def test_poisson_ratio_is_that_of_the_chosen_body():
    facts = {"poisson": np.array([0.3, 0.35]), "young": np.array([np.inf, 3000.0]), "poisson_ratio": 0.2}
    assert find_poisson_ratio(facts) == 0.35  # the other one is rigid
    assert find_poisson_ratio(facts, 1) == 0.3
    assert find_poisson_ratio({"poisson_ratio": 0.2}) == 0.2
    assert find_poisson_ratio({}) is None
