"""Result file (HDF5): solution, history, attributes; docs/results.md lists all of them.

Datasets of the cells have shape (ny, nx). `x` and `y`, the cell centres, are their dimension scales, as in NetCDF, so
xarray finds the coordinates. `gap` and `undeformed_distance` are NaN in inadmissible cells (contact impossible). The
groups ``history`` and ``path`` have columns, with an entry per active set iteration, and per step of a load path.
``history/level`` has the number of a grid in the hierarchy: the last entry is the target grid's number, and the next
coarser grid has one less. A file may have additional datasets and attributes.
"""

import os
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.base import hdf5 as h5py
from app.base.errors import InputError, check_type, format_message
from app.base.memory import check_fits
from app.base.quantities import QUANTITIES
from app.base.types import Floats, Mask, PathLike
from app.halfspace.grid import Grid
from app.io.contact_fields import ContactFields

FIELDS = {
    "pressure": np.float64,
    "gap": np.float64,
    "displacement": np.float64,
    "undeformed_distance": np.float64,
    "contact": np.uint8,
}
PLASTIC_FIELDS = {"plastic": np.uint8, "plastic_depth": np.float64}  # only with a hardness
AXES = {"x": np.float64, "y": np.float64}
HISTORY = {
    "level": np.int64,
    "contact_cells": np.int64,
    "changed_cells": np.int64,
    "residual": np.float64,
    "inner_iterations": np.int64,
    "work_units": np.float64,
}
ATTRIBUTES = (
    "converged", "reason", "active_set_iterations", "work_units", "operator_applications", "inner_iterations",
    "residual", "load", "approach", "max_pressure", "contact_cells", "contact_fraction", "solve_seconds",
    "setup_seconds", "ranks", "options", "command_line", "version",
)  # fmt: skip
TEXTS = ("reason", "options", "command_line", "version", "notes", "problem", "periodic_symbol")
NUMBERS = (  # optional, like those of the table of quantities
    "error_bound", "discretisation_error", "poisson_ratio", "periodic", "largest_penetration", "smallest_pressure",
    "lcp_rtol", "shear_modulus", "hertz_rx", "hertz_ry", "surface_hurst", "surface_rolloff", "surface_cutoff",
    "load_error", "approach_error", "max_pressure_error", "contact_area_error",
)  # fmt: skip
_COMMON_NAMES = ("time",)  # users may have saved other values by these names
PAIRS = ("young", "poisson", "cell_size")
MIN_CELL = 1e-60  # mm, and 1 / MIN_CELL the largest: powers of cell sizes must not overflow
MAX_STEP_DEVIATION = 0.1  # of a cell: rounding of coordinates far from zero


@dataclass(frozen=True, eq=False, repr=False)
class Result(ContactFields):
    """Contents of a result file, see docs/results.md.

    Attributes of the file are attributes of this object, too: ``result.load`` is ``result.attributes["load"]``. The
    names that `Solution` has for some of them (``message``, ``iterations``, ``rtol``) also work.

    Attributes
    ----------
    pressure, gap, displacement, undeformed_distance : ndarray of float64, shape (ny, nx)
    contact : ndarray of bool, shape (ny, nx)
    x, y : ndarray of float64, shapes (nx,) and (ny,)
    attributes : dict
        Root attributes as Python bool, int, float, str or list.
    history : dict of str to ndarray, shape (k,)
    extra : dict of str to ndarray
        Other datasets in the root of the file.
    units : dict of str to str
        Unit of each dataset that has one.
    path : dict of str to ndarray, shape (steps,)
        Table of a load path; empty for a single loading.
    plastic, plastic_depth : ndarray of bool and of float64, shape (ny, nx), or None
        Cells at the hardness, and permanent indentation; None without a hardness.
    """

    pressure: Floats
    gap: Floats
    displacement: Floats
    undeformed_distance: Floats
    contact: Mask
    x: Floats
    y: Floats
    attributes: dict[str, Any]
    history: dict[str, np.ndarray]
    extra: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    path: dict[str, np.ndarray] = field(default_factory=dict)
    plastic: Mask | None = None
    plastic_depth: Floats | None = None

    slabs = comm = None  # this rank has all rows

    @property
    def error_bound(self) -> float:
        """Proved bound of the relative error of the pressure, NaN if unknown."""
        return self.attributes.get("error_bound", np.nan)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about units, grid or theory, one text each."""
        return tuple(self.attributes.get("notes", "").splitlines())

    @property
    def grid(self) -> Grid:
        """`Grid` of the result's cells."""
        return make_grid(self.x, self.y, self.attributes)


def make_grid(x, y, attributes):
    """Make a `Grid` from cell centres [mm] and attributes of a result.

    In a direction with a single cell, the attribute `cell_size` has the size of the cell.
    """
    domain = []
    for centres, size in zip((x, y), attributes.get("cell_size", (1.0, 1.0)), strict=True):
        half = (np.ptp(centres) / (centres.size - 1) if centres.size > 1 else size) / 2
        domain += [centres[0] - half, centres[-1] + half]
    periodic = attributes.get("periodic_symbol") or attributes.get("periodic")
    return Grid.from_domain(x.size, y.size, domain, periodic if isinstance(periodic, str) else "")


def read_result(path: PathLike) -> Result:
    """Read a result file, with all rows.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the file is missing or no result file; the message says what is wrong.
    """
    with open_result(path) as file:
        check_is_result(file)
        if missing := [name for name in ATTRIBUTES if name not in file.attrs]:
            raise InputError(f"attribute {', '.join(missing)} is missing")
        sizes = []
        file.visititems(lambda name, item: sizes.append(float(getattr(item, "nbytes", None) or 0)))
        check_fits(sum(sizes), "what it holds")  # a few bytes may stand for many
        types = FIELDS | {name: dtype for name, dtype in PLASTIC_FIELDS.items() if name in file}
        data = {name: read_dataset(file, name, dtype) for name, dtype in (types | AXES).items()}
        shape = data["y"].size, data["x"].size
        for name in types:
            if data[name].shape != shape:
                raise InputError(f"dataset {name}: shape {data[name].shape}, but y and x say {shape}")
        for name in (name for name, dtype in types.items() if dtype is np.uint8):
            if data[name].max() > 1:
                raise InputError(f"dataset {name}: has other values than 0 and 1")
            data[name] = data[name].view(bool)
        history = {name: read_dataset(file, f"history/{name}", dtype) for name, dtype in HISTORY.items()}
        history |= _read_columns(file, "history", history)
        others = {name: item for name, item in file.items() if name not in data}
        extra = {name: item[()] for name, item in others.items() if isinstance(item, h5py.Dataset)}
        units = {name: file[name].attrs.get("unit") for name in (*data, *extra)}
        units = {name: str(unit) for name, unit in units.items() if unit is not None}
        attributes, path = read_attributes(file), _read_columns(file, "path")
        if path and not np.size(path.get("load", ())):
            raise InputError("path: has no loads")
        if "converged" in path:
            path["converged"] = path["converged"] != 0
        return Result(**data, attributes=attributes, history=history, extra=extra, units=units, path=path)


@contextmanager
def open_result(path):
    """Open a result file for a ``with`` block.

    Raises InputError if the file is unreadable.
    """
    check_type("result file", path, str | os.PathLike, "a path")
    path = Path(path)
    if not path.is_file():
        raise InputError(f"result file {path}: {'not a file' if path.exists() else 'no such file'}")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except ValueError as error:
        raise InputError(f"result file {path}: {format_message(error)}") from error
    except TypeError as error:
        if "No NumPy equivalent" not in str(error):  # a data type of the file
            raise
        raise InputError(f"result file {path}: {format_message(error)}") from error
    except (OSError, RuntimeError, KeyError) as error:  # the last two for broken and circular links
        raise InputError(f"result file {path}: not a readable HDF5 file ({format_message(error)})") from error


def has_heights(path):
    """Return whether a file has a map of heights, written by app.convert."""
    with open_result(path) as file:
        return "heights" in file and not FIELDS.keys() & file.keys()


def check_is_result(file):
    """Raise InputError if an open file lacks the fields of a result."""
    if isinstance(file.get("table"), h5py.Group):
        raise InputError("fields and table of app.solve_many, no result; h5py reads them")
    if FIELDS.keys() & file.keys():
        return
    if "depth" in file and "line/von_mises" in file:
        raise InputError(
            "stresses that app.subsurface wrote, no result; python -m app.subsurface RESULT.h5 -o DIR draws them, "
            "DIR/subsurface.png"
        )
    if "heights" in file:
        raise InputError("heights of a surface, no result; python -m app.plot draws them")
    raise InputError("no result of app.solve: it has none of the datasets " + ", ".join(FIELDS))


def _read_columns(file, group, known=()):
    """Return the columns of a group by name, except the `known` ones.

    InputError if columns differ in length from each other or from the known ones.
    """
    if group not in file:
        return {}
    names = list(file[group]) if isinstance(file[group], h5py.Group) else [""]
    columns = {name: read_dataset(file, f"{group}/{name}") for name in names if name not in known}
    shapes = {column.shape for column in (*columns.values(), *dict(known).values())}
    if len(shapes) > 1 or any(len(shape) != 1 for shape in shapes):
        raise InputError(f"{group}: columns of shapes {sorted(shapes)}")
    return columns


def read_dataset(file, name, dtype=None):
    """Read a numeric dataset; InputError if not numeric.

    Numbers are converted to `dtype`, by default the dtype of the dataset.
    """
    item = file.get(name)
    if not isinstance(item, h5py.Dataset):
        raise InputError(f"dataset {name} is missing")
    if item.shape is None or item.dtype.kind not in "biuf":
        raise InputError(f"dataset {name}: type {item.dtype}, shape {item.shape} where numbers are needed")
    if name in AXES and (item.ndim != 1 or not item.size):
        raise InputError(f"dataset {name}: shape {item.shape} where one of cell centres is needed")
    check_fits(float(item.nbytes), f"dataset {name}")
    dtype = np.dtype(dtype or item.dtype)
    if not np.can_cast(item.dtype, dtype, "same_kind"):
        raise InputError(f"dataset {name}: type {item.dtype} where {dtype} is needed")
    values = item[()].astype(dtype, copy=False)
    if name in AXES and not _are_centres(values):
        raise InputError(f"dataset {name}: needed: finite cell centres [mm] that rise in equal steps")
    return values


def _are_centres(values):
    if values.size == 1:
        return np.isfinite(values[0])
    with np.errstate(invalid="ignore", over="ignore"):
        step = (values[-1] - values[0]) / (values.size - 1)
        deviation = np.abs(np.diff(values) - step).max()
        return MIN_CELL < step < 1 / MIN_CELL and deviation < MAX_STEP_DEVIATION * step


def read_attributes(file):
    """Return a file's attributes as Python objects, by name.

    Raises InputError if an attribute has a wrong type.
    """
    attributes = {}
    for name, value in file.attrs.items():
        plain = attributes[name] = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        is_pair = np.shape(value) == (2,) and np.asarray(value).dtype.kind in "iuf"
        if name in PAIRS and not is_pair:
            raise InputError(f"attribute {name}: {plain!r} where two numbers are needed")
        if name in TEXTS and not isinstance(plain, str):
            raise InputError(f"attribute {name}: {plain!r} where a text is needed")
        is_number = name not in (*TEXTS, *_COMMON_NAMES) and name in (*NUMBERS, *ATTRIBUTES, *QUANTITIES)
        if name == "periodic" and plain in ("x", "y"):
            continue
        if is_number and not isinstance(plain, bool | int | float):
            raise InputError(f"attribute {name}: {plain!r} where a number is needed")
    return attributes


def find_poisson_ratio(facts, body=None):
    """Return a body's Poisson ratio from attributes of a result, or None.

    The ratio of a coated body is None, because its stresses depend on two.
    """
    _check_body(body)
    coatings = _count_coatings(facts)
    if (body or 1) <= coatings:
        return None
    if coatings and np.isinf(np.atleast_1d(facts["young"])[1]):
        raise InputError("body 2: is rigid, and has no stress")
    each = np.atleast_1d(facts["poisson"]) if "poisson" in facts else ()
    if len(each) == 2:
        if body is None:
            young = np.atleast_1d(facts.get("young", (1.0, 1.0)))
            body = 1 if np.isfinite(young[0]) else 2
        return float(each[body - 1])
    if body is not None:
        raise InputError(f"body {body}: the material of the pair was given, not those of the bodies")
    return facts.get("poisson_ratio")


def find_layer(facts, body=None):
    """Return the `Layer` of a body from a result's attributes, or None.

    The default is the first body.
    """
    _check_body(body)
    number = (body or 1) - 1
    if number >= _count_coatings(facts):
        return None
    # Imported late, so that pictures of other results do not load numba.
    from app.halfspace.material import Material

    names = "coating_young", "coating_poisson", "coating_thickness", "young", "poisson"
    if missing := [name for name in names if name not in facts]:
        raise InputError(
            f"attribute {', '.join(missing)}: is missing; a coated body needs {', '.join(names)}"
        )
    young, ratio, thickness, base, base_ratio = (np.atleast_1d(facts[name])[number] for name in names)
    return Material.coated((young, base), (ratio, base_ratio), thickness).coatings[0]


def _check_body(body):
    if body not in (None, 1, 2):
        raise InputError(f"body {body!r}: allowed: 1, 2")


def _count_coatings(facts):
    return np.size(facts.get("coating_thickness", ()))
