"""Analytic values beside those of a solution."""

from dataclasses import replace

import pytest
from cases import APPROACH, hertz, periodic_rough
from running import solve


@pytest.fixture(scope="module")
def of_hertz():
    return solve(hertz(128), APPROACH, None), hertz(128).reference(APPROACH)


def test_analytic_values_stand_beside(of_hertz):
    solution, known = of_hertz
    assert solution.attributes["analytic_load"] == pytest.approx(known.load)
    assert solution.attributes["analytic_semi_axis_major"] == pytest.approx(known.a)
    by_load = solve(hertz(64), None, None, load=known.load)
    assert by_load.attributes["analytic_approach"] == pytest.approx(APPROACH)
    # A sphere touches before it reaches the centre of a cell.
    for apart in ({"approach": -1.0}, {"load": 0.0}):
        found = solve(hertz(16), **{"approach": None, "method": None, **apart})
        assert not any(name.startswith("analytic") for name in found.attributes), apart


def test_there_are_no_analytic_values_of_plastic_contact():
    for hardness, known in (1e5, True), (1e3, False):
        solution = solve(replace(hertz(32), hardness=hardness), None, None, load=9e4)
        assert ("analytic_approach" in solution.attributes) == known == (not solution.plastic.any())


def test_persson_theory_has_the_hardness():
    problem = periodic_rough(64)
    scale = problem.material.contact_modulus * solve(problem, None, None, load=1.0).rms_slope
    for hardness in (0.2 * scale, 1e3 * scale):
        capped = replace(problem, hardness=hardness)
        values = solve(capped, None, None, load=0.1 * scale).attributes
        if hardness > scale:
            assert values["persson_hardness_fraction"] == pytest.approx(values["persson_fraction"])
            assert values["persson_plastic_fraction"] == 0
        else:
            assert values["persson_hardness_fraction"] > values["persson_fraction"]
            assert values["plastic_fraction"] == pytest.approx(values["persson_plastic_fraction"], rel=0.2)
