"""Tables as Markdown, plain text, CSV and HDF5.

A table is a sequence of mappings, one per row. A key that a row lacks, or that is None there, is an
empty cell. Not collective: call on one rank.
"""

from __future__ import annotations

import csv
import io
from numbers import Integral, Real
from pathlib import Path

import h5py
import numpy as np

from app.output.files import whole_file


def markdown(rows, columns=None, formats=None):
    """Return a Markdown table whose columns are aligned in the source as well.

    Parameters
    ----------
    rows : sequence of mapping
    columns : sequence of str, or mapping of str to str, optional
        Keys to show, in this order, or keys with their headings; all keys in order of appearance if
        not given.
    formats : mapping of str to str, optional
        Format specification of the numbers of a column, such as ``".3g"``; floats have six digits
        otherwise.

    Returns
    -------
    str
        Ends in a line feed.

    Examples
    --------
    >>> print(markdown([{"grid": "32x32", "its": 6}, {"grid": "64x64", "its": 10}]), end="")
    | grid  | its |
    |-------|----:|
    | 32x32 |   6 |
    | 64x64 |  10 |
    """
    headings, cells, right = _layout(rows, columns, formats, ".6g")
    cells = [[cell.replace("|", "\\|") for cell in row] for row in [headings, *cells]]
    width = [max(3, *map(len, column)) for column in zip(*cells, strict=True)]
    rule = ["-" * (w + 1) + ":" if r else "-" * (w + 2) for w, r in zip(width, right, strict=True)]
    lines = [f"| {' | '.join(_pad(row, width, right))} |" for row in cells]
    return "\n".join([lines[0], f"|{'|'.join(rule)}|", *lines[1:]]) + "\n"


def text(rows, columns=None, formats=None):
    """Return the table for a terminal: columns parted by two blanks. Parameters as `markdown`."""
    headings, cells, right = _layout(rows, columns, formats, ".6g")
    width = [max(map(len, column)) for column in zip(headings, *cells, strict=True)]
    lines = [headings, ["-" * w for w in width], *cells]
    return "".join("  ".join(_pad(line, width, right)).rstrip() + "\n" for line in lines)


def comma_separated(rows, columns=None, formats=None):
    """Return the table as CSV; without a format, numbers keep all digits. Parameters as `markdown`."""
    headings, cells, _ = _layout(rows, columns, formats, "")
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([headings, *cells])
    return out.getvalue()


def write_table(path, rows, columns=None, formats=None):
    """Write a table; the suffix chooses the kind: ``.md``, ``.txt``, ``.csv``, ``.h5`` or ``.hdf5``.

    The file appears whole or not at all. HDF5 gets one dataset per key (headings and formats do not
    matter there): int64, float64 with NaN for empty cells, or strings.

    Parameters
    ----------
    path : str or Path
    rows, columns, formats
        As for `markdown`.

    Raises
    ------
    ValueError
        If the suffix is none of these.
    """
    path = Path(path)
    kinds = {".md": markdown, ".txt": text, ".csv": comma_separated, ".h5": None, ".hdf5": None}
    if path.suffix not in kinds:
        raise ValueError(f"table {path}: the name must end in one of {', '.join(kinds)}")
    render = kinds[path.suffix]
    with whole_file(path) as temporary:
        if render is not None:
            temporary.write_text(render(rows, columns, formats), encoding="utf-8")
            return
        with h5py.File(temporary, "w") as file:
            for key in _headings(rows, columns):
                file.create_dataset(key, data=_column([row.get(key) for row in rows]))


def _headings(rows, columns):
    """Return the keys to show with their headings."""
    if columns is None:
        columns = dict.fromkeys(key for row in rows for key in row)
    return (
        dict(columns) if hasattr(columns, "keys") and any(columns.values()) else {key: key for key in columns}
    )


def _layout(rows, columns, formats, default):
    """Return headings, cells as strings, and which columns hold numbers (set flush right)."""
    columns = _headings(rows, columns)
    values = [[row.get(key) for key in columns] for row in rows]
    present = [[row[k] for row in values if row[k] is not None] for k in range(len(columns))]
    right = [bool(column) and all(map(_is_number, column)) for column in present]
    formats = [(formats or {}).get(key) for key in columns]
    cells = [
        [_cell(value, spec, default) for value, spec in zip(row, formats, strict=True)] for row in values
    ]
    return list(columns.values()), cells, right


def _is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def _cell(value, spec, default):
    if value is None:
        return ""
    if not _is_number(value):
        return str(value)
    if spec is None:
        spec = "d" if isinstance(value, Integral) else default
    return format(value, spec)


def _pad(row, width, right):
    return [c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, width, right, strict=True)]


def _column(values):
    """Return the values as an array HDF5 can hold."""
    present = [value for value in values if value is not None]
    if not all(_is_number(value) for value in present):
        return np.array(["" if value is None else str(value) for value in values], dtype=h5py.string_dtype())
    if len(present) == len(values) and all(isinstance(value, Integral) for value in present):
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
