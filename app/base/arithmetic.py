"""numpy's handling of overflow, underflow and NaN."""

from functools import wraps
from typing import TypeVar

import numpy as np


def default_arithmetic():
    """Return a context with numpy's defaults, whatever the user's program has set.

    In many formulas of this program small terms underflow to zero, as they should. After ``np.seterr(all="raise")``
    they would raise errors.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")


_Function = TypeVar("_Function")


def in_default_arithmetic(function: _Function) -> _Function:
    """Decorate a function to run in `default_arithmetic`."""

    @wraps(function)
    def wrapper(*args, **kwargs):
        with default_arithmetic():
            return function(*args, **kwargs)

    return wrapper
