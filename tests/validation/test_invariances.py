"""Conditions, symmetries and scaling of the solution."""

from itertools import pairwise

import numpy as np
import pytest
from running import assert_solves_lcp, solve

from app import ContactProblem
from app.halfspace.grid import Grid
from app.halfspace.influence import Material, dense_matrix

UNIT = Material(1 / np.pi, 0.0)  # compliance 1

GRID = Grid(40, 31, 0.3, 0.2, x0=-6.0, y0=-3.1)


def bumps(x, y):
    """A shape without any symmetry, with several contact spots."""
    return (
        0.05 * (np.sin(2 * x + 1) + np.cos(3.1 * y + 0.4 * x)) + 0.02 * (x - 0.3) ** 2 + 0.03 * (y + 0.2) ** 2
    )


def solve_bumps(approach=0.05, grid=GRID, shape=bumps, material=UNIT, lcp_rtol=1e-12, **how):
    return solve(ContactProblem(grid, material, shape), approach, lcp_rtol=lcp_rtol, **how)


@pytest.fixture(scope="module")
def reference():
    return solve_bumps()


def on_grid(grid=GRID):
    return bumps(*np.meshgrid(grid.x(), grid.y()))


def assert_same(found, expected, tolerance=1e-9):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_conditions_of_contact(reference):
    assert_solves_lcp(reference, 1e-12)
    p, e, contact = reference.pressure, reference.gap, reference.contact
    assert 20 < contact.sum() < contact.size / 2
    assert np.abs(p * e).max() < 1e-11 * p.max() * np.abs(reference.undeformed_distance).max()
    A = dense_matrix(GRID, UNIT.compliance)
    np.testing.assert_allclose(reference.displacement.reshape(-1), A @ p.reshape(-1), rtol=1e-12)


@pytest.mark.parametrize(
    ("method", "options"),
    [("norm", {"lcp_nested": True}), ("fast", {"lcp_precision": "double"}), ("fast", {})]
    + [(f"{nested}mg_v{cycle}", {}) for nested in ("", "f") for cycle in ("11", "10", "01")],
)
def test_all_methods_find_the_one_solution(reference, method, options):
    solution = solve_bumps(method=method, lcp_rtol=1e-9, **options)
    assert_solves_lcp(solution, 1e-9)
    assert_same(solution.pressure, reference.pressure, 1e-6)
    np.testing.assert_array_equal(solution.contact, reference.contact)


@pytest.mark.parametrize("flip", [np.s_[::-1, :], np.s_[:, ::-1], np.s_[::-1, ::-1]])
def test_reflection(reference, flip):
    assert_same(solve_bumps(shape=on_grid()[flip]).pressure, reference.pressure[flip])


def test_exchange_of_x_and_y(reference):
    turned = Grid(GRID.ny, GRID.nx, GRID.dy, GRID.dx)
    assert_same(solve_bumps(grid=turned, shape=on_grid().T).pressure, reference.pressure.T)


def test_translation(reference):
    # Nothing but the distance of the cells matters: a wider patch with the bodies elsewhere in it.
    wide = Grid(50, 40, GRID.dx, GRID.dy, x0=100.0)
    shape = np.full(wide.shape, 10.0)
    shape[4:35, 7:47] = on_grid()
    moved = solve_bumps(grid=wide, shape=shape, lcp_rtol=1e-14)
    assert_same(moved.pressure[4:35, 7:47], reference.pressure)
    assert moved.load == pytest.approx(reference.load, rel=1e-9)


def test_pressure_is_proportional_to_the_stiffness(reference):
    stiff = Material(7 * UNIT.shear_modulus, UNIT.poisson_ratio)
    assert_same(solve_bumps(material=stiff).pressure, 7 * reference.pressure)
    nearly_incompressible = Material(UNIT.shear_modulus, 0.5)
    assert_same(solve_bumps(material=nearly_incompressible).pressure, 2 * reference.pressure)


def test_pressure_is_proportional_to_the_heights(reference):
    scaled = solve_bumps(approach=3 * 0.05, shape=3 * on_grid())
    assert_same(scaled.pressure, 3 * reference.pressure)
    np.testing.assert_array_equal(scaled.contact, reference.contact)


def test_similar_bodies_have_the_same_pressure(reference):
    larger = Grid(GRID.nx, GRID.ny, 5 * GRID.dx, 5 * GRID.dy)
    scaled = solve_bumps(approach=5 * 0.05, grid=larger, shape=5 * on_grid())
    assert_same(scaled.pressure, reference.pressure)
    assert scaled.load == pytest.approx(25 * reference.load, rel=1e-9)


def test_approach_and_shape_enter_by_their_difference(reference):
    assert_same(solve_bumps(approach=1.05, shape=on_grid() + 1).pressure, reference.pressure)


def test_load_contact_and_displacement_grow_with_the_approach():
    steps = [solve_bumps(approach=d) for d in np.linspace(-0.05, 0.3, 8)]
    loads = np.array([s.load for s in steps])
    assert (np.diff(loads) > 0).all()
    assert (np.diff(loads, 2) > 0).all()  # convex: contact can only get stiffer
    for before, after in pairwise(steps):
        assert (after.displacement >= before.displacement - 1e-12).all()
        assert (after.contact >= before.contact).all()


def test_work_of_the_load_is_the_elastic_energy():
    # dE/d(approach) = F, E = 1/2 p.u dx dy
    low, middle, high = (solve_bumps(approach=d) for d in (0.05 - 1e-4, 0.05, 0.05 + 1e-4))
    energy = [0.5 * GRID.cell_area * np.vdot(s.pressure, s.displacement) for s in (low, high)]
    assert (energy[1] - energy[0]) / 2e-4 == pytest.approx(middle.load, rel=1e-4)


def test_everything_in_contact():
    flat = solve_bumps(approach=3.0, shape=np.zeros(GRID.shape))
    assert_solves_lcp(flat, 1e-12)
    assert flat.contact.all()
    np.testing.assert_allclose(flat.displacement, 3.0, rtol=1e-10)


def test_fixed_number_of_iterations_is_not_called_converged():
    solution = solve_bumps(lcp_max_it=1)
    assert not solution.converged
    assert solution.iterations == 1
    assert "not enough" in solution.message
    assert (solution.pressure >= 0).all()


def asperity(x, y):
    return 10 * (1 - np.exp(-((x - 9) ** 2) - (y - 9) ** 2))


@pytest.mark.parametrize("method", ["norm", "fmg_v11", "fast"])
def test_empty_start_set_of_a_nested_iteration_does_not_mean_no_contact(method):
    # The centre of a coarse cell sits on the tip, which the fine cells miss: the displacement from the coarse
    # grid lifts all of them, although four overlap as long as nothing presses.
    problem = ContactProblem(Grid(16, 16, 1.0, 1.0), UNIT, asperity)
    expected = solve(problem, 8.0)
    assert expected.contact.sum() == 4
    found = solve(problem, 8.0, method, lcp_nested=True)
    assert_solves_lcp(found)
    assert found.load == pytest.approx(expected.load, rel=1e-5)
