"""Checks of arrays: real numbers, coordinates of a lattice, limits of size."""

import numpy as np

from app.base.errors import InputError, format_exact
from app.options.option_table import LARGEST


def real_numbers(label, values, needed="an array of real numbers, or a function of x and y"):
    """Return a float64 copy of an array, with NaN for masked entries.

    Raises InputError for anything not real, also for texts, complex numbers, booleans and None, which numpy would
    convert.
    """
    try:
        array = np.asanyarray(values)
        if array.dtype.kind in "iufO" and values is not None:
            return np.asarray(np.ma.filled(array.astype(float), np.nan))
    except (TypeError, ValueError):
        pass
    raise InputError(f"{label}: must be {needed}") from None


def share_or_copy(label, values):
    """Return what `real_numbers` returns; a read-only float64 array is not copied."""
    part = values if isinstance(values, np.ndarray) and values.dtype == float else None
    if part is None or np.ma.isMaskedArray(part):
        return real_numbers(label, values)
    while isinstance(part, np.ndarray) and not part.flags.writeable:
        part = part.base
    return real_numbers(label, values) if isinstance(part, np.ndarray) else np.asarray(values)


def lattice(x, y, origin):
    """Return coordinates x (nx,) and y (ny,) relative to an origin.

    x belongs to the columns and y to the rows of a lattice of points. Raises InputError unless x has the shape (nx,)
    and y the shape (ny,).
    """
    x, y = real_numbers("x", x, "columns of a lattice"), real_numbers("y", y, "rows of a lattice")
    if (x.ndim, y.ndim) != (1, 1):
        shapes = f"shapes {x.shape} and {y.shape}"
        raise InputError(f"x, y: have {shapes}; must be (nx,) and (ny,), columns and rows of a lattice")
    return x - origin[0], y - origin[1]


def check_size(label, values, first_row=0):
    """Raise InputError for numbers above `LARGEST`, whose products may overflow.

    `first_row` is the number of the first row of `values`; the message contains the number of a row.
    """
    low, high = (reduce(values, axis=None, initial=0.0) for reduce in (np.fmin.reduce, np.fmax.reduce))
    if max(-low, high) > LARGEST:
        j, i = np.argwhere(np.abs(values) > LARGEST)[0]
        raise InputError(
            f"{label}: {format_exact(values[j, i])} in row {j + first_row}, column {i}; must be numbers "
            f"up to {LARGEST:g}, and NaN where contact is impossible"
        )


def check_shape(label, shape, grid):
    """Raise InputError unless an array has the shape of a grid."""
    if shape != grid.shape:
        raise InputError(f"{label}: has shape {shape}; the grid needs (ny, nx) = {grid.shape}")


def check_hardness(hardness, grid, label="hardness"):
    """Return a checked hardness: None, number, or array.

    Raises InputError unless all values are positive. Values may be infinite; the result is None if all are infinite.
    """
    if hardness is None:
        return None
    values = real_numbers(label, hardness, "a positive number, or an array of them [N/mm2]")
    if values.ndim:
        check_shape(label, values.shape, grid)
    allowed = (values >= 1 / LARGEST) & ((values <= LARGEST) | (values == np.inf))
    limits = f"above 0 N/mm2, {1 / LARGEST:g} to {LARGEST:g}, or inf (elastic)"
    _check_values(label, values, allowed, limits)
    if np.isinf(values).all():
        return None
    return values if values.ndim else float(values)


def check_background(pressure, hardness, grid, label="background_pressure"):
    """Return a checked background pressure: None, number, or array.

    Raises InputError unless all values are at least 0 and below the hardness. The result is None if all are 0.
    """
    if pressure is None:
        return None
    values = real_numbers(label, pressure, "a number from 0, or an array of them [N/mm2]")
    if values.ndim:
        check_shape(label, values.shape, grid)
    allowed = (values == 0) | ((values >= 1 / LARGEST) & (values <= LARGEST))
    _check_values(label, values, allowed, f"0, or {1 / LARGEST:g} to {LARGEST:g} N/mm2")
    if hardness is not None:
        values, hardness = np.broadcast_arrays(values, hardness) if np.ndim(hardness) else (values, hardness)
        _check_values(label, values, values < hardness, "below the hardness")
    if not values.any():
        return None
    return values if values.ndim else float(values)


def check_compliance(compliance, grid, label="surface_compliance"):
    """Return a checked surface compliance: a number, or an array if it varies.

    Raises InputError unless all values are at least 0.
    """
    values = real_numbers(label, compliance, "a number from 0, or an array of them [mm/(N/mm2)]")
    if values.ndim:
        check_shape(label, values.shape, grid)
    allowed = (values == 0) | ((values >= 1 / LARGEST) & (values <= LARGEST))
    _check_values(label, values, allowed, f"0, or {1 / LARGEST:g} to {LARGEST:g} mm/(N/mm2)")
    return values if np.ptp(values) else float(values.flat[0])


def _check_values(label, values, allowed, limits):
    """Raise InputError for the first value that is not allowed."""
    if not allowed.all():
        where = np.argwhere(~allowed)[0].tolist()
        place = f" in row {where[0]}, column {where[1]}" if where else ""
        raise InputError(f"{label}: {format_exact(float(values[tuple(where)]))}{place}; must be {limits}")


def is_measured(surface):
    """Return whether a surface was measured, and so read from a file."""
    return getattr(surface, "measured", False)
