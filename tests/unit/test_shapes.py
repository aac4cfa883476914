"""Base shapes, surfaces on them, and the patch that follows from Hertz."""

import itertools
import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mpi4py import MPI

from app import Cone, ContactProblem, Cylinder, FlatPunch, Grid, Material, Paraboloid, Plane, Sphere
from app.base.errors import InputError
from app.cli.problem_options import PROBLEM_OPTIONS, make_problem
from app.options.option_table import OptionReader
from app.problems.random_surfaces import SelfAffineSurface, WavySurface

GRID = Grid.from_domain(12, 8, (-3.0, 3.0, -2.0, 2.0))
STEEL = Material.from_contact_modulus(1e5)
SHAPES = (Plane(), Paraboloid(5.0, 7.0), Sphere(6.0), Cylinder(4.0, 3.0), Cone(10.0), FlatPunch(3.0))


def made(**texts):
    given = {"contact_modulus": "1e5", **{name: str(text) for name, text in texts.items()}}
    reader = OptionReader(PROBLEM_OPTIONS, given)
    return make_problem(reader, given, MPI.COMM_SELF)[0]


@pytest.mark.parametrize("angle", [0, 25, 60, 90, -40])
@pytest.mark.parametrize(
    ("radii1", "radii2"), [((20, 50), (30, 90)), ((40, 20), (15, -60)), ((9, 9), (7, 8))]
)
def test_relative_paraboloid_is_the_sum_of_both_bodies(radii1, radii2, angle):
    """In the turned axes, up to round-off, and with x next to body 1's first axis."""
    shape = Paraboloid.between(radii1, radii2, angle)
    turn = np.radians(shape.bodies[3])
    assert abs(turn) <= np.pi / 4 + 1e-12
    x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))

    def body(radii, degrees):
        to = np.radians(degrees) - turn
        first, second = x * np.cos(to) + y * np.sin(to), y * np.cos(to) - x * np.sin(to)
        return first**2 / (2 * radii[0]) + second**2 / (2 * radii[1])

    np.testing.assert_allclose(shape.distance(x, y), body(radii1, 0) + body(radii2, angle), atol=1e-15)


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        (((20, np.inf), (30, np.inf), 0), "line contact, see -problem cylinder"),
        (((20, -10), (30, np.inf), 0), "both positive"),
        (((0, 1), (1, 1), 0), "radii of body 1"),
    ],
)
def test_bodies_that_make_no_ellipse(radii, message):
    with pytest.raises(ValueError, match=message):
        Paraboloid.between(*radii)


@pytest.mark.parametrize("shape", [Sphere, Cylinder, partial(Cylinder, 1.0), Cone, FlatPunch])
@pytest.mark.parametrize("size", [0, -1.0, np.nan, "6", None])
def test_sizes_are_positive_numbers(shape, size):
    with pytest.raises(InputError, match="must be"):
        shape(size)


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
@pytest.mark.parametrize("given", [None, False, True, "love"])
def test_a_problem_and_its_grid_are_periodic_alike(of_grid, given):
    grid = Grid.from_domain(8, 8, (0, 1, 0, 1), of_grid)
    expected = {None: of_grid, False: "", True: of_grid or "spectral", "love": "love"}[given]
    problem = ContactProblem(grid, Material.isotropic(1e5, 0.3), Sphere(1.0), periodic=given)
    for same in (problem, replace(problem, gap=Sphere(2.0)), pickle.loads(pickle.dumps(problem))):
        assert same.periodic == same.grid.periodic == same.describe()["periodic_symbol"] == expected
    assert replace(problem, periodic=False).periodic == problem.on(Grid(4, 4, 1.0, 1.0)).periodic == ""


def test_any_shape_takes_surfaces_from_options():
    options = {"grid": "24", "domain": "-1,1,-1,1", "surface_cutoff": 0.25, "surface_rms_slope": 0.01}
    smooth = made(problem="cone", cone_angle=5, grid="24", domain="-1,1,-1,1")
    rough = made(problem="cone", cone_angle=5, **options)
    plane = made(problem="rough", **options)
    both = made(problem="cone", cone_angle=5, surface_sigma=1e-3, **options)
    punch = made(problem="punch", punch_diameter=1, **options)
    assert smooth.sampled is False and len(both.surfaces) == 2 and len(punch.surfaces) == 1
    g = rough.grid
    np.testing.assert_allclose(rough.shape_on(g), smooth.shape_on(g) + plane.shape_on(g), atol=1e-16)
    facts = both.describe()
    assert facts["surface_hurst"] == 0.8 and facts["surface_sigma"] == 1e-3 and facts["surface_seed2"] == 7


@pytest.mark.parametrize("shape", [{"problem": "sphere", "sphere_radius": 20},
                                   {"problem": "hertz", "hertz_rx": 5, "hertz_ry": 30}])  # fmt: skip
def test_default_patch_is_about_hertz_s_ellipse(shape):
    by_approach = made(**shape, approach=0.01)
    exact = by_approach.reference(0.01)
    by_load = made(**shape, load=exact.load, grid="64,32")
    assert by_approach.grid.shape == (256, 256) and by_load.grid.shape == (32, 64)
    for grid in (by_approach.grid, by_load.grid):
        assert (-grid.x0, -grid.y0) == pytest.approx((1.5 * exact.a, 1.5 * exact.b), rel=1e-12)
        assert (grid.nx * grid.dx, grid.ny * grid.dy) == pytest.approx((3 * exact.a, 3 * exact.b), rel=1e-12)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"problem": "sphere", "sphere_radius": 2}, "-domain is missing"),
        ({"problem": "sphere", "sphere_radius": 2, "load": 1, "periodic": ""}, "-domain is missing"),
        ({"problem": "sphere", "sphere_radius": 2, "load": 1, "surface_cutoff": 1}, "-domain is missing"),
        ({"problem": "sphere", "sphere_radius": 2, "approach": -1}, "without contact"),
        ({"problem": "hertz"}, "neither -hertz_rx .* -body1_radii"),
        ({"problem": "hertz", "body1_radii": "1,2"}, "-body2_radii is missing"),
        ({"problem": "hertz", "body1_radii": "1,0", "body2_radii": "1,1"}, "-body1_radii 1,0: must be"),
        ({"problem": "cone", "cone_angle": 90}, "-cone_angle 90: must be"),
        ({"problem": "cylinder", "cylinder_radius": 1, "grid": "8,1", "domain": "0,1,0,1"}, "no line contact"),
        ({"problem": "rough", "grid": "1,8", "domain": "0,1,0,1"}, "no line contact"),
        ({"problem": "punch", "punch_diameter": 0.01, "grid": "8", "domain": "0,1,0,1"}, "no cell centre"),
    ],
)  # fmt: skip
def test_refused(texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        made(**texts)


@pytest.mark.parametrize(("corner", "touches"), [(-1.0, True), (0.353, True), (0.354, False)])
def test_a_punch_is_found_without_looking_at_all_cells(corner, touches):
    punch, grid = FlatPunch(1.0), Grid.from_domain(10**6, 10**6, (corner, 2, corner, 2))
    if touches:
        punch.check_grid(grid)
    else:
        with pytest.raises(InputError, match="no cell centre"):
            punch.check_grid(grid)


def test_files_and_own_problems_take_surfaces_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gap, heights = np.random.default_rng(3).random((2, 6, 8))
    np.save("gap.npy", gap)
    np.save("heights.npy", heights)
    (tmp_path / "own_bowl.py").write_text("def bowl(x, y):\n    return x**2 + y**2\n")
    options = {"surface_file": "heights.npy", "surface_unit": "um", "domain": "0,4,0,3"}
    of_file = made(problem="file", gap_file="gap.npy", **options)
    np.testing.assert_allclose(of_file.shape_on(of_file.grid), gap - 1e-3 * heights, rtol=1e-14)
    other = {name.replace("surface_file", "surface_file2"): text for name, text in options.items()}
    on_other = made(problem="file", gap_file="gap.npy", **other)
    np.testing.assert_array_equal(on_other.shape_on(on_other.grid), of_file.shape_on(of_file.grid))
    own = made(problem="python", problem_type="own_bowl.py:bowl", **options)
    x, y = own.grid.x(), own.grid.y()[:, None]
    np.testing.assert_allclose(own.shape_on(own.grid), x**2 + y**2 - 1e-3 * heights, rtol=1e-13)
    assert own.describe()["problem"] == "own_bowl.py:bowl" and own.describe()["surface_file"] == "heights.npy"
    assert of_file.describe()["gap_file"] == "gap.npy"


def test_surfaces_on_a_problem_with_surfaces_have_facts_of_their_own():
    """However many lie on however many: numbers go on, and all surfaces are counted."""
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
