"""Gaps from files of every kind, and files that hold none."""

import re

import h5py
import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
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


def test_dataset_by_name_integers_and_byte_order(tmp_path):
    values = np.arange(12).reshape(3, 4)
    with h5py.File(tmp_path / "many.h5", "w") as file:
        file["a/b"], file["c"] = values.astype(">f4"), np.zeros((3, 4))
    np.save(tmp_path / "big_endian.npy", values.astype(">i2"))
    np.save(tmp_path / "fortran.npy", np.asfortranarray(values, float))
    (tmp_path / "odd.txt").write_text("# a comment\n0 1\t2  3\n\n4\t5 6 7\n8 9 10 11e0\n")
    np.savez(tmp_path / "many.npz", a=values, b=np.zeros((3, 4)))
    for name in ("many.h5:/a/b", "many.npz:/a", "big_endian.npy", "fortran.npy", "odd.txt"):
        gap = GapFile(str(tmp_path / name))
        assert gap.shape == (3, 4)
        rows = gap.rows(slice(1, 3))
        assert rows.dtype == np.float64
        np.testing.assert_array_equal(rows, values[1:])


def save_archive(path):
    np.savez(path.with_suffix(".npz"), a=np.ones((8, 8)))
    path.with_suffix(".npz").rename(path)


def save_archives(**arrays):
    return lambda path: np.savez(path, **arrays)


def save_hdf5(**datasets):
    def save(path):
        with h5py.File(path, "w") as file:
            for name, values in datasets.items():
                file[name] = values

    return save


def save_part(save, share):
    def save_and_cut(path):
        save(path)
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return save_and_cut


def save_array(values):
    return lambda path: np.save(path, values, allow_pickle=True)


def save_bytes(content):
    return lambda path: path.write_bytes(content)


def save_header(text):
    """What numpy reads as Python."""

    def save(path):
        np.save(path, SQUARE)
        start = path.read_bytes()[:10]
        path.write_bytes(start + text.ljust(117).encode() + b"\n" + SQUARE.tobytes())

    return save


def save_times(of_an_attribute):
    """A dataset, or an attribute of one, of a type that numpy has not."""

    def save(path):
        with h5py.File(path, "w") as file:
            dataset = file.create_dataset("a", data=SQUARE)
            if of_an_attribute:
                h5py.h5a.create(dataset.id, b"when", h5py.h5t.UNIX_D32LE, h5py.h5s.create(h5py.h5s.SCALAR))
            else:
                h5py.h5d.create(file.id, b"b", h5py.h5t.UNIX_D32LE, dataset.id.get_space())

    return save


SQUARE = np.ones((8, 8))


@pytest.mark.parametrize(
    ("name", "save", "message"),
    [
        ("gap.npy", lambda path: path.mkdir(), "not a file"),
        ("gap.npy", save_array(np.ones(8)), "shape (8,)"),
        ("gap.npy", save_array(np.float64(8)), "shape ()"),
        ("gap.npy", save_array(np.ones((0, 8))), "shape (0, 8)"),
        ("gap.npy", save_array(SQUARE.astype(complex)), "complex128"),
        ("gap.npy", save_array(SQUARE.astype(bool)), "bool"),
        ("gap.npy", save_array(np.array([[1, None]], object)), "objects"),
        ("gap.npy", save_array(np.array([["a", "b"]])), "U1"),
        ("gap.npy", save_part(save_array(SQUARE), 0.6), "cannot be read: it ends before"),
        ("gap.npy", save_part(save_array(SQUARE), 0.05), "cannot be read"),
        ("gap.npy", save_header("{'descr': ("), "cannot be read"),
        ("gap.npy", save_header("{'descr': 1 2}"), "cannot be read"),
        ("gap.npy", save_header("  {}\n {}"), "cannot be read"),
        ("gap.npy", save_bytes(b""), "cannot be read"),
        ("gap.npy", save_archive, "archive"),
        ("gap.npz", save_archives(a=SQUARE, b=SQUARE), "FILE:/DATASET; there are: a, b"),
        ("gap.npz", save_archives(a=np.ones(8)), "there are: none"),
        ("gap.npz:/c", save_archives(a=SQUARE), "no array c"),
        ("gap.npz:/b", save_archives(a=SQUARE, b=np.ones(8)), "shape (8,)"),
        ("gap.npz", save_part(save_archives(a=SQUARE), 0.5), "no .npz file"),
        ("gap.npz", save_bytes(b"0.1 0.2"), "no .npz file"),
        ("gap.h5", save_part(save_hdf5(gap=SQUARE), 0.5), "cannot be read"),
        ("gap.h5", save_bytes(b"not HDF5"), "cannot be read"),
        ("gap.h5", save_hdf5(a=SQUARE, b=SQUARE), "FILE:/DATASET; there are: a, b"),
        ("gap.h5", save_hdf5(a=np.ones(8)), "there are: none"),
        ("gap.h5:/c", save_hdf5(a=SQUARE), "no dataset /c"),
        ("gap.h5:/g", save_hdf5(**{"g/a": SQUARE}), "no dataset /g"),
        ("gap.h5:/a", save_hdf5(a=h5py.Empty("f8")), "shape None"),
        ("gap.h5:/a", save_hdf5(a=SQUARE.astype(complex)), "complex128"),
        ("gap.h5:/a", save_hdf5(a="text"), "object"),
        ("gap.h5:/a", save_times(of_an_attribute=True), "cannot be read: No NumPy equivalent"),
        ("gap.h5:/b", save_times(of_an_attribute=False), "cannot be read: No NumPy equivalent"),
        ("gap.npy", save_bytes(b"0.1 0.2"), "no .npy file"),
        ("gap.h5:a", save_hdf5(a=SQUARE), "FILE:/DATASET"),
        ("gap.txt", save_bytes(b""), "empty"),
        ("gap.txt", save_bytes(b"# nothing\n"), "empty"),
        ("gap.txt", save_bytes(b"1 2 3\n4 5\n"), "line 2 has 2 entries, line 1 has 3"),
        ("gap.txt", save_bytes(b"1 2\n3 four\n"), "four"),
        ("gap.txt", save_bytes(b"1 2\n3 4+5j\n"), "4+5j"),
        ("gap.txt", save_bytes(bytes(range(128, 256))), "cannot be read"),
    ],
)
def test_file_that_is_no_gap(name, save, message, tmp_path):
    path = str(tmp_path / name)
    save(tmp_path / name.partition(":")[0])
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        GapFile(path)
    assert str(refusal.value).startswith(f"gap file {tmp_path}/gap.")


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
        with pytest.raises(ValueError, match=f"says {unit}; needed: mm"):
            GapFile(tmp_path / "gap.txt")


def test_gap_of_another_shape_than_the_grid(tmp_path):
    np.save(tmp_path / "gap.npy", np.ones((8, 9)))
    with pytest.raises(ValueError, match=re.escape("-grid 8,9 needs (ny, nx) = (9, 8)")):
        ContactProblem(Grid(8, 9, 1.0, 1.0), Material.combined(1.0, 0.3), GapFile(tmp_path / "gap.npy"))


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinite_gap(value, tmp_path):
    values = SQUARE.copy()
    values[5, 2], values[6, 0] = value, np.nan
    np.save(tmp_path / "gap.npy", values)
    gap = GapFile(str(tmp_path / "gap.npy"))
    with pytest.raises(ValueError, match="row 5, column 2"):
        gap.check(slice(4, 8))
    for rows in (slice(0, 4), slice(6, 8)):
        gap.check(rows)
