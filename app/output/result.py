"""Result file (HDF5): the solution, the history of the iteration and how the run was made.

=========================  ==========  =======  =====  ==========================================
dataset                    shape       type     unit   meaning (symbol of the paper)
=========================  ==========  =======  =====  ==========================================
``pressure``               (ny, nx)    float64  N/mm2  p
``gap``                    (ny, nx)    float64  mm     deformed distance e = h + u, (2.3)
``displacement``           (ny, nx)    float64  mm     u = A p, (2.7)
``undeformed_distance``    (ny, nx)    float64  mm     h
``contact``                (ny, nx)    uint8    1      1 on the contact set C, else 0
``x``, ``y``               (nx), (ny)  float64  mm     cell centres
``history/<column>``       (k)                  yes    one entry per active set iteration
``path/<column>``          (steps)              yes    of a load path: one entry per step, the fields are the last's
=========================  ==========  =======  =====  ==========================================

`x` and `y` are the dimension scales of the fields, as in NetCDF: xarray finds the coordinates.

`gap` and `undeformed_distance` are NaN in inadmissible cells (contact impossible). The last entry of
``history/level`` belongs to the target grid; numbers that differ by one are neighbouring grids.

Root attributes are Python numbers, strings or small numeric arrays: lengths and `approach` in mm,
`load` in N, pressures and moduli in N/mm2, times in s; `residual` is (5.1), without unit. Of the others
docs/results.md says what they mean.
Datasets and attributes beyond the required ones are kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from app.errors import InputError, one_line
from app.halfspace.grid import runs
from app.memory import check_fits
from app.output.files import check_output_path, publish, remove, temporary_name

_CELLS_AT_ONCE = 1 << 20  # written together
METADATA_BYTES = 1 << 16  # more than HDF5 needs for the names and layout of a few dozen datasets

FIELDS = {
    "pressure": np.float64,
    "gap": np.float64,
    "displacement": np.float64,
    "undeformed_distance": np.float64,
    "contact": np.uint8,
}
AXES = {"x": np.float64, "y": np.float64}
UNITS = {
    "pressure": "N/mm2",
    "gap": "mm",
    "displacement": "mm",
    "undeformed_distance": "mm",
    "contact": "1",
    "x": "mm",
    "y": "mm",
}
HISTORY_UNITS = {"load": "N", "approach": "mm", "seconds": "s"}  # of the others: 1
HISTORY = {
    "level": np.int64,
    "contact_cells": np.int64,
    "changed_cells": np.int64,
    "residual": np.float64,
    "inner_iterations": np.int64,
    "work_units": np.float64,
}
ATTRIBUTES = (
    "converged",
    "reason",
    "active_set_iterations",
    "work_units",
    "operator_applications",
    "inner_iterations",
    "residual",
    "load",
    "approach",
    "max_pressure",
    "contact_cells",
    "contact_fraction",
    "solve_seconds",
    "setup_seconds",
    "ranks",
    "options",
    "command_line",
    "version",
)

TEXTS = ("reason", "options", "command_line", "version", "notes", "problem", "periodic_symbol")
NUMBERS = (  # beside the other `ATTRIBUTES`, where there are any
    "mean_pressure", "contact_area", "contact_modulus", "rms_slope", "rms_height", "mean_gap", "stiffness",
    "error_bound", "discretisation_error", "poisson_ratio", "periodic", "largest_penetration", "smallest_pressure",
)  # fmt: skip
PAIRS = ("young", "poisson")


@dataclass(frozen=True, eq=False)
class Result:
    """A result file in memory; names, shapes and units as in the module's table.

    Attributes
    ----------
    pressure, gap, displacement, undeformed_distance : ndarray of float64, shape (ny, nx)
    contact : ndarray of uint8, shape (ny, nx)
    x, y : ndarray of float64, shapes (nx,) and (ny,)
    attributes : dict
        Root attributes as Python bool, int, float, str or ndarray.
    history : dict of str to ndarray, shape (k,)
    extra : dict of str to ndarray
        Datasets of the file's root that are not in the table.
    units : dict of str to str
        Unit of every dataset that states one.
    path : dict of str to ndarray, shape (steps,)
        Table of a load path; empty if the result is of one loading.
    """

    pressure: np.ndarray
    gap: np.ndarray
    displacement: np.ndarray
    undeformed_distance: np.ndarray
    contact: np.ndarray
    x: np.ndarray
    y: np.ndarray
    attributes: dict
    history: dict
    extra: dict = field(default_factory=dict)
    units: dict = field(default_factory=dict)
    path: dict = field(default_factory=dict)


@dataclass(frozen=True)
class ByRows:
    """A field that is made some rows at a time, when they are written: ``values(slice) -> ndarray``."""

    shape: tuple
    dtype: np.dtype
    values: Callable

    def __getitem__(self, rows):
        return self.values(rows)


def write_result(path, comm, slabs, fields, x, y, attributes, history, units=None, steps=None):
    """Write a result file; it appears whole or not at all.

    Collective. `path`, `x`, `y`, `attributes`, `history` and `units` are those of rank 0 (a measured
    time need not be the same everywhere). An error on any rank is raised on all of them.

    Parameters
    ----------
    path : str or Path
        Ends in ``.h5`` or ``.hdf5``; an existing file is replaced at the very end.
    comm : mpi4py.MPI.Comm
        More than one rank write by the MPI-IO driver, or in turn if h5py is built without it.
    slabs : app.halfspace.grid.Slabs
        Distribution of the rows; ranks may own none.
    fields : mapping of str to array_like or ByRows, shape (slabs.local, nx)
        This rank's rows of all of `FIELDS`, and of any others to be stored.
    x, y : array_like, shapes (nx,) and (ny,), [mm]
        Cell centres of the whole grid.
    attributes : mapping
        All of `ATTRIBUTES` and any others: bool, int, float, str or numeric arrays.
    history : mapping of str to array_like, shape (k,)
        All of `HISTORY` and any other numeric columns; empty if there was no iteration.
    units : mapping of str to str, optional
        Units of the fields that are not in `FIELDS`, and of `steps`; ``"1"`` if not given.
    steps : mapping of str to array_like, shape (steps,), optional
        Numeric columns of a load path.

    Raises
    ------
    InputError
        If something is missing or has the wrong shape or type, or `path` is of no use.
    OSError
        If writing fails.
    """
    path, plan = comm.bcast(
        _together(
            comm,
            ValueError,
            lambda: (
                check_output_path(path),
                _plan(slabs, fields, x, y, attributes, history, units, steps),
            ),
            only_root=True,
        )
    )
    rows = _together(comm, ValueError, lambda: _local_rows(comm, slabs, fields, plan))
    temporary = comm.bcast(temporary_name(path) if comm.rank == 0 else None)
    try:
        # With HDF5 on MPI-IO the ranks share the writing of metadata, and an error in it, or in opening
        # the file, on one rank leaves the others waiting for ever. So rank 0 alone writes all metadata,
        # every rank tries to open the file (folder not shared, too many open files), and only rows of
        # data go through MPI-IO.
        _together(comm, OSError, lambda: _lay_out(temporary, plan), only_root=True)
        _together(comm, OSError, lambda: temporary.open("r+b").close())
        _write_rows(temporary, comm, slabs, rows)
        _together(comm, OSError, lambda: publish(temporary, path), only_root=True)
    except OSError:
        if comm.rank == 0:
            remove(temporary)
        comm.Barrier()  # the file is gone when the error appears, on every rank
        raise


def read_result(path):
    """Read a result file.

    Not collective: the calling rank reads the whole grid.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If there is no such file, or it is not a result file (the message names what is missing).
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"result file {path}: {'not a file' if path.exists() else 'no such file'}")
    try:
        with h5py.File(path, "r") as file:
            return _read_hdf5(file)
    except ValueError as error:
        raise InputError(f"result file {path}: {error}") from error
    except (
        OSError,
        RuntimeError,
        KeyError,
    ) as error:  # KeyError, RuntimeError: links that lead nowhere or in a circle
        raise InputError(f"result file {path}: not a readable HDF5 file ({one_line(error)})") from error


def _plan(slabs, fields, x, y, attributes, history, units, steps):
    """Check what rank 0 gives and return it as dict, ready to be written."""
    axes = {name: np.asarray(values, AXES[name]) for name, values in (("x", x), ("y", y))}
    if axes["x"].ndim != 1 or axes["y"].shape != (slabs.ny,):
        raise InputError(
            f"cell centres have shapes {axes['x'].shape}, {axes['y'].shape}, rows are {slabs.ny}"
        )
    _require(fields, FIELDS, "field")
    _require(attributes, ATTRIBUTES, "attribute")
    history = history or dict.fromkeys(HISTORY, ())
    _require(history, HISTORY, "history column")
    for name in fields:
        if name in axes or name in ("history", "path") or "/" in name:
            raise InputError(f"field {name!r}: name is reserved")
    for name, value in attributes.items():
        value = np.asarray(value)
        if value.dtype.kind not in ("biufU" if value.ndim == 0 else "biuf"):
            raise InputError(f"attribute {name}: {value.dtype} is not a number, string or numeric array")
    columns = {name: np.asarray(values, HISTORY.get(name)) for name, values in history.items()}
    shape = columns["level"].shape
    for name, column in columns.items():
        if column.ndim != 1 or column.shape != shape or column.dtype.kind not in "biuf":
            raise InputError(
                f"history column {name}: shape {column.shape}, type {column.dtype}; level has {shape}"
            )
    types = {name: np.dtype(FIELDS.get(name) or _rows_of(values).dtype) for name, values in fields.items()}
    for name, dtype in types.items():
        if dtype.kind not in "biuf":
            raise InputError(f"field {name}: {dtype} is not numeric")
    return {
        "types": types,
        "units": {**dict.fromkeys(types, "1"), **(units or {}), **UNITS},
        "axes": axes,
        "attributes": dict(attributes),
        "history": columns,
        "path": {name: np.asarray(values) for name, values in (steps or {}).items()},
    }


def _local_rows(comm, slabs, fields, plan):
    """Return this rank's rows of every field, of which the type in the file can be made."""
    if (slabs.size, slabs.rank) != (comm.size, comm.rank):
        raise InputError(f"slabs of rank {slabs.rank} of {slabs.size} on rank {comm.rank} of {comm.size}")
    if fields.keys() != plan["types"].keys():
        raise InputError(f"fields {sorted(fields)}, but rank 0 has {sorted(plan['types'])}")
    rows = {name: _rows_of(fields[name]) for name in plan["types"]}
    shape = slabs.local, plan["axes"]["x"].size
    for name, values in rows.items():
        if values.shape != shape:
            raise InputError(f"field {name}: shape {values.shape}, rows and columns of this rank are {shape}")
        _cast(f"field {name}", values[:0], plan["types"][name])  # HDF5 does it, run by run
    return rows


def _rows_of(field):
    return field if isinstance(field, ByRows) else np.asarray(field)


def _lay_out(path, plan):
    """Write everything except the rows of the fields, for which space is kept. Rank 0 only."""
    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    shape = plan["axes"]["y"].size, plan["axes"]["x"].size
    # A full disk must show up here, in plain system calls: HDF5 cannot even close a file that it failed
    # to write. The space is taken twice because HDF5 starts from an empty file.
    columns = (*plan["axes"].values(), *plan["history"].values(), *plan["path"].values())
    size = sum(column.nbytes for column in columns)
    size += sum(len(str(value).encode(errors="replace")) for value in plan["attributes"].values())
    size += shape[0] * shape[1] * sum(dtype.itemsize for dtype in plan["types"].values()) + METADATA_BYTES
    _reserve(path, size, "xb")
    with h5py.File(path, "w") as file:
        in_order = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        in_order.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
        in_order.set_obj_track_times(False)  # the same result is the same file
        for name in ("history", *(["path"] if plan["path"] else [])):
            h5py.h5g.create(file.id, name.encode(), gcpl=in_order)
        for name, value in plan["attributes"].items():
            file.attrs[name] = value
        for name, column in plan["history"].items():
            file[f"history/{name}"] = column
            file[f"history/{name}"].attrs["unit"] = HISTORY_UNITS.get(name, "1")
        for name, column in plan["path"].items():
            file[f"path/{name}"] = column.astype(np.uint8) if column.dtype == bool else column
            file[f"path/{name}"].attrs["unit"] = plan["units"].get(name, "1")
        for name, axis in plan["axes"].items():
            file[name] = axis
            file[name].make_scale(name)
        for name, dtype in plan["types"].items():
            file.create_dataset(name, shape, dtype, dcpl=early)
            for dimension, axis in zip(file[name].dims, ("y", "x"), strict=True):
                dimension.attach_scale(file[axis])
        for name in (*plan["axes"], *plan["types"]):
            file[name].attrs["unit"] = plan["units"][name]
    _reserve(path, path.stat().st_size, "r+b")


def _reserve(path, size, mode):
    with path.open(mode) as file:
        os.posix_fallocate(file.fileno(), 0, size)


def _write_rows(path, comm, slabs, rows):
    """Write the rows of the fields, all ranks at once by MPI-IO, or rank after rank if h5py cannot. Collective."""

    def write(**driver):
        with h5py.File(path, "r+", **driver) as file:
            for name, values in rows.items():
                for part in runs(*values.shape, _CELLS_AT_ONCE):
                    start = slabs.rows.start
                    file[name][start + part.start : start + part.stop] = values[part]

    if np.count_nonzero(slabs.counts) == 1:
        _together(comm, OSError, lambda: write() if slabs.local else None)
    elif h5py.get_config().mpi:
        _together(comm, OSError, lambda: write(driver="mpio", comm=comm))
    else:
        for turn in range(comm.size):
            _together(comm, OSError, lambda: write() if turn == comm.rank else None)  # noqa: B023


def _read_hdf5(file):
    if not any(name in file for name in FIELDS):
        raise InputError("no result of app.solve: it has none of the datasets " + ", ".join(FIELDS))
    _require(file.attrs, ATTRIBUTES, "attribute")
    sizes = []
    file.visititems(lambda name, item: sizes.append(float(getattr(item, "nbytes", None) or 0)))
    check_fits(sum(sizes), "what it holds")  # a few bytes can stand for many
    data = {name: read_dataset(file, name, dtype) for name, dtype in (FIELDS | AXES).items()}
    shape = data["y"].size, data["x"].size
    for name in FIELDS:
        if data[name].shape != shape:
            raise InputError(f"dataset {name}: shape {data[name].shape}, but y and x say {shape}")
    history = {name: read_dataset(file, f"history/{name}", dtype) for name, dtype in HISTORY.items()}
    history |= _columns(file, "history", history)
    extra = {
        name: item[()] for name, item in file.items() if name not in data and isinstance(item, h5py.Dataset)
    }
    units = {
        name: str(file[name].attrs.get("unit", "1")) for name in (*data, *extra) if "unit" in file[name].attrs
    }
    attributes = {name: _attribute(name, value) for name, value in file.attrs.items()}
    steps = _columns(file, "path")
    return Result(**data, attributes=attributes, history=history, extra=extra, units=units, path=steps)


def _columns(file, group, known=()):
    """Columns of a group that are not known yet; all of the group are numbers, and equally many."""
    if group not in file:
        return {}
    names = list(file[group]) if isinstance(file[group], h5py.Group) else [""]
    columns = {name: read_dataset(file, f"{group}/{name}") for name in names if name not in known}
    lengths = {column.shape for column in (*columns.values(), *dict(known).values())}
    if len(lengths) > 1 or any(len(shape) != 1 for shape in lengths):
        raise InputError(f"{group}: columns of shapes {sorted(lengths)}")
    return columns


def read_dataset(file, name, dtype=None):
    """A dataset of numbers from an open file, of its own type if no other is given; ValueError if it is none."""
    item = file.get(name)
    if not isinstance(item, h5py.Dataset):
        raise InputError(f"dataset {name} is missing")
    if item.shape is None or item.dtype.kind not in "biuf":
        raise InputError(f"dataset {name}: type {item.dtype}, shape {item.shape} where numbers are needed")
    if name in AXES and (item.ndim != 1 or not item.size):
        raise InputError(f"dataset {name}: shape {item.shape} where one of cell centres is needed")
    check_fits(float(item.nbytes), f"dataset {name}")
    return _cast(f"dataset {name}", item[()], dtype or item.dtype)


def _attribute(name, value):
    """An attribute as Python has it."""
    text, number = name in TEXTS, name in NUMBERS or name in ATTRIBUTES
    plain = value.item() if isinstance(value, np.generic) else value
    if name in PAIRS and not (
        isinstance(plain, np.ndarray) and plain.shape == (2,) and plain.dtype.kind in "iuf"
    ):
        raise InputError(f"attribute {name}: {plain!r} where two numbers are needed")
    if (text and not isinstance(plain, str)) or (
        number and not text and not isinstance(plain, bool | int | float)
    ):
        raise InputError(f"attribute {name}: {plain!r} where a {'text' if text else 'number'} is needed")
    return plain


def _cast(name, values, dtype):
    if not np.can_cast(values.dtype, dtype, "same_kind"):
        raise InputError(f"{name}: type {values.dtype} where {np.dtype(dtype)} is needed")
    return values.astype(dtype, copy=False)


def _require(found, names, kind):
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{kind} {', '.join(missing)} is missing")


def _together(comm, kind, step, only_root=False):
    """Run `step` on all ranks (or rank 0) and return its value; if it fails on any, raise `kind` on all."""
    value = complaint = None
    try:
        if comm.rank == 0 or not only_root:
            value = step()
    except Exception as error:
        # Its text only: an exception in a variable would keep alive all objects of this rank, but not of the others.
        complaint = one_line(error)
    for rank, message in enumerate(comm.allgather(complaint)):
        if message is not None:
            raise kind(message if comm.size == 1 else f"rank {rank}: {message}")
    return value
