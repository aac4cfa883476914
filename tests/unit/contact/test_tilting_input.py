"""Arguments of tilts: what is refused, before any work."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, Sphere
from app.base.errors import InputError
from app.contact.tilting_input import single_path, split_tilting

STEEL = Material.isotropic(210e3, 0.3)


def sphere(**how):
    return ContactProblem(Grid.from_domain(16, 16, (-1, 1, -1, 1), **how), STEEL, Sphere(10))


def test_tilting_is_separated_from_the_loading():
    assert split_tilting({"load": 3, "tilt": None}) == ({}, {"load": 3})
    assert single_path({"load": [1, 2], "load_centre": [0, 1]}) == (
        "load",
        [1, 2],
        {"load_centre": (0.0, 1.0)},
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"load": 1, "tilt": 0.1}, "tilt: must be two numbers, for x and y"),
        ({"load": 1, "moment": (np.nan, 0)}, "moment: must be two numbers"),
        ({"load": 1, "load_centre": ("a", 0)}, "load_centre 'a': must be a number"),
        ({"load": 1, "tilt": (0, 0), "moment": (0, 0)}, "at most one of them"),
        ({"approach": 1e-3, "load_centre": (0, 0)}, "load_centre: needs a prescribed load above 0"),
        ({"load": 0, "moment": (0, 0)}, "moment: needs a prescribed load above 0"),
        ({"load": 1, "load_centre": (1.0, 0)}, "must be inside the convex hull"),
        ({"load": 1, "moment": (0, 0.94)}, "inside the convex hull"),
    ],
)
def test_wrong_tilts_are_refused_in_one_line(given, message):
    with ContactSolver(sphere()) as solver, pytest.raises(InputError, match=message) as refused:
        solver.solve(**given)
    assert "\n" not in str(refused.value)


def test_a_body_that_repeats_cannot_tilt_in_this_direction():
    for periodic, tilt, axis in ((True, (0, 0.1), "y"), ("y", (0.01, 0.1), "y"), ("x", (0.01, 0), "x")):
        with ContactSolver(sphere(periodic=periodic)) as solver:
            with pytest.raises(InputError, match=f"cannot tilt in {axis}"):
                solver.solve(load=1, tilt=tilt)
            with pytest.raises(InputError, match="cannot tilt in"):
                solver.solve(load=1, load_centre=(0, 0))
    with ContactSolver(sphere(periodic="y")) as solver:
        assert solver.solve(load=10, tilt=(0.01, 0)).pressure_centre_x > 0.05


@pytest.mark.parametrize("method", ["fmg_v11", "norm"])
def test_other_methods_refuse(method):
    with ContactSolver(sphere(), method) as solver, pytest.raises(InputError, match="bodies cannot tilt"):
        solver.solve(load=1, tilt=(0, 0.01))
    with ContactSolver(sphere(), method) as solver, pytest.raises(InputError, match="bodies cannot tilt"):
        solver.solve(load=1, load_centre=(0, 0))


def test_a_background_pressure_has_a_centre_of_its_own():
    body = ContactProblem(sphere().grid, STEEL, Sphere(10), background_pressure=1.0)
    with ContactSolver(body) as solver:
        assert solver.solve(load=20, tilt=(0.01, 0)).converged
        with pytest.raises(InputError, match="not with a background pressure"):
            solver.solve(load=20, load_centre=(0.1, 0))


def test_a_hull_of_holes_limits_the_centre():
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    shape = np.where((grid.x() > 0) | (grid.y()[:, None] > 0), 0.0, np.nan)
    with ContactSolver(ContactProblem(grid, STEEL, shape)) as solver:
        assert solver.solve(load=10, load_centre=(-0.3, 0.4)).converged
        with pytest.raises(InputError, match="convex hull"):
            solver.solve(load=10, load_centre=(-0.5, -0.5))


def test_the_largest_load_has_no_other_centre():
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    message = "must be less than 360 N, which pressures up to the hardness can carry there"
    problem = ContactProblem(grid, STEEL, Sphere(10), hardness=100.0)
    with ContactSolver(problem) as solver, pytest.raises(InputError, match=message):
        solver.solve(load=400.0, load_centre=(0.1, 0))
