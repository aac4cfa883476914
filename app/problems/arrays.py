"""Arrays that users give: real numbers, of a lattice, of a size that can be computed with."""

from __future__ import annotations

import numpy as np

from app.base.errors import InputError, format_exact
from app.options.option_table import LARGEST


def real_numbers(what, values, needed="an array of real numbers, or a function of x and y"):
    """Array of float64 in memory of its own; masked entries become NaN. Not collective.

    Raises
    ------
    InputError
        Of texts, complex numbers and None, too, which numpy would turn into real ones.
    """
    try:
        found = np.asanyarray(values)
        if found.dtype.kind in "biufO" and values is not None:
            return np.asarray(np.ma.filled(found.astype(float), np.nan))
    except (TypeError, ValueError):
        pass
    raise InputError(f"{what}: needed: {needed}") from None


def lattice(x, y, origin):
    """Columns x and rows y of a lattice, from an origin, shapes (nx,) and (ny,) [mm]. Not collective.

    Raises
    ------
    InputError
        If they are none, such as those of every point.
    """
    x, y = real_numbers("x", x, "columns of a lattice"), real_numbers("y", y, "rows of a lattice")
    if (x.ndim, y.ndim) != (1, 1):
        shapes = f"shapes {x.shape} and {y.shape}"
        raise InputError(f"x, y: have {shapes}; needed: (nx,) and (ny,), columns and rows of a lattice")
    return x - origin[0], y - origin[1]


def refuse_large(what, values, first_row=0):
    """Refuse numbers that cannot be squared, infinite ones too. Not collective.

    Parameters
    ----------
    what : str
        Of which they are, for the message.
    values : ndarray, shape (rows, nx)
        NaN is allowed.
    first_row : int
        Number of the first one.

    Raises
    ------
    InputError
    """
    large = np.abs(values) > LARGEST
    if large.any():
        j, i = np.argwhere(large)[0]
        raise InputError(
            f"{what}: {format_exact(values[j, i])} in row {j + first_row}, column {i}; allowed: numbers "
            f"up to {LARGEST:g}, and NaN where contact is impossible"
        )
