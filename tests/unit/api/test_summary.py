"""The summary of a solution."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, Sphere, solve
from app.api.summary import summary


@pytest.mark.parametrize("periodic", [False, True])
def test_without_load_nothing_is_said_of_where_it_acts(periodic):
    x = np.linspace(-1, 1, 16) ** 2
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), np.add.outer(x, x), periodic=periodic)
    zero = {} if not periodic else {"approach": -0.0, "mean_gap": -0.0}
    for load, known in ((0.0, False), (1.0, not periodic)):
        with ContactSolver(problem) as solver:
            found = solver.solve(load=load)
        said = summary(found.attributes | zero, found.grid)
        assert ("centre of pressure" in said) == known
        assert "nan" not in said and "-0 " not in said


@pytest.mark.parametrize("hardness", [2e3, np.full((16, 16), 2e3), np.full((16, 16), [2e3] + 15 * [np.inf])])
def test_a_hardness_is_summarised_with_its_plastic_area(hardness):
    x = np.linspace(-1, 1, 16) ** 2
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), np.add.outer(x, x), hardness=hardness)
    with ContactSolver(problem) as solver:
        solution = solver.solve(load=2000.0)
    text = solution.summary()
    assert f"plastic area {solution.plastic_area:.6g} mm2" in text
    assert ("hardness 2000 N/mm2: plastic" in text) == (np.ndim(hardness) == 0)
    assert ("largest load 8000 N" in text) == bool(np.isfinite(hardness).all())


@pytest.mark.parametrize(("periodic", "axis"), [("y", "x"), ("x", "y")])
def test_a_line_contact_has_its_half_width_and_load_per_length(periodic, axis):
    sides = (-1, 1, 0, 3) if periodic == "y" else (0, 3, -1, 1)
    grid = Grid.from_domain(*((64, 4) if periodic == "y" else (4, 64)), sides, periodic)
    problem = ContactProblem(
        grid, Material.from_contact_modulus(100.0), lambda x, y: ((x, y)[axis == "y"]) ** 2 + 0 * x * y
    )
    solution = solve(problem, load=3.0)
    width = solution.contact.any(axis=0 if axis == "x" else 1).sum() * 2 / 64
    text = summary(solution.attributes, grid)
    assert (
        f"load per length 1 N/mm, half width of the contact {width / 2:.6g} mm, mean half width {width / 2:.6g}"
        in text
    )
    assert f"centre of pressure {axis} = 0 mm\n" in text and "nan" not in text


def test_the_time_of_compilation_is_apart_from_those_of_set_up_and_solve():
    grid = Grid.from_domain(8, 8, (-1, 1, -1, 1))
    found = solve(ContactProblem(grid, Material.from_contact_modulus(1e5), np.eye(8)), load=10)
    line = f"{found.solve_seconds:.3g} s on 1 rank, set-up {found.setup_seconds:.3g} s"
    for seconds, end in ((0.0, "\n"), (43.12, ", compiling, once: 43.1 s\n")):
        assert line + end in summary(found.attributes | {"compile_seconds": seconds}, found.grid) + "\n"


def test_surface_background_and_wear_have_a_line_each():
    grid, steel = Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.isotropic(210e3, 0.3)
    ball = {"grid": grid, "material": steel, "gap": Sphere(10)}
    plain = solve(ContactProblem(**ball), load=100).summary()
    assert not any(word in plain for word in ("background", "compliance", "worn", "time", "relax"))
    compliant = ContactProblem(**ball, surface_compliance=2e-6, background_pressure=3.0)
    text = solve(compliant, load=100).summary()
    assert "\n  background pressure 3 N/mm2\n" in text and "\n  surface compliance 2e-06 mm3/N\n" in text
    each = ContactProblem(**ball, background_pressure=np.full(grid.shape, 3.0))
    assert "\n  background pressure of each cell\n" in solve(each, load=100).summary()
    with ContactSolver(ContactProblem(**ball)) as solver:
        *_, worn = solver.wear(1e-9, 4000, 4, load=100)
    assert "\n  worn volume 0.0004 mm3 at a sliding distance of 4000 mm\n" in worn.summary()


@pytest.mark.parametrize(("body", "bodies"), [(None, "1 and 2"), (1, "1")])
def test_a_step_of_creep_has_its_time_and_the_spectrum(body, bodies):
    rubber = Material.pair((10, 20), (0.5, 0.3)).viscoelastic((0.1, 10), (0.3, 0.4), body)
    ball = ContactProblem(Grid.from_domain(16, 16, (-2, 2, -2, 2)), rubber, Sphere(10))
    with ContactSolver(ball) as solver:
        *_, last = solver.creep([0, 2, 5.5], load=1)
        sudden = solver.solve(load=1).summary()
    spectrum = f", relaxing body: {bodies}, by 30% in 0.1 s, 40% in 10 s\n"
    assert spectrum in last.summary() and spectrum in sudden
    assert "\n  time 5.5 s\n" in last.summary() and "time" not in sudden
