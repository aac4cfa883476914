"""Contact problems: shapes and surfaces on them."""

import itertools
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from app import (
    Cone,
    ContactProblem,
    Cylinder,
    FlatPunch,
    Grid,
    InputError,
    Material,
    Paraboloid,
    Plane,
    SelfAffineSurface,
    Sphere,
    solve,
)
from app.problems.random_surfaces import WavySurface

GRID = Grid.from_domain(12, 8, (-3.0, 3.0, -2.0, 2.0))
STEEL = Material.from_contact_modulus(1e5)
SHAPES = (Plane(), Paraboloid(5.0, 7.0), Sphere(6.0), Cylinder(4.0, 3.0), Cone(10.0), FlatPunch(3.0))


def test_gap_is_the_shape_less_all_heights():
    heights = np.random.default_rng(1).random(GRID.shape)
    waves = WavySurface((3, 2), 0.8, 0.1, 1, (6.0, 4.0), (-3.0, -2.0))
    fractal = SelfAffineSurface(0.8, 3.0, 1.0, (6.0, 4.0), 2, rms_height=0.1, origin=(-3.0, -2.0))
    surfaces = (heights, waves, fractal, lambda x, y: 0.1 * x * y)
    total = heights + waves.heights_on(GRID) + fractal.heights_on(GRID) + 0.1 * GRID.x() * GRID.y()[:, None]
    for shape, rows in itertools.product(SHAPES, (slice(None), slice(3, 5), slice(4, 4))):
        smooth = ContactProblem(GRID, STEEL, shape)
        rough = ContactProblem(GRID, STEEL, shape, surfaces=surfaces)
        np.testing.assert_allclose(
            smooth.shape_on(GRID, rows) - rough.shape_on(GRID, rows),
            np.where(np.isnan(smooth.shape_on(GRID, rows)), np.nan, total[rows]), atol=1e-14,
        )  # fmt: skip
        assert (smooth.sampled, rough.sampled) == (False, True)
        assert rough.reference(0.1) is None
        assert rough.describe()["problem"] == shape.name and rough.describe()["surfaces"] == 4


@pytest.mark.parametrize("of_grid", ["", "spectral", "love"])
@pytest.mark.parametrize("argument", [None, False, True, "love"])
def test_a_problem_and_its_grid_are_periodic_alike(of_grid, argument):
    grid = Grid.from_domain(8, 8, (0, 1, 0, 1), of_grid)
    expected = {None: of_grid, False: "", True: of_grid or "spectral", "love": "love"}[argument]
    problem = ContactProblem(grid, Material.isotropic(1e5, 0.3), Sphere(1.0), periodic=argument)
    for same in (problem, replace(problem, gap=Sphere(2.0)), pickle.loads(pickle.dumps(problem))):
        assert same.periodic == same.grid.periodic == same.describe()["periodic_symbol"] == expected
    assert replace(problem, periodic=False).periodic == problem.on(Grid(4, 4, 1.0, 1.0)).periodic == ""


def test_facts_of_nested_surfaces_are_numbered():
    grid, material = Grid.from_domain(16, 16, (0, 1, 0, 1)), Material.combined(82000.0, 0.28)
    seeds = [[1], [2, 3], [4]]
    problem = None
    for of_it in seeds:
        rough = [SelfAffineSurface(0.8, 1.0, 0.2, (1, 1), seed, rms_slope=0.1) for seed in of_it]
        problem = ContactProblem(grid, material, problem, surfaces=rough)
    facts = problem.describe()
    assert [facts[f"surface_seed{k}"] for k in ("", 2, 3, 4)] == [1, 2, 3, 4]
    assert facts["surfaces"] == 4
    assert ContactProblem(grid, material, problem).describe()["surfaces"] == 4


def test_a_problem_as_a_gap_gives_its_shape_only():
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    steel, soft = Material.pair((210000, np.inf), (0.3, 0.3)), Material.from_contact_modulus(5.0)
    solution = solve(ContactProblem(grid, steel, ContactProblem(grid, soft, Sphere(10))), load=100)
    plain = solve(ContactProblem(grid, steel, Sphere(10)), load=100)
    assert solution.approach == plain.approach
    assert solution.problem["contact_modulus"] == steel.contact_modulus
    assert solution.problem["sphere_radius"] == plain.problem["sphere_radius"] == 10
    assert "hertz_load" not in solution.problem


HEIGHTS = np.random.default_rng(3).random(GRID.shape) * 1e-3
ROUGH = SelfAffineSurface(0.8, 1, 1, (10, 10), 1, rms_height=1e-4)


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        ("real numbers", lambda: ContactProblem(GRID, STEEL, HEIGHTS + 1j)),
        ("Sphere\\(...\\)", lambda: ContactProblem(GRID, STEEL, Sphere)),
        ("a function of x and y", lambda: ContactProblem(GRID, STEEL, lambda x, y: None).shape_on(GRID)),
        ("a Grid", lambda: ContactProblem(STEEL, GRID, HEIGHTS)),
        ("a Material", lambda: ContactProblem(GRID, 1e5, HEIGHTS)),
        ("surfaces: .*a sequence", lambda: ContactProblem(GRID, STEEL, surfaces=Sphere(10))),
        ("periodic: .*surfaces=", lambda: ContactProblem(GRID, STEEL, Sphere(10), [HEIGHTS])),
        ("shape \\(3, 3\\)", lambda: ContactProblem(GRID, STEEL, lambda x, y: np.eye(3)).shape_on(GRID)),
        (r"in surfaces=\[...\]", lambda: ContactProblem(GRID, STEEL, ROUGH)),
        ("at least 2,2 cells", lambda: ContactProblem(Grid.from_domain(1, 1, (0, 1, 0, 1)), STEEL, surfaces=[ROUGH])),
    ],
)  # fmt: skip
def test_wrong_parts_of_a_problem_are_refused(message, wrong):
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)


def test_a_problem_is_printed_in_one_line():
    wavy = ContactProblem(GRID, STEEL, surfaces=[ROUGH], periodic=True)
    assert repr(wavy).startswith("<ContactProblem: rough, 12 x 8 cells of ")
    assert repr(wavy).endswith(", periodic, E* 100000 N/mm2, 1 surface>") and len(repr(wavy)) < 120
    assert repr(ROUGH) == f"<SelfAffineSurface: Hurst exponent 0.8, rms slope {ROUGH.rms_slope:.4g}, seed 1>"


@pytest.mark.parametrize("number", [lambda x, y: x if x > y else y, lambda x, y: math.hypot(x, y)])
def test_the_error_of_a_gap_of_numbers_suggests_vectorize(number):
    with pytest.raises((TypeError, ValueError), match=r"arrays x, y; np.vectorize\(f\)"):
        ContactProblem(GRID, STEEL, number).shape_on(GRID)
    assert ContactProblem(GRID, STEEL, np.vectorize(number)).shape_on(GRID).shape == GRID.shape


def test_coated_bodies_have_no_analytic_solution():
    grid = Grid.from_domain(8, 8, (-1, 1, -1, 1))
    coated = Material.coated(young=(4e5, 2e5), poisson=(0.25, 0.3), thickness=0.01)
    assert ContactProblem(grid, coated, Sphere(10)).reference(0.01) is None
    assert ContactProblem(grid, Material.isotropic(2e5, 0.3), Sphere(10)).reference(0.01) is not None


def test_periodic_may_be_a_truth_value_of_numpy():
    for periodic in (True, False):
        numpy_problem = ContactProblem(GRID, STEEL, Plane(), periodic=np.bool_(periodic))
        assert numpy_problem.grid == ContactProblem(GRID, STEEL, Plane(), periodic=periodic).grid
