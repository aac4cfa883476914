"""Fields of many solutions in one HDF5 file.

Each field is a dataset of shape (rows, ny, nx); entry k belongs to row k of the table. `x` and `y` are the cell centres
[mm]. The group ``table`` has the columns of the table. Fields without a solution are NaN.
"""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from app.base import hdf5 as h5py
from app.base.errors import InputError
from app.base.quantities import unit_of
from app.io.files import atomic_file, check_output_path, report_write_errors
from app.io.frames import UNITS
from app.io.result import FIELDS, PLASTIC_FIELDS
from app.io.write import create_axes, create_field, reserve

_TYPES = FIELDS | PLASTIC_FIELDS
_BYTES_PER_COLUMN = 4096  # more than HDF5 needs for the metadata of a dataset


def check_fields(path, names, grids):
    """Check file name, fields and grids; return the names of the fields."""
    check_output_path(path, what="output")
    names = (names,) if isinstance(names, str) else tuple(names)
    if not names or not set(names) <= _TYPES.keys():
        raise InputError(f"fields {names}: must be among {', '.join(_TYPES)}")
    if len({replace(grid, periodic="") for grid in grids}) > 1:
        raise InputError("output: the problems are on several grids; one file needs fields of one shape")
    return names


class FieldStack:
    """An open HDF5 file with fields of many solutions, for `solve_many`."""

    def __init__(self, file, path, target):
        self._file, self._path, self._name = file, path, f"output {target}"

    def write(self, row, fields):
        """Write a row's fields; missing fields become NaN."""
        for name in _TYPES.keys() & self._file.keys():
            missing = 0 if _TYPES[name] is np.uint8 else np.nan
            with report_write_errors(self._name):
                self._file[name][row] = missing if fields is None or fields[name] is None else fields[name]

    def write_table(self, columns):
        """Write the columns of the table."""
        size = sum(np.asarray(column).nbytes + _BYTES_PER_COLUMN for column in columns.values())
        with report_write_errors(self._name):
            reserve(self._path, self._path.stat().st_size + size, "r+b")
        table = self._file.create_group("table", track_order=True)
        for name, column in columns.items():
            is_text = np.asarray(column).dtype.kind in "UO"
            table[name] = np.asarray(column, h5py.string_dtype()) if is_text else column
            table[name].attrs["unit"] = unit_of(name)


@contextmanager
def open_field_stack(path, names, rows, grid):
    """Yield a `FieldStack`, replacing `path` if the block succeeds.

    The space is reserved first, because HDF5 cannot close a file on a full disk.
    """
    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)  # all rows are written
    in_block = False
    try:
        with atomic_file(path) as temporary, h5py.File(temporary, "w") as file:
            create_axes(file, {"x": grid.x(), "y": grid.y()})
            shape = rows, *grid.shape
            for name in names:
                create_field(file, name, "yx", UNITS[name], shape=shape, dtype=_TYPES[name], dcpl=early)
            file.flush()
            size = sum(rows * grid.n * np.dtype(_TYPES[name]).itemsize for name in names)
            reserve(temporary, temporary.stat().st_size + size, "r+b")
            in_block = True
            yield FieldStack(file, temporary, path)
            in_block = False
    except OSError:
        if in_block:  # an error of the caller
            raise
        with report_write_errors(f"output {path}"):
            raise
