"""Stresses of a solution, and wrong questions for them."""

import numpy as np
import pytest

import app.subsurface
from app import ContactProblem, Grid, Material, Sphere, solve
from app.base.errors import InputError
from app.cli.subsurface import stress
from app.halfspace.stress.subsurface import SubsurfaceStress

GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
BALL = ContactProblem(GRID, Material.from_contact_modulus(1e5), Sphere(10))


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("body 0: allowed: 1, 2", lambda: stress(solve(BALL, approach=0.001), body=0)),
        (
            "x nan: must be a finite",
            lambda: stress(solve(BALL, approach=0.001), 0.3).line([0.1], np.nan, 0.0),
        ),
        ("y '0': must be a finite", lambda: stress(solve(BALL, approach=0.001), 0.3).section([0.1], y="0")),
        ("one at least", lambda: stress(solve(BALL, approach=0.001), 0.3).line([], 0.0, 0.0)),
        ("read_result", lambda: stress("ball.h5")),
        ("from 0 to 0.5", lambda: SubsurfaceStress(np.zeros(GRID.shape), GRID, "0.3")),
    ],
)
def test_wrong_questions_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_stress_is_part_of_the_documented_module():
    assert app.subsurface.stress is stress
