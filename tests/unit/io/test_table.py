"""Tables of every kind."""

import csv
import io

import h5py
import numpy as np
import pytest
from scipy.io import loadmat

from app.io.table import format_csv, format_markdown, format_text, write_table

ROWS = [
    {"grid": "32|32", "its": 6, "residual": 1.25e-7},
    {"grid": "64|64", "its": 10, "residual": None, "note": "C"},
]


def test_markdown_and_text_align_numbers_to_the_right():
    assert format_markdown(ROWS, ["grid", "residual", "its"], {"residual": ".1e"}).splitlines() == [
        "| grid   |   residual |   its |",
        "|:-------|-----------:|------:|",
        r"| 32\|32 |    1.2e-07 |     6 |",
        r"| 64\|64 |            |    10 |",
    ]
    assert format_text(ROWS, ["its", "note"]).splitlines() == [
        "  its  note",
        "-----  ------",
        "    6",
        "   10  C",
    ]


def test_cells_show_types_and_missing_values():
    rows = [
        {"a": np.int64(12345678), "b": np.bool_(True), "c": "14.60", "d": 0.1 + 0.2},
        {"a": None, "b": False, "c": None, "d": np.nan},
    ]
    assert [line.split() for line in format_text(rows).splitlines()[2:]] == [
        ["12345678", "True", "14.60", "0.3"],
        ["False", "nan"],
    ]


def test_csv_keeps_all_digits():
    rows = [{"a": 0.1 + 0.2, "b": np.float64(1 / 3), "c": 'x, "y"'}, {"a": np.nan, "b": 1e-300, "c": True}]
    found = list(csv.DictReader(io.StringIO(format_csv(rows))))
    assert [float(row["b"]) for row in found] == [1 / 3, 1e-300]
    assert float(found[0]["a"]) == 0.1 + 0.2
    assert [row["c"] for row in found] == ['x, "y"', "True"]


def test_tables_are_written_in_every_format(tmp_path):
    for name, render in (("a.md", format_markdown), ("a.txt", format_text), ("a.csv", format_csv)):
        write_table(tmp_path / name, ROWS)
        assert (tmp_path / name).read_text() == render(ROWS)
    write_table(tmp_path / "a.h5", ROWS)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["its"].dtype == np.int64
        assert file["its"][:].tolist() == [6, 10]
        assert np.array_equal(file["residual"], [1.25e-7, np.nan], equal_nan=True)
        assert file["note"].asstr()[:].tolist() == ["", "C"]
    write_table(tmp_path / "a.mat", ROWS)
    mat = loadmat(tmp_path / "a.mat")
    assert mat["its"].tolist() == [[6], [10]]
    assert np.array_equal(mat["residual"], [[1.25e-7], [np.nan]], equal_nan=True)
    assert mat["grid"][1, 0] == "64|64"
    with pytest.raises(ValueError, match=r"a\.xls: the name must end in one of"):
        write_table(tmp_path / "a.xls", ROWS)
    assert format_markdown([], ["a"]).splitlines() == ["| a   |", "|-----|"]
    assert format_csv([], ["a"]) == "a\n"
