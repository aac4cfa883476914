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

from app.io.files import atomic_hdf5, write_text


def format_markdown(rows, columns=None, formats=None):
    """Return a Markdown table whose columns are aligned in the source as well.

    Parameters
    ----------
    rows : sequence of mapping
    columns : sequence of str, optional
        Keys to show, in this order; all keys in order of appearance if not given.
    formats : mapping of str to str, optional
        Format specification of the floats of a column, such as ``".3g"``; they have six digits otherwise.

    Returns
    -------
    str
        Ends in a line feed.

    Examples
    --------
    >>> print(format_markdown([{"grid": "32x32", "its": 6}, {"grid": "64x64", "its": 10}]), end="")
    | grid   |   its |
    |:-------|------:|
    | 32x32  |     6 |
    | 64x64  |    10 |
    """
    return _rendered("pipe", rows, columns, formats, {"|": r"\|"})


def format_text(rows, columns=None, formats=None):
    """Return the table for a terminal: columns parted by two blanks. Parameters as `markdown`."""
    return _rendered("simple", rows, columns, formats)


def format_csv(rows, columns=None):
    """Return the table as CSV; numbers keep all digits. Parameters as `markdown`."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns or _keys(rows), extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def write_table(path, rows, columns=None):
    """Write a table; the suffix chooses the kind: ``.md``, ``.txt``, ``.csv``, ``.h5`` or ``.hdf5``.

    The file appears whole or not at all. HDF5 gets one dataset per key: int64, float64 with NaN for empty cells, or
    strings.

    Parameters
    ----------
    path : str or Path
    rows, columns
        As for `markdown`.

    Raises
    ------
    ValueError
        If the suffix is none of these.
    """
    path = Path(path)
    kinds = {".md": format_markdown, ".txt": format_text, ".csv": format_csv, ".h5": None, ".hdf5": None}
    kind = path.suffix.lower()
    if kind not in kinds:
        raise ValueError(f"table {path}: the name must end in one of {', '.join(kinds)}")
    render = kinds[kind]
    if render is not None:
        write_text(path, render(rows, columns))
        return
    with atomic_hdf5(path) as file:
        for key in columns or _keys(rows):
            file.create_dataset(key, data=_column([row.get(key) for row in rows]))


def _keys(rows):
    return list(dict.fromkeys(key for row in rows for key in row))


def _rendered(kind, rows, columns, formats, escapes=None):
    from tabulate import tabulate

    columns = columns or _keys(rows)
    escapes = str.maketrans(escapes or {})
    cells = [[_cell(row.get(key), escapes) for key in columns] for row in rows]
    # Text stays what it is, even if it could be read as a number.
    texts = [k for k in range(len(columns)) if any(isinstance(row[k], str) for row in cells)]
    floats = [(formats or {}).get(key, ".6g") for key in columns]
    headings = [key.translate(escapes) for key in columns]
    return tabulate(cells, headings, kind, floats, numalign="right", disable_numparse=texts) + "\n"


def _cell(value, escapes):
    if isinstance(value, np.generic):
        value = value.item()
    return value.translate(escapes) if isinstance(value, str) else value


def _is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def _column(values):
    """Return the values as an array HDF5 can hold."""
    present = [value for value in values if value is not None]
    if not all(_is_number(value) for value in present):
        return np.array(["" if value is None else str(value) for value in values], dtype=h5py.string_dtype())
    if len(present) == len(values) and all(isinstance(value, Integral) for value in present):
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
