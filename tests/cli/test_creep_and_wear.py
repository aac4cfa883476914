"""Bodies that creep or wear, on the command line."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, Sphere, read_result

PATCH = "-problem", "sphere", "-sphere_radius", 10, "-grid", 16, "-domain", "-2,2,-2,2"
RUBBER = (
    "-young",
    "10,inf",
    "-poisson",
    "0.5,0.3",
    "-relaxation_times",
    "0.1,10",
    "-relaxation_moduli",
    "0.3,0.4",
)
STEEL = "-contact_modulus", 115e3
CREEP = *PATCH, *RUBBER, "-load", 1, "-creep_times", "0,0.1:10:2:log"
WEAR = (
    *PATCH,
    *STEEL,
    "-wear_coefficient",
    1e-6,
    "-sliding_distance",
    "4 m",
    "-wear_steps",
    3,
    "-approach",
    0.01,
)


@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.ranks(2))])
def test_creep_on_several_ranks(cli, ranks, tmp_path):
    done = cli(*CREEP, "-output", tmp_path / "c.h5", ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert read_result(tmp_path / "c.h5").path["time"].tolist() == [0, 0.1, 10]


def test_creep_is_that_of_python(cli_here, tmp_path):
    loads = [0, 1, 0.5]
    line = *PATCH, *RUBBER, "-load_path", "0,1,0.5", "-creep_times", "0,1,5", "-output", tmp_path / "c.h5"
    done = cli_here(*line, "-path_fields")
    assert done.returncode == 0 and "step 2 of 3: time 1 s, load 1 N" in done.stdout
    rubber = Material.pair((10, np.inf), (0.5, 0.3)).viscoelastic((0.1, 10), (0.3, 0.4))
    grid = Grid.from_domain(16, 16, (-2, 2, -2, 2))
    with ContactSolver(ContactProblem(grid, rubber, Sphere(10))) as solver:
        *_, last = path = list(solver.creep([0, 1, 5], load=loads))
    read = read_result(tmp_path / "c.h5")
    np.testing.assert_array_equal(read.pressure, last.pressure)
    assert read.time == 5 and len(path) == 3
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "c.csv", "c.h5", "c_0001.h5", "c_0002.h5", "c_0003.h5"
    ]  # fmt: skip


def test_wear_is_that_of_python(cli_here, tmp_path):
    done = cli_here(*WEAR, "-output", tmp_path / "w.h5")
    assert done.returncode == 0 and "sliding distance 4000 mm" in done.stdout
    grid = Grid.from_domain(16, 16, (-2, 2, -2, 2))
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(115e3), Sphere(10))) as solver:
        *_, last = solver.wear(1e-6, 4000, 3, approach=0.01)
    np.testing.assert_array_equal(read_result(tmp_path / "w.h5").worn_depth, last.worn_depth)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ((*CREEP, "-resume", "-output", "c.h5"), "-resume: not for bodies that creep or wear"),
        ((*CREEP, "-flow"), "-flow: not for bodies that creep or wear"),
        ((*CREEP, "-load_centre", "0,0"), "-load_centre: not for bodies that creep or wear"),
        ((*CREEP, "-refine_until", 0.1), "needs a single loading"),
        ((*CREEP, "-hardness", 5), "not with a hardness"),
        ((*PATCH, *RUBBER, "-load_path", "1,2", "-creep_times", "0,1,2"), "2 values of load for 3 times"),
        ((*CREEP, "-wear_coefficient", 1e-9), "at most one of them is allowed"),
        ((*PATCH, *STEEL, "-load", 1, "-creep_times", "0,1"), "-relaxation_times"),
        ((*PATCH, *RUBBER, "-load", 1), "-relaxation_moduli, -relaxation_times: have no effect here"),
        ((*PATCH, *STEEL, "-load", 1, "-wear_coefficient", 1e-9), "-sliding_distance"),
        ((*PATCH, *STEEL, "-load", 1, "-wear_steps", 3), "-wear_steps: has no effect here"),
        ((*CREEP[:-1], "1,0"), "must increase"),
    ],
)
def test_wrong_histories_are_refused(cli_here, line, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = cli_here(*line)
    assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
