"""Loadings that users can prescribe, by name, and checks of their numbers."""

import numpy as np

from app.base.errors import InputError, format_exact, is_number, plain_number
from app.base.units import to_length
from app.contact.loading import PrescribedApproach
from app.contact.prescribed_load import PrescribedLoad, PrescribedMeanPressure
from app.contact.prescribed_mean_gap import PrescribedMeanGap
from app.options.option_table import LARGEST

# Name -> class. Every interface reads the loadings from here, also those that a user has added.
LOADINGS = {
    loading.name: loading
    for loading in (PrescribedApproach, PrescribedLoad, PrescribedMeanPressure, PrescribedMeanGap)
}
USAGE = f"load=700), or {', '.join(f'{name}=' for name in LOADINGS if name != 'load')}"


def single_loading(given, where=""):
    """Return the prescribed quantity, if exactly one is given; raise TypeError for an unknown one."""
    unknown = [name for name in given if name not in LOADINGS]
    given = {name: value for name, value in given.items() if value is not None}
    if len(given) != 1 or unknown:
        *others, last = (f"{name} [{loading.unit}]" for name, loading in LOADINGS.items())
        needed = f"exactly one of {', '.join(others)} and {last} is needed"
        if unknown:
            raise TypeError(f"{where}unexpected argument {unknown[0]!r}; {needed}")
        raise InputError(where + needed)
    return given.popitem()


def make_loading(grid, distance, uniform_compliance=0.0, **given):
    """Make the `Loading` for one prescribed number.

    `grid` is the target grid, and `distance` its undeformed distance. In `given` exactly one of `LOADINGS` is not None.
    Bodies with a `uniform_compliance` [mm3/N] are layers on a rigid base. Raises InputError if not exactly one number
    is given, or the number is not allowed.
    """
    name, number = single_loading(given)
    number = validate_number(name, number)
    LOADINGS[name].check_grid(grid)
    return LOADINGS[name].create(number, grid, distance, uniform_compliance)


def validate_number(name, number):
    """Return a loading's prescribed number as a float.

    Raises InputError if it is no real number, too large or too small, or not allowed on any patch.
    """
    number, loading = plain_number(number), LOADINGS[name]
    if isinstance(number, str) and loading.unit == "mm":
        number = to_length(name, number)
    if not is_number(number):
        kind = type(number).__name__
        is_sequence = hasattr(number, "__len__") and getattr(number, "shape", None) != ()  # () if masked
        if is_sequence and not isinstance(number, str | bytes):
            what = f"{name}: {kind} of {len(number)}"
            raise InputError(f"{what}; must be a number; ContactSolver.path takes many")
        raise InputError(f"{name}: is {kind}; must be a number [{loading.unit}]")
    try:
        value = float(number)
    except OverflowError:
        value = np.inf
    if not (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
        allowed = f"must be a number of size {1 / LARGEST:g} to {LARGEST:g}, or 0"
        raise InputError(f"{name} {format_exact(value)}: {allowed}")
    if value < loading.least:
        raise InputError(
            f"{name} {format_exact(value)}: must be at least {format_exact(loading.least)} {loading.unit}"
        )
    return value
