"""A periodic patch one cell wide is plane strain: Hertz's line contact."""

import numpy as np
import pytest

from app import ContactProblem, Cylinder, Grid, Material, solve

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
