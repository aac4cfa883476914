"""Parallel and atomic writing of a result file."""

import os
from collections.abc import Mapping

import numpy as np

from app.base import hdf5 as h5py
from app.base.errors import InputError, call_collectively, check_type, format_message
from app.base.quantities import unit_of
from app.halfspace.grid import row_blocks
from app.io.files import check_output_path, make_temporary_name, publish, remove
from app.io.frames import UNITS
from app.io.result import AXES, FIELDS, HISTORY, PLASTIC_FIELDS

_CELLS_PER_WRITE = 1 << 20
_METADATA_BYTES = 1 << 16  # more than HDF5 needs for a few dozen datasets


def write_result(path, comm, slabs, fields, x, y, attributes, history, steps=None):
    """Write a result file atomically.

    Collective; errors are raised on all ranks. Rank 0 provides all arguments except `fields`.

    Parameters
    ----------
    path : str or Path
        Name of the file, ending in ``.h5`` or ``.hdf5``; an existing file is replaced.
    comm : mpi4py.MPI.Comm
        Ranks that share the fields. They write by MPI-IO, or in turn if h5py has no MPI.
    slabs : app.parallel.slabs.Slabs
    fields : mapping of str to array_like, shape (slabs.local, nx)
        This rank's rows of all `FIELDS` and of additional fields.
    x, y : array_like, shapes (nx,) and (ny,), [mm]
    attributes : mapping
        All of `app.io.result.ATTRIBUTES`, and additional values of type bool, int, float, str or numeric array.
    history, steps : mapping of str to array_like, shape (k,)
        Numeric columns: all of `HISTORY` and more, and the columns of a load path.

    Raises InputError for a wrong path or type, OSError if writing fails.
    """
    path = call_collectively(comm, check_output_path, path, only_root=True)
    plan = call_collectively(comm, _plan, fields, x, y, attributes, history, steps, only_root=True)
    rows = {name: np.asarray(fields[name]) for name in plan["types"]}
    temporary = comm.bcast(make_temporary_name(path) if comm.rank == 0 else None)
    try:
        # In MPI-IO an error of one rank in metadata or in opening the file deadlocks the others. So rank 0 writes
        # all metadata, each rank tries to open the file, and only rows of data go through MPI-IO.
        _run_collectively(comm, lambda: _lay_out(temporary, plan), only_root=True)
        _run_collectively(comm, lambda: temporary.open("r+b").close())
        _write_rows(temporary, comm, slabs, rows)
        _run_collectively(comm, lambda: publish(temporary, path), only_root=True)
    except BaseException as error:  # also Ctrl-C
        if comm.rank == 0:
            remove(temporary)
        if isinstance(error, OSError):
            comm.Barrier()  # no rank reports the error before the file is removed
        raise


def _plan(fields, x, y, attributes, history, steps):
    """Check all data except the fields; return what rank 0 writes.

    Return the types of the fields, the axes, the attributes and the columns.
    """
    for name, value in attributes.items():
        value = np.asarray(value)
        if value.dtype.kind not in ("biufU" if value.ndim == 0 else "biuf"):
            raise InputError(f"attribute {name}: {value.dtype} is not a number, string or numeric array")
    check_type("steps", steps, Mapping | None, "columns by name, the table of a load path")
    steps = {name: np.asarray(values) for name, values in (steps or {}).items()}
    for name, column in steps.items():
        if (
            column.ndim != 1
            or len({len(column), *map(np.size, steps.values())}) > 1
            or column.dtype.kind not in "biuf"
        ):
            raise InputError(
                f"steps: column {name}: shape {column.shape}, type {column.dtype}; needed: a number for each step"
            )
    known = FIELDS | PLASTIC_FIELDS
    types = {name: np.dtype(known.get(name) or np.asarray(values).dtype) for name, values in fields.items()}
    for name, dtype in types.items():
        if dtype.kind not in "biuf":
            raise InputError(f"field {name}: {dtype} is not numeric")
    history = history or dict.fromkeys(HISTORY, ())
    return {
        "types": types,
        "axes": {name: np.asarray(values, AXES[name]) for name, values in (("x", x), ("y", y))},
        "attributes": dict(attributes),
        "history": {name: np.asarray(values, HISTORY.get(name)) for name, values in history.items()},
        "path": steps,
    }


def _lay_out(path, plan):
    """Write all data except the fields, and reserve space for the fields.

    Only rank 0 calls this function.
    """
    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    shape = plan["axes"]["y"].size, plan["axes"]["x"].size
    # HDF5 cannot close a file on a full disk, so system calls reserve the space. HDF5 empties the file; therefore
    # the space is reserved again at the end.
    columns = (*plan["axes"].values(), *plan["history"].values(), *plan["path"].values())
    size = sum(column.nbytes for column in columns)
    size += sum(len(str(value).encode(errors="replace")) for value in plan["attributes"].values())
    size += shape[0] * shape[1] * sum(dtype.itemsize for dtype in plan["types"].values()) + _METADATA_BYTES
    reserve(path, size, "xb")
    with h5py.File(path, "w") as file:
        in_order = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        in_order.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
        in_order.set_obj_track_times(False)  # equal results are equal files
        for name in ("history", *(["path"] if plan["path"] else [])):
            h5py.h5g.create(file.id, name.encode(), gcpl=in_order)
        for name, value in plan["attributes"].items():
            file.attrs[name] = value
        for name, column in plan["history"].items():
            file[f"history/{name}"] = column
            file[f"history/{name}"].attrs["unit"] = unit_of(name)
        for name, column in plan["path"].items():
            file[f"path/{name}"] = column.astype(np.uint8) if column.dtype == bool else column
            file[f"path/{name}"].attrs["unit"] = unit_of(name)
        create_axes(file, plan["axes"])
        for name, dtype in plan["types"].items():
            create_field(file, name, "yx", UNITS.get(name, "1"), shape=shape, dtype=dtype, dcpl=early)
    reserve(path, path.stat().st_size, "r+b")


def create_axes(file, axes):
    """Create the dimension scales `axes` [mm] of an HDF5 file, by name."""
    for name, values in axes.items():
        file[name] = values
        file[name].attrs["unit"] = "mm"
        file[name].make_scale(name)


def create_field(file, name, axes, unit, **dataset):
    """Create a dataset with a unit, and with `axes` as scales of its last dimensions."""
    field = file.create_dataset(name, **dataset)
    field.attrs["unit"] = unit
    for dimension, axis in zip(list(field.dims)[-len(axes) :], axes, strict=True):
        dimension.attach_scale(file[axis])


def reserve(path, size, mode):
    """Reserve disk space for a file; OSError if the disk is full."""
    with path.open(mode) as file:
        os.posix_fallocate(file.fileno(), 0, size)


def _write_rows(path, comm, slabs, rows):
    """Write the fields by MPI-IO or in turn. Collective."""

    def write(**driver):
        with h5py.File(path, "r+", **driver) as file:
            for name, values in rows.items():
                for part in row_blocks(*values.shape, _CELLS_PER_WRITE):
                    start = slabs.rows.start
                    file[name][start + part.start : start + part.stop] = values[part]

    if np.count_nonzero(slabs.counts) == 1:
        _run_collectively(comm, lambda: write() if slabs.local else None)
    elif h5py.get_config().mpi:
        _run_collectively(comm, lambda: write(driver="mpio", comm=comm))
    else:
        for turn in range(comm.size):
            _run_collectively(comm, lambda: write() if turn == comm.rank else None)  # noqa: B023


def _run_collectively(comm, step, only_root=False):
    """Run a function; if it fails, raise OSError on all ranks. Collective.

    Unlike `call_collectively`, this function catches exceptions of all types, and its message names the rank.
    """
    message = None
    try:
        if comm.rank == 0 or not only_root:
            step()
    except Exception as error:
        # Keep no exception: its traceback would keep objects of this rank alive.
        message = format_message(error)
    for rank, text in enumerate(comm.allgather(message)):
        if text is not None:
            raise OSError(text if comm.size == 1 else f"rank {rank}: {text}")
