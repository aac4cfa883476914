"""Tables as Markdown, plain text, CSV, HDF5 and MATLAB files.

A table is a sequence of mappings, one per row. A missing key or a value of None is an empty cell.
"""

import csv
import io
from numbers import Integral, Real
from pathlib import Path

import numpy as np

from app.base.errors import InputError
from app.io.files import atomic_file, atomic_hdf5, report_write_errors, write_text


def format_markdown(rows, columns=None, formats=None):
    """Return a Markdown table with aligned columns.

    `columns` are the keys to show, by default all in order of appearance. `formats` maps a key to the format of its
    floats, by default ``".6g"``.

    Examples
    --------
    >>> print(format_markdown([{"grid": "32x32", "its": 6}, {"grid": "64x64", "its": 10}]), end="")
    | grid   |   its |
    |:-------|------:|
    | 32x32  |     6 |
    | 64x64  |    10 |
    """
    return _tabulate("pipe", rows, columns, formats, {"|": r"\|"})


def format_text(rows, columns=None, formats=None):
    """Return a table as plain text; see `format_markdown`."""
    return _tabulate("simple", rows, columns, formats)


def format_csv(rows, columns=None):
    """Return a table as CSV, with all digits.

    The parameters are as in `format_markdown`.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns or _list_keys(rows), extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def write_table(path, rows, columns=None):
    """Write a table atomically, in the suffix's format.

    The suffix is ``.md``, ``.txt``, ``.csv``, ``.h5``, ``.hdf5`` or ``.mat``; InputError for any other. An HDF5 file
    has a dataset for each key: int64, float64 with NaN for empty cells, or strings. A MATLAB file has a column vector
    for each key, or a cell array of strings.
    """
    path = Path(path)
    formatters = {".md": format_markdown, ".txt": format_text, ".csv": format_csv}
    suffix = path.suffix.lower()
    if suffix in formatters:
        with report_write_errors(path):
            write_text(path, formatters[suffix](rows, columns))
        return
    if suffix not in (".h5", ".hdf5", ".mat"):
        raise InputError(
            f"table {path}: the name must end in one of {', '.join(formatters)}, .h5, .hdf5, .mat"
        )
    columns = list(columns or _list_keys(rows))
    arrays = {key: _to_array([row.get(key) for row in rows]) for key in columns}
    if suffix == ".mat":
        from scipy.io import savemat  # loads slowly

        with report_write_errors(path), atomic_file(path) as temporary:
            savemat(temporary, arrays, appendmat=False, oned_as="column")
        return
    with report_write_errors(path), atomic_hdf5(path) as file:
        file.attrs["columns"] = columns  # in this order
        for key, array in arrays.items():
            file[key] = array


def _list_keys(rows):
    return list(dict.fromkeys(key for row in rows for key in row))


def _tabulate(kind, rows, columns, formats, escapes=None):
    from tabulate import tabulate

    columns = columns or _list_keys(rows)
    escapes = str.maketrans(escapes or {})

    def escape(value):
        value = value.item() if isinstance(value, np.generic) else value
        return value.translate(escapes) if isinstance(value, str) else value

    cells = [[escape(row.get(key)) for key in columns] for row in rows]
    # Keep texts that look like numbers.
    texts = [k for k in range(len(columns)) if any(isinstance(row[k], str) for row in cells)]
    floats = [(formats or {}).get(key, ".6g") for key in columns]
    table = tabulate(cells, map(escape, columns), kind, floats, numalign="right", disable_numparse=texts)
    return f"{table}\n"


def _to_array(values):
    present = [value for value in values if value is not None]
    if not all(isinstance(value, Real) and not isinstance(value, bool | np.bool_) for value in present):
        import h5py  # loads slowly

        return np.array(["" if value is None else str(value) for value in values], h5py.string_dtype())
    if len(present) == len(values) and all(isinstance(value, Integral) for value in present):
        return np.array(values, np.int64)
    return np.array([np.nan if value is None else value for value in values], np.float64)
