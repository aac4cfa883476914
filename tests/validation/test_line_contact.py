"""Hertz: line contact on a periodic patch one cell wide, which is plane strain; two bodies by their radii."""

import numpy as np
import pytest

from app import ContactProblem, Cylinder, Grid, Material, Paraboloid, solve

RADIUS, E_STAR = 10.0, 1000.0


@pytest.mark.parametrize(("width", "load"), [(1.0, 1.0), (0.25, 2.0)])
def test_pressure_under_a_cylinder(width, load):
    grid = Grid.from_domain(2048, 1, (-4.0, 4.0, 0.0, width))
    problem = ContactProblem(grid, Material.from_contact_modulus(E_STAR), Cylinder(RADIUS), periodic=True)
    solution = solve(problem, load=load * width)
    half = np.sqrt(4 * load * RADIUS / (np.pi * E_STAR))
    exact = 2 * load / (np.pi * half) * np.sqrt(np.maximum(1 - (grid.x() / half) ** 2, 0))
    # Images 8 mm away curve the surface by (half / 8)^2 of what the cylinder does.
    assert np.abs(solution.pressure[0] - exact)[np.abs(grid.x()) < 0.9 * half].max() < 0.005 * exact.max()
    assert solution.contact_cells * grid.dx == pytest.approx(2 * half, abs=2.5 * grid.dx)


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
