"""Problems from options: shapes, surfaces, and the patch that follows from Hertz."""

import numpy as np
import pytest
from mpi4py import MPI

from app import Roller
from app.base.errors import InputError
from app.cli.geometry import find_load, find_loading, make_problem
from app.cli.geometry_options import DEFAULT_CELLS
from app.cli.problem_options import PROBLEM_OPTIONS
from app.options.option_table import OptionReader
from app.reference import EllipticHertz

from ..problems.from_options import ROUGH, problem_from, rough_problem


def heights(problem):
    return -problem.shape_on(problem.grid)


def test_rms_height_and_combined_moduli_are_alternatives():
    problem = rough_problem("32", without=["surface_rms_slope", "contact_modulus"], surface_rms_height="0.01",
                   shear_modulus="72", poisson_ratio="0.28")  # fmt: skip
    assert heights(problem).std() == pytest.approx(0.01, rel=1e-12)
    assert problem.material.contact_modulus == pytest.approx(100)


@pytest.mark.parametrize(
    "texts", [{"problem": "sphere", "sphere_radius": 10}, {**ROUGH, "surface_cutoff": 0.5}]
)
def test_a_domain_alone_has_the_default_number_of_cells(texts):
    grid = problem_from(**{**texts, "domain": "-1,2,0,2"}, load=10).grid
    assert (grid.shape, grid.domain) == ((DEFAULT_CELLS, DEFAULT_CELLS), (-1, 2, 0, 2))


@pytest.mark.parametrize(
    ("texts", "length"),
    [
        ({"problem": "roller", "roller_radius": 5, "roller_length": 10, "roller_end_chamfer": 0.5}, 9),
        ({"problem": "cylinder", "cylinder_radius": 5, "cylinder_length": 8}, 8),
        ({"problem": "cylinder", "cylinder_radius": 5, "domain": "-1,1,0,3"}, 3),
        ({"problem": "cylinder", "cylinder_radius": 5, "periodic": "y", "domain": "-1,1,0,3"}, 3),
        ({"problem": "file", "periodic": "x", "domain": "-1,1,0,3"}, 2),
        ({"problem": "sphere", "domain": "-1,1,0,3"}, "-line_load: only for -problem roller or cylinder"),
        (
            {"problem": "rough", "periodic": "true", "domain": "-1,1,0,3"},
            "-line_load: only for -problem roller",
        ),
        ({"problem": "cylinder", "cylinder_radius": 5}, "-line_load: needs -domain"),
    ],
)
def test_a_line_load_is_a_load_per_length(texts, length):
    options = OptionReader(
        PROBLEM_OPTIONS, {name: str(text) for name, text in texts.items()} | {"line_load": "20"}
    )
    if isinstance(length, str):
        with pytest.raises(InputError, match=length):
            find_load(options)
    else:
        assert find_load(options) == find_loading(options)["load"] == 20 * length


def test_the_default_roll_off_is_the_longest_side():
    assert rough_problem("32", without=["surface_rolloff"]).describe()["surface_rolloff"] == 3.0


@pytest.mark.parametrize(
    ("grid", "without", "texts", "message"),
    [
        ("24,15", (), {}, r"cut-off 0.25: .* must be at least 24,16 cells"),
        ("16", (), {"domain": "0,1,0,1", "surface_cutoff": "0.1"}, "at least 20,20 cells"),
        ("32", ["surface_cutoff"], {}, "-surface_cutoff is missing"),
        ("32", ["surface_rms_slope"], {}, "either its rms height or its rms slope"),
        ("32", (), {"surface_rms_height": "1"}, "either its rms height or its rms slope"),
        ("32", ["contact_modulus"], {"shear_modulus": "1"}, "-poisson_ratio is missing"),
    ],
)
def test_wrong_options_of_self_affine_surfaces_are_refused(grid, without, texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        rough_problem(grid, without, **texts)


def test_any_shape_takes_surfaces_from_options():
    options = {"grid": "24", "domain": "-1,1,-1,1", "surface_cutoff": 0.25, "surface_rms_slope": 0.01}
    smooth = problem_from(problem="cone", cone_angle=5, grid="24", domain="-1,1,-1,1")
    rough = problem_from(problem="cone", cone_angle=5, **options)
    plane = problem_from(problem="rough", **options)
    both = problem_from(problem="cone", cone_angle=5, surface_sigma=1e-3, **options)
    punch = problem_from(problem="punch", punch_diameter=1, **options)
    assert smooth.sampled is False and len(both.surfaces) == 2 and len(punch.surfaces) == 1
    g = rough.grid
    np.testing.assert_allclose(rough.shape_on(g), smooth.shape_on(g) + plane.shape_on(g), atol=1e-16)
    facts = both.describe()
    assert facts["surface_hurst"] == 0.8 and facts["surface_sigma"] == 1e-3 and facts["surface_seed2"] == 7


@pytest.mark.parametrize("shape", [{"problem": "sphere", "sphere_radius": 20},
                                   {"problem": "hertz", "hertz_rx": 5, "hertz_ry": 30}])  # fmt: skip
def test_default_patch_is_about_hertz_s_ellipse(shape):
    by_approach = problem_from(**shape, approach=0.01)
    exact = by_approach.reference(0.01)
    by_load = problem_from(**shape, load=exact.load, grid="64,32")
    assert by_approach.grid.shape == (256, 256) and by_load.grid.shape == (32, 64)
    for grid in (by_approach.grid, by_load.grid):
        assert (-grid.x0, -grid.y0) == pytest.approx((1.5 * exact.a, 1.5 * exact.b), rel=1e-12)
        assert grid.sides == pytest.approx((3 * exact.a, 3 * exact.b), rel=1e-12)


def test_patch_is_fitted_to_the_contact_of_a_function(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_valley.py").write_text("def valley(x, y):\n    return (x - 3)**2 / 8 + y**2 / 900\n")
    own = problem_from(
        problem="python", problem_type="own_valley.py:valley", domain="auto", load=10, grid="24,32"
    )
    exact = EllipticHertz.from_load(4, 450, 1e5, 10)
    assert own.grid.shape == (32, 24)
    assert own.grid.x().mean() == pytest.approx(3, abs=1e-2)
    assert own.grid.sides == pytest.approx((3 * exact.a, 3 * exact.b), rel=0.15)


def test_crowns_of_rollers_from_options(tmp_path):
    roller = {"problem": "roller", "roller_radius": 9, "roller_length": 12, "load": 4000}
    log = problem_from(**roller, roller_crown="log")
    assert log.shape == Roller(9, 12, "log", design_load=4000, contact_modulus=1e5)
    assert log.describe()["roller_design_load"] == 4000
    arc = problem_from(**roller, roller_crown="arc", roller_crown_radius=700, roller_end_chamfer=0.5)
    assert arc.shape == Roller(9, 12, "arc", 0.5, crown_radius=700)
    file = tmp_path / "crown.txt"
    file.write_text("0 0\n6 0.01\n")
    drop = problem_from(**roller, roller_crown="arc", roller_crown_drop=5.5**2 / 1400, roller_end_chamfer=0.5)
    assert drop.describe()["roller_crown_radius"] == pytest.approx(700)
    table = problem_from(**roller, roller_crown="profile", roller_profile=file)
    assert table.shape == Roller(9, 12, [(0, 0), (6, 0.01)])


def test_files_and_own_problems_take_surfaces_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gap, heights = np.random.default_rng(3).random((2, 6, 8))
    np.save("gap.npy", gap)
    np.save("heights.npy", heights)
    (tmp_path / "own_bowl.py").write_text("def bowl(x, y):\n    return x**2 + y**2\n")
    options = {"surface_file": "heights.npy", "surface_unit": "um", "domain": "0,4,0,3"}
    of_file = problem_from(problem="file", gap_file="gap.npy", **options)
    np.testing.assert_allclose(of_file.shape_on(of_file.grid), gap - 1e-3 * heights, rtol=1e-14)
    other = {name.replace("surface_file", "surface_file2"): text for name, text in options.items()}
    on_other = problem_from(problem="file", gap_file="gap.npy", **other)
    np.testing.assert_array_equal(on_other.shape_on(on_other.grid), of_file.shape_on(of_file.grid))
    own = problem_from(problem="python", problem_type="own_bowl.py:bowl", **options)
    x, y = own.grid.x(), own.grid.y()[:, None]
    np.testing.assert_allclose(own.shape_on(own.grid), x**2 + y**2 - 1e-3 * heights, rtol=1e-13)
    assert own.describe()["problem"] == "own_bowl.py:bowl" and own.describe()["surface_file"] == "heights.npy"
    assert of_file.describe()["gap_file"] == "gap.npy"


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"problem": "sphere", "sphere_radius": 2}, "-domain is missing"),
        ({"problem": "sphere", "sphere_radius": 2, "load": 1, "surface_cutoff": 1}, "-domain is missing"),
        ({"problem": "sphere", "sphere_radius": 2, "domain": "auto"}, "-domain auto: needs"),
        ({"problem": "sphere", "sphere_radius": 2, "domain": "auto", "load": 1, "periodic": ""}, "only for smooth"),
        ({"problem": "rough", "domain": "auto", "load": 1}, "auto: only for smooth bodies"),
        ({"problem": "sphere", "sphere_radius": 2, "domain": "auto", "load": 1, "surface_hurst": 1}, "only for smooth"),
        ({"problem": "sphere", "sphere_radius": 2, "domain": "auto", "approach": -1}, "auto: without contact"),
        ({"problem": "sphere", "sphere_radius": 2, "domain": "fit", "load": 1}, "-domain fit: must be x0,x1,y0,y1"),
        ({"problem": "roller", "roller_radius": 2, "roller_length": 3, "roller_crown": "log", "approach": 0.1},
         "needs design_load"),
        ({"problem": "hertz"}, "-hertz_rx is missing: .*-body1_radii"),
        ({"problem": "hertz", "body1_radii": "1,2"}, "-body2_radii is missing"),
        ({"problem": "cone", "cone_angle": 90}, "-cone_angle 90: must be"),
        ({"problem": "cylinder", "cylinder_radius": 1, "grid": "8,1", "domain": "0,1,0,1"}, "no line contact"),
        ({"problem": "punch", "punch_diameter": 0.01, "grid": "8", "domain": "0,1,0,1"}, "no cell centre"),
    ],
)  # fmt: skip
def test_wrong_options_of_shapes_are_refused(texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        problem_from(**texts)


def made(**texts):
    given = {"domain": "0,1,0,1", "shear_modulus": "1", "poisson_ratio": "0.3", **texts}
    return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)


@pytest.mark.parametrize("grid", ["5000000000", "99999999999999999999"])
def test_more_cells_than_petsc_can_number_are_refused(grid):
    with pytest.raises(InputError, match=f"grid {grid},{grid}: this PETSc can number"):
        made(problem="cone", cone_angle="1", grid=grid, approach="1")


@pytest.mark.parametrize("name", ["gap.h5", "gap.npy"])
def test_huge_sparse_gap_file_is_refused(sparse, name, small_machine):
    with pytest.raises(ValueError, match=r"grid 40000,40000: needs about 107 GiB .* 1 GiB are free"):
        made(problem="file", gap_file=sparse(name, 40_000))
    with pytest.raises(
        InputError, match=r"grid 1000000,1000000: this PETSc can number at most 2147483647 cells"
    ):
        made(problem="file", gap_file=sparse(name, 1_000_000))


@pytest.mark.parametrize("kind", ["load", "approach"])
def test_default_patch_suits_the_largest_step(kind):
    def patch(**loading):
        given = {"problem": "sphere", "sphere_radius": "10", "contact_modulus": "1e5", **loading}
        return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)[0].grid

    assert patch(**{f"{kind}_path": "0.01,1,0.1"}) == patch(**{kind: "1"}) != patch(**{kind: "0.1"})
    with pytest.raises(InputError, match="-domain is missing: without contact"):
        patch(**{f"{kind}_path": "0,0"})


@pytest.mark.parametrize("own", ["", "class"])
def test_hardness_is_an_option_of_any_problem(tmp_path, monkeypatch, own):
    monkeypatch.chdir(tmp_path)
    hardness = np.full((24, 24), 700.0)
    hardness[:12] = np.inf
    np.save("hardness.npy", hardness)
    shape = "lambda x, y: x**2 + y**2"
    if own:
        shape = "type('Bowl', (Problem,), {'shape_on': lambda self, g, r: (g.x() + g.y(r)[:, None]) ** 2})"
    (tmp_path / "mine.py").write_text(f"from app.problems.problem import Problem\nbowl = {shape}\n")
    patch = {"grid": "24", "domain": "-1,1,-1,1", "contact_modulus": 100}
    for kind in {"problem": "cone", "cone_angle": 5}, {"problem": "python", "problem_type": "mine.py:bowl"}:
        assert problem_from(**kind, **patch).hardness is None
        assert problem_from(**kind, **patch, hardness=700).hardness == 700
        assert problem_from(**kind, **patch, hardness="inf").hardness is None
        of_file = problem_from(**kind, **patch, hardness_file="hardness.npy")
        np.testing.assert_array_equal(of_file.hardness, hardness)
        assert not of_file.refinable


def test_surface_compliance_of_a_file(tmp_path):
    file, compliance = tmp_path / "compliance.npy", np.zeros((24, 24))
    cone = {"problem": "cone", "cone_angle": 5, "grid": "24", "domain": "-1,1,-1,1", "contact_modulus": 1}
    for first in 2.0, 0.0, -1.0:
        compliance[0, 0] = first
        np.save(file, compliance)
        if first >= 0:
            problem = problem_from(**cone, surface_compliance_file=str(file))
            np.testing.assert_array_equal(problem.surface_compliance, compliance if first else 0.0)
            assert problem.refinable == (first == 0)
    with pytest.raises(InputError, match="compliance.npy: -1 in row 0, column 0; must be 0, or"):
        problem_from(**cone, surface_compliance_file=str(file))


@pytest.mark.parametrize("wrong", [0, -1, np.nan])
def test_wrong_hardness_of_a_file_is_refused_with_its_place(tmp_path, wrong):
    hardness = np.ones((24, 24))
    hardness[3, 4] = wrong
    np.save(tmp_path / "hardness.npy", hardness)
    cone = {"problem": "cone", "cone_angle": 5, "grid": "24", "domain": "-1,1,-1,1", "contact_modulus": 1}
    with pytest.raises(InputError, match="hardness.npy: .* in row 3, column 4; must be above 0 N/mm2"):
        problem_from(**cone, hardness_file=str(tmp_path / "hardness.npy"))


@pytest.mark.parametrize("domain", [{}, {"domain": "auto"}])
def test_wrong_hardness_is_refused_by_its_own_name_on_fitted_patches(domain):
    sphere = {"problem": "sphere", "sphere_radius": 10, "grid": "24", "contact_modulus": 100, "load": 1}
    with pytest.raises(InputError, match="^-hardness 5MPa: must be a positive number"):
        problem_from(**sphere, **domain, hardness="5MPa")
