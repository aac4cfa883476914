"""Gaps and hardness from files."""

import re

import numpy as np
import pytest

from app import ContactProblem, Grid, Material
from app.problems.gap_file import GapFile, HardnessFile

SQUARE = np.ones((8, 8))


@pytest.mark.parametrize("kind", ["x, z of a line scan", "points x, y, z"])
def test_a_text_with_a_list_is_no_gap(tmp_path, kind):
    table = np.zeros((12, kind.count(",") + 1))
    np.savetxt(tmp_path / "gap.txt", table)
    with pytest.raises(ValueError, match=f"12 lines of {table.shape[1]} numbers are {kind}, not a map"):
        GapFile(tmp_path / "gap.txt")
    np.save(tmp_path / "gap.npy", table)
    assert GapFile(tmp_path / "gap.npy").shape == table.shape


@pytest.mark.parametrize("unit", ["m", "V"])
def test_a_gap_is_in_mm(tmp_path, unit):
    np.savetxt(tmp_path / "mm.txt", SQUARE, header="Value units: mm")
    assert GapFile(tmp_path / "mm.txt").shape == SQUARE.shape
    np.savetxt(tmp_path / "gap.txt", SQUARE, header=f"Value units: {unit}")
    with pytest.raises(ValueError, match=f"says {unit}; must be mm"):
        GapFile(tmp_path / "gap.txt")


def test_a_gap_of_another_shape_is_refused(tmp_path):
    np.save(tmp_path / "gap.npy", np.ones((8, 9)))
    with pytest.raises(ValueError, match=re.escape("the grid needs (ny, nx) = (9, 8)")):
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


def test_marks_of_missing_points_are_no_gap(tmp_path):
    (tmp_path / "gap.txt").write_text("1 ***\n2 3\n")
    with pytest.raises(ValueError, match=r"line 1: '\*\*\*' is no number"):
        GapFile(tmp_path / "gap.txt")


def test_sparse_and_huge_text(sparse, small_machine):
    with pytest.raises(ValueError, match=r"needs 477 GiB of memory; 1 GiB are free"):
        GapFile(sparse("gap.txt", 40_000))


@pytest.mark.parametrize("link", ["/gap", "/other"])
def test_dataset_linked_to_itself(tmp_path, link):
    import h5py

    with h5py.File(tmp_path / "gap.h5", "w") as file:
        file["gap"] = h5py.SoftLink(link)
        file["other"] = h5py.SoftLink("/gap")
    with pytest.raises(ValueError, match="cannot be read: .*too many links"):
        GapFile(f"{tmp_path}/gap.h5:/gap")


@pytest.mark.parametrize("file", ["hardness.npy", "hardness.txt"])
def test_hardness_of_a_file_may_be_infinite(tmp_path, file):
    hardness = np.full((8, 9), 5.0)
    hardness[2:4] = np.inf
    (np.save if file.endswith("npy") else np.savetxt)(tmp_path / file, hardness)
    grid = Grid(9, 8, 1.0, 1.0)
    np.testing.assert_array_equal(HardnessFile(tmp_path / file).values_on(grid), hardness)
    with pytest.raises(ValueError, match=r"^hardness file .* has shape \(8, 9\); the grid needs"):
        HardnessFile(tmp_path / file).values_on(Grid(8, 9, 1.0, 1.0))
