"""Validation of arrays: real numbers, coordinates of a lattice, limits of size."""

import numpy as np

from app.base.errors import InputError, format_exact
from app.options.option_table import LARGEST


def real_numbers(label, values, needed="an array of real numbers, or a function of x and y"):
    """Return a float64 copy of an array, with NaN for masked entries.

    Raises InputError also for texts, complex numbers and None, which numpy would convert.
    """
    try:
        array = np.asanyarray(values)
        if array.dtype.kind in "biufO" and values is not None:
            return np.asarray(np.ma.filled(array.astype(float), np.nan))
    except (TypeError, ValueError):
        pass
    raise InputError(f"{label}: must be {needed}") from None


def lattice(x, y, origin):
    """Return coordinates x (nx,) and y (ny,) relative to an origin.

    They are the columns and rows of a lattice of points. Raises InputError for other shapes.
    """
    x, y = real_numbers("x", x, "columns of a lattice"), real_numbers("y", y, "rows of a lattice")
    if (x.ndim, y.ndim) != (1, 1):
        shapes = f"shapes {x.shape} and {y.shape}"
        raise InputError(f"x, y: have {shapes}; must be (nx,) and (ny,), columns and rows of a lattice")
    return x - origin[0], y - origin[1]


def check_size(label, values, first_row=0):
    """Raise InputError for numbers above `LARGEST`, whose products may overflow.

    The number of the `first_row` is needed for the message.
    """
    large = np.abs(values) > LARGEST
    if large.any():
        j, i = np.argwhere(large)[0]
        raise InputError(
            f"{label}: {format_exact(values[j, i])} in row {j + first_row}, column {i}; must be numbers "
            f"up to {LARGEST:g}, and NaN where contact is impossible"
        )


def is_measured(surface):
    """Return whether a surface was measured, and so read from a file."""
    return getattr(surface, "measured", False)
