"""Gaps from files."""

import re

import h5py
import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.gap_file import GapFile


def write_gap(path, shape):
    if path.suffix == ".npy":
        np.save(path, shape)
    elif path.suffix == ".npz":
        np.savez_compressed(path, shape=shape, x=shape[0])
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["measured/gap"] = shape
    else:
        np.savetxt(path, shape, fmt="%.17g", delimiter=", " if path.suffix == ".csv" else " ")


def gap_file(path, n):
    problem = hertz(n)
    return ContactProblem(problem.grid, problem.material, GapFile(path))


@pytest.mark.parametrize("name", ["gap.npy", "gap.npz", "gap.h5", "gap.txt", "gap.csv"])
def test_gap_from_a_file_is_the_same_problem(name, tmp_path):
    problem = hertz(32)
    write_gap(tmp_path / name, problem.shape_on(problem.grid))
    solution = solve(gap_file(tmp_path / name, 32), APPROACH)
    np.testing.assert_array_equal(solution.pressure, solve(problem, APPROACH).pressure)


SQUARE = np.ones((8, 8))


X = np.arange(12) / 3


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (np.stack([X, np.cos(X)], -1), "12 lines of 2 numbers are x, z of a line scan"),
        (np.stack([X**2, X], -1), "12 lines of 2 numbers are x, z of a line scan"),
        (np.stack([X[:5] ** 2, np.cos(X[:5])], -1), "5 lines of 2 numbers are x, z of a line scan"),
        (np.stack([X, np.cos(X)]), "2 lines of 12 numbers are x, z of a line scan"),
        (np.zeros((10, 3)), "10 lines of 3 numbers are points x, y, z"),
    ],
)
def test_lists_of_points_are_no_gap(tmp_path, table, message):
    """Equal steps or not; as .npy they are what they are."""
    np.savetxt(tmp_path / "gap.txt", table)
    with pytest.raises(ValueError, match=message):
        GapFile(tmp_path / "gap.txt")
    np.save(tmp_path / "gap.npy", table)
    assert GapFile(tmp_path / "gap.npy").shape == table.shape


def test_two_equal_rows_are_a_gap(tmp_path):
    np.savetxt(tmp_path / "gap.txt", [X, X])
    assert GapFile(tmp_path / "gap.txt").shape == (2, 12)


@pytest.mark.parametrize(("unit", "read"), [("mm", True), ("m", False), ("V", False)])
def test_a_gap_is_in_mm(tmp_path, unit, read):
    np.savetxt(tmp_path / "gap.txt", SQUARE, header=f"Value units: {unit}")
    if read:
        assert GapFile(tmp_path / "gap.txt").shape == SQUARE.shape
    else:
        with pytest.raises(ValueError, match=f"says {unit}; must be mm"):
            GapFile(tmp_path / "gap.txt")


def test_a_gap_of_another_shape_is_refused(tmp_path):
    np.save(tmp_path / "gap.npy", np.ones((8, 9)))
    with pytest.raises(ValueError, match=re.escape("-grid 8,9 needs (ny, nx) = (9, 8)")):
        ContactProblem(Grid(8, 9, 1.0, 1.0), Material.combined(1.0, 0.3), GapFile(tmp_path / "gap.npy"))


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinite_gap_is_refused_in_its_rows(value, tmp_path):
    values = SQUARE.copy()
    values[5, 2], values[6, 0] = value, np.nan
    np.save(tmp_path / "gap.npy", values)
    gap = GapFile(str(tmp_path / "gap.npy"))
    with pytest.raises(ValueError, match="row 5, column 2"):
        gap.check(slice(4, 8))
    for rows in (slice(0, 4), slice(6, 8)):
        gap.check(rows)


def test_a_gap_has_no_marks(tmp_path):
    (tmp_path / "gap.txt").write_text("1 ***\n2 3\n")
    with pytest.raises(ValueError, match=r"line 1: '\*\*\*' is no number"):
        GapFile(tmp_path / "gap.txt")
