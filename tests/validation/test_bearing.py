"""Hertz, two bodies by their radii."""

import pytest

from app import ContactProblem, Grid, Material, Paraboloid, solve


def test_bearing_on_the_patch_that_hertz_gives():
    """Both bodies' radii in, Hertz's numbers out; the error falls with the grid."""
    shape, steel = Paraboloid.between((20, 480), (-150, -500), 7), Material.pair((208e3,) * 2, (0.3,) * 2)
    exact = shape.analytic(steel.contact_modulus, load=80e3)
    errors = []
    for n in (32, 64):
        grid = Grid.from_domain(n, n, (-1.5 * exact.a, 1.5 * exact.a, -1.5 * exact.b, 1.5 * exact.b))
        solution = solve(ContactProblem(grid, steel, shape), load=80e3)
        errors.append(abs(solution.approach / exact.approach - 1))
        assert solution.notes == () or "E*" in solution.notes[0]
    assert errors[1] < 2e-3 and errors[1] < errors[0]
    assert solution.max_pressure == pytest.approx(exact.max_pressure, rel=5e-3)
