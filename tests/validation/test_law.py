"""Contact laws: between their points they are solves, and everywhere they increase."""

import csv

import h5py
import numpy as np
import pytest
from scipy.io import loadmat

from app import ContactProblem, ContactSolver, Grid, InputError, Material, SelfAffineSurface, Sphere
from app.api.law import ContactLaw

pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")
STEEL = Material.isotropic(210e3, 0.3)
PATCH = Grid.from_domain(64, 64, (-0.25, 0.25, -0.25, 0.25))
BALL = ContactProblem(PATCH, STEEL, Sphere(10))


def rough(n=128, **more):
    surface = SelfAffineSurface(0.8, 0.25, 0.03, (1, 1), seed=1, rms_slope=0.1)
    grid = Grid.from_domain(n, n, (0, 1, 0, 1))
    return ContactProblem(grid, STEEL, surfaces=[surface], periodic=True, **more)


@pytest.fixture(scope="module")
def law():
    with ContactSolver(rough()) as solver:
        return solver.law(mean_pressure=(30, 3000), flow=True, friction=0.3, tangential_share=0.5)


def test_law_of_a_self_affine_surface_is_the_solution_between_its_points(law):
    assert law.error <= 1e-3
    rng = np.random.default_rng(3)
    with ContactSolver(rough()) as solver:
        for pressure in np.exp(rng.uniform(*np.log([30, 3000]), 12)):
            solution = solver.solve(mean_pressure=pressure)
            at = law.at(approach=solution.approach)
            assert at["load"] == pytest.approx(solution.load, rel=1e-3)
            assert at["mean_pressure"] == pytest.approx(pressure, rel=1e-3)
            assert at["stiffness"] == pytest.approx(solver.stiffness(solution), rel=0.03)
            same = law.at(load=solution.load)
            assert same["indentation"] == pytest.approx(solution.indentation, rel=1e-3)
            assert same["mean_gap"] == pytest.approx(solution.mean_gap, rel=1e-3)
            aperture = solution.flow().hydraulic_aperture_x
            assert same["hydraulic_aperture_x"] == pytest.approx(aperture, rel=0.02)
            slip = solver.slip(load=solution.load, friction=0.3, tangential_load=0.15 * solution.load)
            assert same["dissipated_energy"] == pytest.approx(slip.dissipated_energy, rel=0.02)
            assert same["tangential_displacement"] == pytest.approx(slip.tangential_displacement, rel=0.02)


def test_law_passes_through_its_points_and_increases(law):
    table = law.table
    for kind in ("load", "approach", "indentation"):
        at = law.at(**{kind: table[kind]})
        for name in at:
            np.testing.assert_allclose(at[name], table[name], rtol=1e-9, atol=1e-20)
    assert table.keys() - at.keys() == {"converged", "percolates_x", "percolates_y"}  # no numbers
    approach = np.linspace(table["approach"][0] - 1e-4, table["approach"][-1] * 1.1, 5000)
    at = law.at(approach=approach)
    assert (np.diff(at["load"]) >= 0).all() and (np.diff(at["load"])[at["load"][1:] > 0] > 0).all()
    # The stiffness is the derivative of the load, as Newton's method needs it.
    step = 1e-7 * table["indentation"]
    sides = [law.at(approach=table["approach"] + sign * step)["load"] for sign in (-1, 1)]
    np.testing.assert_allclose((sides[1] - sides[0]) / (2 * step), table["stiffness"], rtol=1e-4)


def test_law_of_a_ball_is_hertz_beyond_its_points_too():
    with ContactSolver(BALL) as solver:
        law = solver.law(load=(5, 50), tolerance=0.01)
    indentation = np.array([1e-5, 3e-4, 1e-3, 3e-3])
    hertz = 4 / 3 * STEEL.contact_modulus * np.sqrt(10) * indentation**1.5
    np.testing.assert_allclose(law.at(indentation=indentation)["load"], hertz, rtol=0.05)
    before = law.at(approach=[-1.0, 0.0])
    assert (before["load"] == 0).all() and (before["stiffness"] == 0).all()
    assert np.isnan(before["max_pressure"]).all()


def test_tangential_stiffness_is_that_of_mindlin():
    with ContactSolver(BALL) as solver:
        table = solver.law(load=(5, 50), tolerance=0.1).table
    np.testing.assert_allclose(table["tangential_stiffness"] / table["stiffness"], 2 * (1 - 0.3) / (2 - 0.3))


def test_cubic_is_monotone_through_any_slopes():
    """Fritsch and Carlson: slopes far above the chord's are reduced."""
    rows = [
        {"load": load, "approach": gap, "indentation": gap, "stiffness": 1e-3 * load / gap}
        for load, gap in ((1.0, 1.0), (2.0, 1.001), (4.0, 3.0), (8.0, 3.001))
    ]
    found = ContactLaw(rows).at(load=np.geomspace(1, 8, 1000))
    assert (np.diff(found["indentation"]) >= 0).all()
    np.testing.assert_allclose(ContactLaw(rows).at(load=[1, 2, 4, 8])["indentation"], [1, 1.001, 3, 3.001])


def test_tolerance_adds_points_and_a_limit_on_them_is_reported():
    with ContactSolver(BALL) as solver:
        coarse, fine = (solver.law(load=(5, 50), tolerance=tolerance) for tolerance in (0.1, 5e-4))
        assert coarse.error <= 0.1 and fine.error <= 5e-4
        assert set(coarse.table["load"]) < set(fine.table["load"])
        with pytest.warns(RuntimeWarning, match="9 loads do not suffice"):
            limited = solver.law(load=(5, 50), tolerance=1e-7, max_points=9)
        assert limited.error > 1e-7


@pytest.mark.mpi(2)
def test_law_is_the_same_on_all_ranks(comm, tmp_path):
    with ContactSolver(BALL, comm=comm) as solver:
        law = solver.law(load=(5, 50), tolerance=0.01, friction=0.3, tangential_share=1)
    tables = comm.allgather(law.table)
    for name, column in law.table.items():
        np.testing.assert_array_equal(column, tables[0][name])
    np.testing.assert_array_equal(law.table["stick_area"], 0)


def test_files_have_the_table(law, tmp_path):
    for suffix in ("csv", "h5", "mat"):
        law.save(tmp_path / f"law.{suffix}")
    with (tmp_path / "law.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    mat = loadmat(tmp_path / "law.mat")
    with h5py.File(tmp_path / "law.h5") as file:
        for name in ("load", "approach", "stiffness", "tangential_stiffness", "dissipated_energy"):
            column = law.table[name]
            assert [float(row[name]) for row in rows] == column.tolist()
            np.testing.assert_array_equal(file[name][:], column)
            np.testing.assert_array_equal(mat[name], column[:, None])
    assert law.to_dataframe().attrs["units"]["stiffness"] == "N/mm"
    with pytest.raises(InputError, match="must end in"):
        law.save(tmp_path / "law.doc")


@pytest.mark.parametrize(
    ("problem", "given", "message"),
    [
        (BALL, {"load": 5}, r"two numbers or more, the smallest first, the largest last \[N\]"),
        (BALL, {"load": (50, 5)}, "must be positive and increase"),
        (BALL, {"load": (0, 5)}, "must be positive and increase"),
        (BALL, {"approach": (0.001, 0.002)}, "give a range of load or mean_pressure"),
        (BALL, {}, "exactly one of"),
        (BALL, {"load": (5, 50), "tolerance": 0}, "tolerance 0: must be a positive number"),
        (BALL, {"load": (5, 50), "friction": 0.3}, "tangential_share None: must be"),
        (
            BALL,
            {"load": (5, 50), "friction": 0.3, "tangential_share": 1.5},
            "tangential_share 1.5: must be at most 1",
        ),
        (BALL, {"load": (5, 50), "max_points": 2}, "max_points 2: must be a whole number from 3"),
        (BALL, {"load": (5, 50), "max_points": 7.5}, "max_points 7.5: must be a whole number from 3"),
        (rough(80), {"mean_pressure": (10, 1e6)}, "full contact"),
        (rough(80, background_pressure=1), {"mean_pressure": (10, 100)}, "not with a background pressure"),
        (
            rough(80, surface_compliance=1e-6),
            {"load": (1, 2), "friction": 1, "tangential_share": 1},
            "surface compl",
        ),
    ],
)
def test_what_is_not_allowed_is_refused(problem, given, message):
    with ContactSolver(problem) as solver, pytest.raises(InputError, match=message):
        solver.law(**given)


def test_a_law_has_no_numbers_where_it_is_not_defined(law):
    numbers = law.at(load=np.ma.array([-1.0, np.nan, 5.0, 5.0], mask=[False, False, True, False]))
    assert all(np.isnan(column[:3]).all() for column in numbers.values()) and numbers["load"][3] == 5.0
    for wrong in (None, "5", True, 5j):
        with pytest.raises(InputError, match="law: load: must be a number"):
            law.at(load=wrong)


def test_bodies_that_are_not_similar_have_no_tangential_stiffness():
    rubber = ContactProblem(PATCH, Material.pair((10, 210e3), (0.4, 0.3)), Sphere(10))
    with ContactSolver(rubber) as solver:
        table = solver.law(load=(1e-3, 1e-2), tolerance=0.1).table
        assert "tangential_stiffness" not in table and "stiffness" in table
        with pytest.raises(InputError, match="similar"):
            solver.law(load=(1e-3, 1e-2), friction=0.3, tangential_share=0.5)
