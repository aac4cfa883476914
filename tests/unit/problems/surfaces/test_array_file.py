"""Arrays in files: datasets, compressed texts, encodings, and broken files."""

import gzip
import re

import h5py
import numpy as np
import pytest

from app import InputError, read_surface
from app.problems.gap_file import GapFile

ROWS = "0.5 1.5 2\n3 4 5.25\n"


@pytest.mark.parametrize("name", ["s.txt.gz", "s.csv.GZ", "s.gz"])
def test_compressed_texts_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(ROWS.encode()))
    expected = [[0.5, 1.5, 2], [3, 4, 5.25]]
    np.testing.assert_array_equal(read_surface(tmp_path / name, "mm").heights(), expected)
    np.testing.assert_array_equal(GapFile(tmp_path / name).rows(), expected)


def test_a_compressed_text_is_no_larger_than_the_memory(tmp_path, monkeypatch):
    """A megabyte may unpack to a thousand."""
    (tmp_path / "s.txt.gz").write_bytes(gzip.compress(b"0 " * 10**6))

    def check_fits(size, what):
        if size > 10**7:
            raise MemoryError(f"{what} needs too much")

    monkeypatch.setattr("app.problems.surfaces.array_file.check_fits", check_fits)
    with pytest.raises(InputError, match="text, where .npy or .h5 take little needs too much"):
        read_surface(tmp_path / "s.txt.gz", "mm")


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_words_at_the_head_say_how_many_lines_to_skip(tmp_path, coding):
    """A microscope exports a name, a unit, then numbers."""
    path = tmp_path / "scan.csv"
    path.write_text("Höhe;Plane 1\n[µm]\n0,5;1,5\n***;2\n", encoding=coding)
    message = r"line 1: 'Höhe' is no number; skip the 2 lines at the head by skip=2 \(-surface_skip 2, "
    with pytest.raises(InputError, match=message):
        read_surface(path, "um")
    surface = read_surface(path, "um", skip=2)
    np.testing.assert_allclose(surface.heights(), [[5e-4, 1.5e-3], [np.nan, 2e-3]], rtol=1e-15)
    assert surface.missing_points == 1


def test_lines_are_skipped_of_texts_only(tmp_path):
    np.save(tmp_path / "s.npy", np.ones((2, 3)))
    with pytest.raises(InputError, match="2 lines to skip: allowed of text"):
        read_surface(tmp_path / "s.npy", "um", skip=2)


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
    """Numpy reads the header of an array as Python."""

    def save(path):
        np.save(path, SQUARE)
        start = path.read_bytes()[:10]
        path.write_bytes(start + text.ljust(117).encode() + b"\n" + SQUARE.tobytes())

    return save


def save_times(of_an_attribute):
    """The type of a dataset, or an attribute of one, is unknown to numpy."""

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
        ("gap.npy", save_array(SQUARE.astype(complex)), "complex128"),
        ("gap.npy", save_array(np.array([[1, None]], object)), "objects"),
        ("gap.npy", save_array(np.array([["a", "b"]])), "U1"),
        ("gap.npy", save_part(save_array(SQUARE), 0.6), "cannot be read: it ends before"),
        ("gap.npy", save_header("{'descr': ("), "cannot be read"),
        ("gap.npy", save_bytes(b""), "cannot be read"),
        ("gap.npy", save_archive, "archive"),
        ("gap.npz", save_archives(a=SQUARE, b=SQUARE), "FILE:/DATASET; there are a, b"),
        ("gap.npz", save_archives(a=np.ones(8)), "there are none"),
        ("gap.npz:/c", save_archives(a=SQUARE), "no array c"),
        ("gap.npz", save_part(save_archives(a=SQUARE), 0.5), "no .npz file"),
        ("gap.h5", save_part(save_hdf5(gap=SQUARE), 0.5), "cannot be read"),
        ("gap.h5", save_bytes(b"not HDF5"), "cannot be read"),
        ("gap.h5", save_hdf5(a=SQUARE, b=SQUARE), "FILE:/DATASET; there are a, b"),
        ("gap.h5:/c", save_hdf5(a=SQUARE), "no dataset /c"),
        ("gap.h5:/a", save_hdf5(a=h5py.Empty("f8")), "shape None"),
        ("gap.h5:/a", save_hdf5(a=SQUARE.astype(complex)), "complex128"),
        ("gap.h5:/a", save_hdf5(a="text"), "object"),
        ("gap.h5:/a", save_times(of_an_attribute=True), "cannot be read: No NumPy equivalent"),
        ("gap.h5:/b", save_times(of_an_attribute=False), "cannot be read: No NumPy equivalent"),
        ("gap.npy", save_bytes(b"0.1 0.2"), "no .npy file"),
        ("gap.h5:a", save_hdf5(a=SQUARE), "FILE:/DATASET"),
        ("gap.txt.gz", save_bytes(gzip.compress(ROWS.encode())[:-4]), "cannot be read"),
        ("gap.txt", save_bytes(b""), "empty"),
        ("gap.txt", save_bytes(b"1 2 3\n4 5\n"), "line 2 has 2 entries, line 1 has 3"),
        ("gap.txt", save_bytes(b"1 2\n3 4+5j\n"), "4+5j"),
        ("gap.txt", save_bytes(bytes(range(128, 256))), "cannot be read"),
    ],
)
def test_files_without_an_array_of_numbers_are_refused(name, save, message, tmp_path):
    path = str(tmp_path / name)
    save(tmp_path / name.partition(":")[0])
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        GapFile(path)
    assert str(refusal.value).startswith(f"gap file {tmp_path}/gap.")


def test_datasets_integers_and_byte_orders_are_read(tmp_path):
    values = np.arange(12).reshape(3, 4)
    with h5py.File(tmp_path / "many.h5", "w") as file:
        file["a/b"], file["c"] = values.astype(">f4"), np.zeros((3, 4))
    np.save(tmp_path / "big_endian.npy", values.astype(">i2"))
    np.save(tmp_path / "fortran.npy", np.asfortranarray(values, float))
    (tmp_path / "odd.txt").write_text("# a comment\n0 1\t2  3\n\n4\t5 6 7\n8 9 10 11e0\n")
    np.savez(tmp_path / "many.npz", a=values, b=np.zeros((3, 4)))
    for name in ("many.h5:/a/b", "many.npz:/a", "big_endian.npy", "fortran.npy", "odd.txt"):
        rows = GapFile(str(tmp_path / name)).rows(slice(1, 3))
        assert rows.dtype == np.float64
        np.testing.assert_array_equal(rows, values[1:])
