"""The command app.law."""

import csv
import re
import sys

import h5py
import numpy as np
import pytest
from processes import run
from scipy.io import loadmat

from app import ContactProblem, ContactSolver, Grid, Material, Paraboloid
from app.cli.law import main

HERTZ = "-options_file", "hertz", "-grid", 48
RANGE = "-load_path", "1000,30000"


def law(*words, **how):
    return run("-m", "app.law", *words, **how)


def read_csv(path):
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.ranks(1, 2)
def test_table_is_that_of_python(tmp_path, ranks):
    file = tmp_path / "law.csv"
    words = "-tolerance", 0.02, "-friction", 0.2, "-tangential_share", 0.5, "-o", file
    done = law(*HERTZ, *RANGE, *words, ranks=ranks)
    assert done.returncode == 0, done.stderr
    table = read_csv(file)
    problem = ContactProblem(
        Grid.from_domain(48, 48, (-10, 10, -6, 6)), Material.combined(82000, 0.28), Paraboloid(300, 163)
    )
    with ContactSolver(problem) as solver:
        same = solver.law(load=(1000, 30000), tolerance=0.02, friction=0.2, tangential_share=0.5).table
    assert table.keys() == same.keys()
    assert np.array(table["load"], float) == pytest.approx(same["load"], rel=1e-9)
    for name in ("approach", "stiffness", "tangential_stiffness", "dissipated_energy", "mean_gap"):
        assert np.array(table[name], float) == pytest.approx(same[name], rel=1e-3), name
    assert "error of the interpolated load" in done.stdout and f"table in {file}" in done.stdout


def test_files_of_a_law_with_flow(tmp_path):
    words = (
        *HERTZ[:-1],
        16,
        "-load_path",
        "1000:3000:3",
        "-tolerance",
        0.5,
        "-flow",
        "-flow_ksp_type",
        "fcg",
    )
    for suffix in ("csv", "h5", "mat"):
        done = law(*words, "-output", tmp_path / f"law.{suffix}")
        assert done.returncode == 0, done.stderr
    tables = read_csv(tmp_path / "law.csv"), loadmat(tmp_path / "law.mat", squeeze_me=True)
    with h5py.File(tmp_path / "law.h5") as file:
        for name in ("load", "stiffness", "hydraulic_aperture_x"):
            for table in tables:
                np.testing.assert_array_equal(np.array(table[name], float), file[name][:])
        assert set(file["load"][:]) >= {1000, 2000, 3000}  # these come first


def test_tolerance_that_is_not_reached_is_said_and_the_table_is_written(tmp_path):
    file = tmp_path / "law.csv"
    done = law(*HERTZ, *RANGE, "-tolerance", 1e-9, "-max_points", 5, "-o", file)
    assert done.returncode == 3
    assert "warning: law: 5 loads do not suffice" in done.stderr and "-max_points" in done.stderr
    assert len(read_csv(file)["load"]) == 5


def test_notes_of_the_solutions_are_merged(tmp_path):
    words = "-options_file", "rough", "-grid", 64, "-mean_pressure_path", "500,5000", "-tolerance", 0.5
    done = law(*words, "-o", tmp_path / "law.csv")
    assert done.returncode == 0
    assert re.search(
        "^warning: steps 1 to [0-9]+: the maximum pressure is [0-9]+ to [0-9]+ N/mm2", done.stderr
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "-approach: must be -load_path or -mean_pressure_path, with two numbers or more"),
        (("-load", 5), "-load: must be -load_path"),
        (("-load_path", 1000), "-load_path: must be -load_path or -mean_pressure_path, with two numbers"),
        (("-load_path", "5,1"), "law: load 5 to 1: must be positive and increase"),
        ((*RANGE, "-load", 5), "both -load and -load_path are given on the command line"),
        ((*RANGE, "-friction", 0.1), "-friction and -tangential_share: only together"),
        ((*RANGE, "-tangential_share", 2), "-tangential_share 2: must be above 0, at most 1"),
        ((*RANGE, "-tolerance", 0), "-tolerance 0: must be a positive number"),
        ((*RANGE, "-tolerence", 1), "unknown option: -tolerence (did you mean -tolerance?)"),
        ((*RANGE, "-resume"), "-resume: has no effect here"),
        ((*RANGE, "-tilt", "0,0"), "-tilt: has no effect here"),
        ((*RANGE, "-ksp_bogus", 1), "unknown or unused option: -ksp_bogus"),
        ((*RANGE, "-flow_ksp_rtol", 1), "-flow_ksp_rtol: needs -flow"),
        ((*RANGE, "-output", "law.doc"), "law law.doc: the name must end in .csv or .h5"),
        ((*RANGE, "-output", "gone/law.csv"), "gone does not exist"),
        (("-load_path", "1:9:9", "-max_points", 3), "max_points 3: must be at least 9"),
        ((*RANGE, "-hardness", 5, "-friction", 0.1, "-tangential_share", 1), "hardness"),
    ],
)
def test_what_is_not_allowed_is_refused(cli_here, tmp_path, words, message):
    done = cli_here(*HERTZ, *words, cwd=tmp_path, main=main)
    assert done.returncode == 2 and not done.stdout and not list(tmp_path.iterdir())
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1 and message in done.stderr


def test_help_needs_neither_mpi_nor_petsc():
    program = """
import runpy, sys
sys.argv = ["law", "--help"]
try:
    runpy.run_module("app.law", run_name="__main__")
except SystemExit as end:
    assert end.code == 0
loaded = {"mpi4py", "petsc4py", "numba", "h5py"} & sys.modules.keys()
assert not loaded, loaded
"""
    done = run("-c", program, program=sys.executable)
    assert done.returncode == 0, done.stderr
    assert "-tangential_share" in done.stdout and "usage: python -m app.law" in done.stdout
