"""Analytic values beside those of a solution."""

import pytest
from cases import APPROACH, hertz
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
    for apart in (
        {"approach": -1.0},
        {"load": 0.0},
    ):  # a sphere touches before it reaches the centre of a cell
        found = solve(hertz(16), **{"approach": None, "method": None, **apart})
        assert not any(name.startswith("analytic") for name in found.attributes), apart
