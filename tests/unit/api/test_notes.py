"""Notes tell what cannot be meant, and only then."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from running import solve

import app
from app import ContactProblem, Grid, Material, Sphere, read_surface
from app.api.notes import elastic_modulus

GRID = Grid.from_domain(32, 32, (-1.0, 1.0, -1.0, 1.0))
SOFT = Material.from_contact_modulus(100.0)


def notes(gap, approach, grid=GRID, **more):
    return solve(ContactProblem(grid, SOFT, gap, **more), approach).notes


def test_a_small_contact_in_the_middle_gets_no_note():
    assert notes(Sphere(10.0), 0.01) == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((Sphere(1.0), 0.3), r"the maximum pressure is 0\.\d+ E\*"),
        ((lambda x, y: 0.6 * np.hypot(x, y), 1e-2), "the rms slope is 0.5[0-9]"),
        ((Sphere(0.1), 0.01), "the distances vary by .* are they in mm"),
        ((Sphere(10.0), 2.5), "approach each other by 2.5 mm beyond first touch, more than the patch is wide"),
        ((Sphere(10.0), 1e-4), r"contact is at most \d cells? wide"),
        ((lambda x, y: x**2, 0.01, Grid.from_domain(64, 1, (-1.0, 1.0, 0.0, 0.1))), "no plane strain"),
        ((lambda x, y: x**2 + 0 * y, 0.01, Grid.from_domain(64, 2, (-1.0, 1.0, 0.0, 0.1))), "no plane strain"),
    ],
)  # fmt: skip
def test_a_doubtful_problem_gets_its_note(arguments, message):
    assert any(re.search(message, note) for note in notes(*arguments)), notes(*arguments)


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (Material.pair((210e9, 210e9), (0.3, 0.3)), "Young's modulus is 2.1e+11 N/mm2, more than"),
        (Material.pair((1.1e6, np.inf), (0.1, 0.3)), None),
        (Material.pair((5e-4, np.inf), (0.5, 0.3)), "Young's modulus is 0.0005 N/mm2, less than"),
        (Material.combined(82e9, 0.28), r"E\* is 1.14e+11 N/mm2, more than"),
        (SOFT, None),
    ],
)
def test_moduli_that_no_solid_has_get_a_note(material, message):
    found = [
        note for note in solve(ContactProblem(GRID, material, Sphere(10.0)), 0.01).notes if "MPa" in note
    ]
    assert len(found) == (message is not None)
    assert all(
        re.match(message.replace("+", r"\+"), note.removeprefix("the contact modulus ")) for note in found
    )


@pytest.mark.parametrize(
    ("young", "poisson", "has_note"),
    [
        ((210, 210), (0.3, 0.3), True),
        ((3, 210), (0.35, 0.3), True),
        ((70, np.inf), (0.33, 0), True),
        ((500, 210e3), (0.3, 0.3), False),
        ((5, 5), (0.49, 0.49), False),  # rubber
        ((500, np.inf), (0.46, 0.3), False),  # PTFE
        ((1, 1), (0.0, 0.0), False),  # without units
        ((2600, 1800), (0.38, 0.38), False),  # plastics
    ],
)
def test_moduli_that_may_be_in_gpa_get_a_note(young, poisson, has_note):
    found = solve(ContactProblem(GRID, Material.pair(young, poisson), Sphere(10.0)), 0.01).notes
    finite = max(value for value in young if np.isfinite(value))
    assert any(f"for GPa write {finite:g}e3" in note for note in found) == has_note


@pytest.mark.parametrize(
    ("domain", "message"),
    [
        ((0, 0.24, 0, 0.32), "square if the sides of the patch are exchanged"),
        ((0, 0.32, 0, 0.23), "nearly square"),
        ((0, 0.32, 0, 0.24), None),
    ],
)
def test_nearly_square_cells_of_a_measured_surface_get_a_note(tmp_path, domain, message):
    np.save(tmp_path / "s.npy", np.random.default_rng(3).normal(size=(24, 32)))
    surface = read_surface(tmp_path / "s.npy", "um")
    found = notes(None, -1e-3, surface.grid(domain), surfaces=[surface])
    assert len([note for note in found if "square" in note]) == bool(message)
    assert any(message in note for note in found) if message else True
    spacing = (domain[1] / 32, domain[3] / 24)
    surface = read_surface(tmp_path / "s.npy", "um", spacing=spacing)  # known, not worked out of a patch
    assert not any("square" in note for note in notes(None, -1e-3, surface.grid(), surfaces=[surface]))


@pytest.mark.parametrize(
    ("cells", "patch"),
    [
        ((32, 2), (-0.5, 0.5, 0, 0.0625)),
        ((256, 256), (-4, 4, -4, 4)),
        ((2, 64), (-0.02, 0.01, 0, 1)),
        ((2, 8), None),
    ],
)
def test_a_line_contact_of_few_cells_gets_a_note(cells, patch):
    """The half-width of this contact is a hundredth of a cell at most: the cells say how large the pressure is."""
    grid = Grid.from_domain(*cells, patch or (-0.02, 0.01, 0, 0.2), periodic=True)
    line = ContactProblem(grid, SOFT, lambda x, y: x**2 / 20 + 0 * y)
    found = solve(line, None, load=1e-8 * grid.ny * grid.dy).notes
    assert any(re.search("contact is at most [12] cells? wide in x", note) for note in found) == (
        patch is not None
    )


def test_a_long_line_contact_on_a_narrow_period_gets_no_note():
    grid = Grid.from_domain(256, 2, (-8, 8, 0, 1), periodic=True)
    assert not any("mm" in note for note in notes(lambda x, y: x**2 / 20 + 0 * y, 0.01, grid))


@pytest.mark.parametrize(
    ("gap", "has_note"),
    [
        (Sphere(10.0), False),
        (lambda x, y: 1e-3 * np.cos(3 * np.pi * x) * np.cos(2 * np.pi * y), False),
        (lambda x, y: 1e-2 * x + 1e-4 * np.cos(30 * x), True),
        (lambda x, y: 0.05 * np.hypot(x + 1, y + 1) ** 2, True),  # its apex is in a corner
        (np.random.default_rng(1).random((32, 32)), False),
    ],
)
def test_a_step_where_a_periodic_patch_repeats_gets_a_note(gap, has_note):
    problem = ContactProblem(GRID, SOFT, gap, periodic=True)
    found = solve(problem, None, None, load=1e-3).notes
    assert any("is not periodic" in note for note in found) == has_note


def test_micrometres_taken_for_millimetres_get_several_notes():
    """The trial of a new user: what is solved is not what was meant, and says so in three ways."""
    heights = np.random.default_rng(3).normal(size=(24, 25))
    grid = Grid.from_domain(25, 24, (0.0, 0.5, 0.0, 0.48))
    found = solve(ContactProblem(grid, SOFT, surfaces=[heights]), -1.0).notes
    assert sum("mm" in note or "slope" in note for note in found) >= 3
    found = solve(ContactProblem(grid, SOFT, surfaces=[1e-3 * heights]), -1e-3).notes
    assert not any("mm" in note or "slope" in note for note in found)


STEEL = Material.from_contact_modulus(1e5)


def test_a_touch_without_load_gets_no_note_on_its_width():
    coarse = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    ball = ContactProblem(coarse, STEEL, Sphere(10))
    assert not any("finer grid" in note for note in app.solve(ball, load=0).notes)
    assert any("finer grid" in note for note in app.solve(ball, load=1e-6).notes)


def test_a_constant_distance_on_a_periodic_patch_gets_a_note():
    def notes(nx):
        grid = Grid.from_domain(nx, 1, (-1, 1, 0, 1))
        return app.solve(ContactProblem(grid, STEEL, lambda x, y: x**2, periodic=True), load=1).notes

    assert any("the same in all cells" in note for note in notes(1))
    assert not any("the same in all cells" in note for note in notes(8))


@pytest.mark.parametrize(
    ("hardness", "load", "message"),
    [
        (19.0, 0.5, "the hardness 19 N/mm2 has no effect: the maximum pressure is .* N/mm2$"),
        (1e4, 0.5, "the hardness 10000 N/mm2 has no effect: .*above E./5: is it in N/mm2"),
        (0.03, 4 * 0.03, "all cells are plastic: 0.12 N is the largest load"),
        (1.5, 0.5, None),
        (0.01, 0.02, "the hardness 0.01 N/mm2 is .* of E.*: for GPa write 10$"),
    ],
)
def test_a_hardness_without_effect_or_limit_gets_its_note(hardness, load, message):
    found = solve(ContactProblem(GRID, SOFT, Sphere(10.0), hardness=hardness), None, None, load=load).notes
    found = [note for note in found if "hardness" in note or "plastic" in note]
    assert len(found) == (message is not None) and (message is None or re.search(message, found[0]))


def test_an_unloaded_body_gets_no_note_on_its_hardness():
    with app.ContactSolver(ContactProblem(GRID, SOFT, Sphere(10.0), hardness=1.5)) as solver:
        assert not any("hardness" in note for step in solver.path(load=[0.5, 0.2]) for note in step.notes)


LINING = Material.layer(25.0, 0.49, 0.5)


@pytest.mark.parametrize(
    ("material", "width", "modulus"),
    [
        (LINING, 1e-3, 25 / (1 - 0.49**2)),  # narrow contacts do not reach the base
        (LINING, 20.0, 25 * 0.51 / (1.49 * 0.02)),  # confined by base and contact
        (Material.coated((25.0, 25.0), (0.3, 0.3), 0.5), 0.4, 25 / (1 - 0.3**2)),  # a half-space
        (
            Material.coated((450e3, 4e3), (0.2, 0.4), 1e-5),
            0.4,
            4e3 / (1 - 0.4**2),
        ),  # a thin hard skin on plastic
    ],
)
def test_the_pressure_of_layered_bodies_is_compared_with_their_own_modulus(material, width, modulus):
    spot = SimpleNamespace(contact_area=width**2, perimeter=4 * width)
    assert elastic_modulus(material, spot, GRID) == pytest.approx(modulus, rel=5e-3)


@pytest.mark.parametrize(("load", "has_note"), [(30.0, False), (1500.0, True)])
def test_only_a_lining_under_more_than_its_confined_modulus_bears_gets_a_note(load, has_note):
    grid = Grid.from_domain(64, 1, (-8, 8, 0, 1), periodic="y")
    solution = app.solve(ContactProblem(grid, LINING, app.Cylinder(40)), load=load)
    assert solution.max_pressure > 0.25 * 25 / (1 - 0.49**2)
    assert any("effective modulus of these bodies" in note for note in solution.notes) == has_note


def test_a_layer_much_thicker_than_its_patch_gets_a_note():
    def notes(thickness):
        coated = Material.coated((4e5, 2e5), (0.2, 0.3), thickness)
        return app.solve(ContactProblem(GRID, coated, Sphere(10.0)), load=100.0).notes

    assert any("is the thickness in mm" in note for note in notes(11.0))
    assert not any("thick" in note for note in notes(0.05))


def test_only_cells_along_which_the_pressure_varies_must_be_small_for_a_layer():
    """A line contact on one cell does not depend on the length of the period."""

    def pressed(length, nu, cells=1):
        grid = Grid.from_domain(64, cells, (-4, 4, 0, length), periodic="y")
        problem = ContactProblem(grid, Material.layer(25.0, nu, 0.5), app.Cylinder(40))
        return app.solve(problem, load=20.0 * length)

    for nu in (0.49, 0.5):
        short, long = pressed(0.1, nu), pressed(5.0, nu)
        assert long.max_pressure == pytest.approx(short.max_pressure, rel=1e-5)
        assert not any("layer" in note for note in (*short.notes, *long.notes))
    assert any("thinner than cells" in note for note in pressed(5.0, 0.49, 4).notes)


STEEL = Material.pair((2.1e5, 2.1e5), (0.3, 0.3))


def notes_on(pattern, material, load, hardness=None, grid=GRID, gap=None):
    problem = ContactProblem(grid, material, gap or Sphere(10.0), hardness=hardness)
    return sum(bool(re.search(pattern, note)) for note in solve(problem, None, load=load).notes)


@pytest.mark.parametrize("width", [2, 4, 6, 8, 10, 12])
def test_contact_of_fewer_than_ten_cells_gets_a_note(width):
    grid = Grid.from_domain(32, 32, (-1.0, 1.0, -1.0, 1.0))

    def flat(x, y):
        return np.where(np.abs(x) < width / 32, 0.0 * y, 1.0)

    found = notes_on(f"contact is at most {width} cells wide in x", STEEL, 10.0, None, grid, flat)
    assert found == (width < 10)


@pytest.mark.parametrize(
    ("material", "load", "hardness", "has_note"),
    [
        (STEEL, 2e4, None, 1), (STEEL, 100.0, None, 0), (STEEL, 2e4, 7e3, 0), (SOFT, 20.0, None, 0),
        (Material.from_contact_modulus(1e5), 2e4, None, 1),
    ],
)  # fmt: skip
def test_metals_beyond_their_yield_without_a_hardness_get_a_note(material, load, hardness, has_note):
    assert notes_on("metals yield", material, load, hardness) == has_note


@pytest.mark.parametrize(
    ("thickness", "has_note"), [(2.0, 1), (2e-6, 1), (9e-6, 1), (2e-3, 0), (0.05, 0), (2.0e-5, 0)]
)
def test_coatings_of_a_doubtful_thickness_get_a_note(thickness, has_note):
    coated = Material.coated((3e5, 2.1e5), (0.2, 0.3), thickness, (2.1e5, 0.3))
    assert notes_on("thick.*: is the thickness in mm", coated, 100.0) == has_note
    lining = Material.layer(5.0, 0.4, thickness)
    assert notes_on("thick.*: is the thickness in mm", lining, 0.1) == (has_note and thickness < 1)


def test_a_coating_thicker_than_a_line_contact_is_wide_gets_a_note():
    grid = Grid.from_domain(64, 4, (-0.5, 0.5, 0.0, 10.0), periodic="y")
    coated = Material.coated((3e5, 2.1e5), (0.2, 0.3), 2.0, (2.1e5, 0.3))
    assert notes_on("thick, and the contact .* wide: is", coated, 1000.0, None, grid, app.Cylinder(10.0))
