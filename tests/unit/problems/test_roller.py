"""Rollers: crowns, and their pressure against the theory of line contact."""

import numpy as np
import pytest

from app import (
    ContactProblem,
    ContactSolver,
    Cylinder,
    EllipticHertz,
    Grid,
    InputError,
    Material,
    Roller,
    read_result,
    solve,
)
from app.base.mpi import MPI
from app.problems.default_patch import default_patch
from app.problems.roller import NUMBERS, read_profile
from app.reference.line import LineContact

RADIUS, LENGTH, LOAD = 10.0, 16.0, 20000.0
STEEL = Material.isotropic(210e3, 0.3)
LOG = {"crown": "log", "design_load": LOAD, "contact_modulus": STEEL.contact_modulus}


def pressed(roller, n=64, load=LOAD):
    patch = default_patch(roller, STEEL.contact_modulus, load=load)
    return solve(ContactProblem(Grid.from_domain(n, n, patch), STEEL, roller), load=load)


def test_logarithmic_crown_has_the_pressure_and_approach_of_line_contact():
    """The formulas neglect terms of order (a / L)^2; 27 cells span the width."""
    line = LineContact(RADIUS, LENGTH, STEEL.contact_modulus, LOAD)
    solution = pressed(Roller(RADIUS, LENGTH, **LOG))
    middle = np.abs(solution.y) < 0.35 * LENGTH
    assert solution.pressure[middle].max(axis=1) == pytest.approx(line.max_pressure, rel=0.02)
    assert solution.approach == pytest.approx(line.approach, rel=0.01)
    assert solution.max_pressure < 1.2 * line.max_pressure  # the ends, with the drop of Johns and Gohar
    assert solution.notes == ()


def test_straight_roller_has_pressure_peaks_at_its_ends():
    line = LineContact(RADIUS, LENGTH, STEEL.contact_modulus, LOAD)
    solution = pressed(Roller(RADIUS, LENGTH))
    middle = solution.pressure[len(solution.y) // 2].max()
    assert 0.9 * line.max_pressure < middle < line.max_pressure < 0.6 * solution.max_pressure
    row = np.unravel_index(solution.pressure.argmax(), solution.pressure.shape)[0]
    assert abs(solution.y[row]) == pytest.approx(LENGTH / 2, abs=solution.grid.dy)


@pytest.mark.parametrize("crown", [LOG, {}])
def test_numbers_of_a_roller_are_those_of_line_contact(crown):
    """The edge factor of a good crown is near 1; that of a sharp end grows without limit."""
    line = LineContact(RADIUS, LENGTH - 2.0, STEEL.contact_modulus, LOAD)
    roller = Roller(RADIUS, LENGTH, end_chamfer=1.0, **crown)
    coarse, solution = (pressed(roller, n) for n in (32, 64))
    half_cell = solution.grid.dx / 2
    assert solution.line_load == pytest.approx(LOAD / 14)
    assert solution.line_pressure == pytest.approx(line.max_pressure)
    assert solution.line_half_width == pytest.approx(line.a)
    assert solution.half_width_middle == pytest.approx(line.a, abs=half_cell + 0.05 * line.a)
    assert solution.half_width_lower_end == solution.half_width_upper_end
    # The middle carries what Hertz's line contact carries, from its width to its pressure.
    middle = solution.pressure[len(solution.y) // 2].max()
    assert middle == pytest.approx(2 * solution.line_load / np.pi / solution.line_half_width, rel=0.1)
    if crown:
        assert 0.9 < solution.edge_factor < 1.2
        assert solution.half_width_lower_end < solution.half_width_middle + 2 * half_cell
    else:
        assert solution.edge_factor == solution.max_pressure / solution.line_pressure > 1.6
        assert solution.edge_factor > 1.1 * coarse.edge_factor
        assert solution.half_width_lower_end > solution.half_width_middle


def test_numbers_of_a_tilted_roller_change_ends_with_the_tilt():
    up, down = (pressed(Roller(RADIUS, LENGTH, tilt=tilt, **LOG)) for tilt in (3e-4, -3e-4))
    assert up.half_width_lower_end == down.half_width_upper_end < up.half_width_upper_end
    assert up.half_width_upper_end == down.half_width_lower_end
    assert up.edge_factor == pytest.approx(down.edge_factor, rel=1e-3) and up.edge_factor > 1.05


def test_numbers_of_a_roller_are_in_files_paths_and_texts(tmp_path):
    roller = Roller(RADIUS, LENGTH, crown="arc", crown_radius=1000.0)
    patch = default_patch(roller, STEEL.contact_modulus, load=100)
    problem = ContactProblem(Grid.from_domain(32, 32, patch), STEEL, roller)
    with ContactSolver(problem) as solver:
        path = solver.path(load=[50, 100])
        *_, solution = path
        untouched = solver.solve(load=0)
    solution.save(tmp_path / "roller.h5")
    result = read_result(tmp_path / "roller.h5")
    assert solution.edge_factor == 0  # the contact does not reach the ends
    for name in NUMBERS:
        assert getattr(result, name) == getattr(solution, name) == path.table[name][1]
    assert "line load 6.25 N/mm, for which Hertz's line contact has" in solution.summary()
    assert not untouched.attributes.keys() & set(NUMBERS)


def test_bodies_without_a_line_contact_of_hertz_have_widths_only():
    roller = Roller(RADIUS, LENGTH)
    patch = default_patch(roller, STEEL.contact_modulus, load=LOAD)
    coated = Material.coated((4e5, 2e5), (0.2, 0.3), 0.1)
    for problem in (
        ContactProblem(Grid.from_domain(32, 32, patch), coated, roller),
        ContactProblem(Grid.from_domain(32, 32, patch), STEEL, roller, surface_compliance=1e-6),
        ContactProblem(Grid.from_domain(32, 32, patch), STEEL, roller, background_pressure=1.0),
    ):
        solution = solve(problem, load=LOAD)
        assert solution.attributes.keys() & {"line_pressure", "line_half_width", "edge_factor"} == set()
        assert solution.half_width_middle > 0 and solution.line_load == LOAD / LENGTH
        assert "edge factor" not in solution.summary()


@pytest.mark.mpi(2, 3)
def test_numbers_of_a_roller_are_the_same_on_all_ranks(comm):
    roller = Roller(RADIUS, LENGTH, tilt=3e-4, **LOG)
    patch = default_patch(roller, STEEL.contact_modulus, load=LOAD)
    problem = ContactProblem(Grid.from_domain(32, 32, patch), STEEL, roller)
    shared, alone = (solve(problem, load=LOAD, comm=ranks) for ranks in (comm, MPI.COMM_SELF))
    for name in NUMBERS:
        assert getattr(shared, name) == pytest.approx(getattr(alone, name), rel=1e-4)


def test_light_load_on_an_arc_is_the_contact_of_hertz():
    roller = Roller(RADIUS, LENGTH, crown="arc", crown_radius=1000.0)
    exact = EllipticHertz.from_load(RADIUS, 1000.0, STEEL.contact_modulus, 100.0)
    solution = pressed(roller, load=100.0)
    assert exact.b < LENGTH / 2
    assert solution.approach == pytest.approx(exact.approach, rel=5e-3)
    assert solution.max_pressure == pytest.approx(exact.max_pressure, rel=0.02)


def test_a_tilted_arc_is_a_shifted_arc():
    """y^2 / 2 R - t y is the arc about y = t R, nearer by t^2 R / 2."""
    radius, tilt, dy, n = 500.0, 4e-4, 0.05, 48
    assert tilt * radius == pytest.approx(4 * dy)
    here, there = (
        Grid.from_domain(24, n, (-0.3, 0.3, shift - n * dy / 2, shift + n * dy / 2))
        for shift in (0.0, 4 * dy)
    )
    straight, tilted = (Roller(10, 20, crown="arc", crown_radius=radius, tilt=t) for t in (0.0, tilt))
    material = Material.from_contact_modulus(1e5)
    wanted = solve(ContactProblem(here, material, straight), load=500)
    found = solve(ContactProblem(there, material, tilted), load=500)
    np.testing.assert_allclose(found.pressure, wanted.pressure, rtol=1e-5, atol=1e-5 * wanted.max_pressure)
    assert found.approach == pytest.approx(wanted.approach - tilt**2 * radius / 2, rel=1e-6)
    assert found.attributes["roller_tilt"] == tilt


def test_a_straight_roller_carries_more_at_the_end_that_is_pressed_in():
    centres = []
    for tilt in (1e-4, -1e-4):
        roller = Roller(5, 10, tilt=tilt)
        patch = default_patch(roller, 1e5, load=5000)
        problem = ContactProblem(Grid.from_domain(32, 32, patch), Material.from_contact_modulus(1e5), roller)
        centres.append(solve(problem, load=5000).pressure_centre_y)
    assert centres[0] > 0.05 and centres[1] == pytest.approx(-centres[0], rel=1e-4)


def test_crowns_are_counted_from_the_chamfers():
    y = np.linspace(-9, 9, 37)
    profile = Roller(10, 18, crown=[(0, 0), (4, 0), (8, 0.01)], end_chamfer=1)
    whole = Roller(10, 18, crown=[(-8, 0.01), (-4, 0), (4, 0), (8, 0.01)], end_chamfer=1)
    function = Roller(10, 18, crown=lambda y: 0.01 * np.maximum(np.abs(y) - 4, 0) / 4, end_chamfer=1)
    expected = np.where(np.abs(y) <= 8, 0.01 * np.maximum(np.abs(y) - 4, 0) / 4, np.nan)
    for roller in (profile, whole, function):
        np.testing.assert_allclose(roller.drop(y), expected, atol=1e-15)
    arc = Roller(10, 18, crown="arc", crown_radius=500, end_chamfer=1)
    np.testing.assert_allclose(arc.distance(0.3, 6.0), 0.3**2 / 20 + 36 / 1000, rtol=1e-12)
    short, chamfered = (Roller(10, n, end_chamfer=c, **LOG) for n, c in ((16, 0), (18, 1)))
    np.testing.assert_array_equal(short.drop(y), chamfered.drop(y))


def test_ends_are_edges_of_cells_of_the_default_patch():
    grid = Grid.from_domain(64, 64, default_patch(Roller(10, 18, end_chamfer=1), 1e5, load=100))
    assert ((8 - grid.y0) / grid.dy) % 1 == pytest.approx(0, abs=1e-9)
    assert np.count_nonzero(np.abs(grid.y()) <= 8) * grid.dy == pytest.approx(16, rel=1e-12)


@pytest.mark.parametrize("shape", [Roller(10, 4), Cylinder(10, 4)])
@pytest.mark.parametrize("periodic", ["y", True])
def test_a_period_contains_the_whole_body(shape, periodic):
    for low, high in ((-2, 2), (-2.5, 3)):
        grid = Grid.from_domain(8, 16, (-1, 1, low, high), periodic)
        assert ContactProblem(grid, STEEL, shape).grid.periodic
    for low, high in ((0, 4), (-2.5, 1.5), (-1, 1)):
        with pytest.raises(
            InputError, match=r"length .* 4: .* must lie inside the patch, which repeats in y"
        ):
            ContactProblem(Grid.from_domain(8, 16, (-1, 1, low, high), periodic), STEEL, shape)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"end_chamfer": 8}, "chamfer of the roller 8: must be"),
        ({"crown": "barrel"}, "must be one of none, log, arc"),
        ({"crown": "log"}, "needs design_load"),
        ({"crown": "arc"}, "needs crown_radius"),
        ({"crown_radius": 4}, "crown_radius .* has no effect"),
        ({"crown": "arc", "crown_radius": -4}, "crown_radius -4: must be positive"),
        ({"crown": [1, 2, 3]}, "two columns"),
        ({"crown": [(0, 0), (0, 1)]}, "y must increase"),
        ({"crown": [(0, 0), (7, 1)]}, "must reach 8 mm"),
        ({"crown": [(1, 0), (8, 1)]}, "from there to 0"),
    ],
)
def test_wrong_rollers_are_refused(parts, message):
    with pytest.raises(InputError, match=message) as refused:
        Roller(**{"radius": RADIUS, "length": LENGTH} | parts)
    assert "\n" not in str(refused.value)


def test_profiles_are_read_from_text(tmp_path):
    file = tmp_path / "crown.txt"
    file.write_text("# y, z\n0, 0\n6 0.001\n8, 0.02 # end\n")
    np.testing.assert_array_equal(read_profile(str(file)), [(0, 0), (6, 0.001), (8, 0.02)])
    with pytest.raises(InputError, match="cannot be read"):
        read_profile(str(tmp_path / "missing.txt"))
