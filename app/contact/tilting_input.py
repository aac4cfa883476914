"""Tilts that users can prescribe, or let moments find, and checks of their numbers."""

import numpy as np

from app.base.errors import InputError, is_number, plain_number
from app.base.units import to_length
from app.contact.loading_input import make_loading, single_loading
from app.contact.tilt import NO_TILT, Tilt
from app.options.option_table import LARGEST

# Name -> unit and meaning of two numbers. At most one of them is given, together with a loading.
TILTING = {
    "load_centre": ("mm", "x and y of the centre of the load, under which the bodies tilt"),
    "moment": ("N mm", "first moments of the load, the integrals of p x and p y"),
    "tilt": ("1", "prescribed slopes in x and y, by which the undeformed distance is reduced"),
}


def split_tilting(given, where=""):
    """Return the numbers in `TILTING` that are given, at most one pair, and the other arguments."""
    tilting = {name: value for name, value in given.items() if name in TILTING and value is not None}
    if len(tilting) > 1:
        raise InputError(f"{where}{' and '.join(tilting)}: at most one of them is allowed")
    for name, pair in tilting.items():
        pair = [plain_number(value) for value in pair] if np.shape(pair) == (2,) else []
        texts = TILTING[name][0] == "mm"  # which may have units
        numbers = [to_length(name, value) if texts and isinstance(value, str) else value for value in pair]
        if not numbers or not all(is_number(value) and abs(value) <= LARGEST for value in numbers):
            raise InputError(f"{where}{name}: must be two numbers, for x and y [{TILTING[name][0]}]")
        tilting[name] = tuple(map(float, numbers))
    return tilting, {name: value for name, value in given.items() if name not in TILTING}


def single_path(given):
    """Return the prescribed quantity of a load path, its values, and the numbers in `TILTING`."""
    tilting, given = split_tilting(given, "path: ")
    return *single_loading(given, "path: "), tilting


def create_loading(levels, uniform_compliance, comm, given, whole=True):
    """Turn the bodies on all levels as prescribed; return the `Loading`. Collective over `comm`.

    `levels` are the undeformed distances, `given` the arguments of a solve: one of `LOADINGS`, and at most one of
    `TILTING`. If not `whole`, the loading is that of a part of the pressure, whose centre is unknown. Raises InputError
    if a number is not allowed.
    """
    target, (tilting, given) = levels[-1], split_tilting(given)
    grid, tilt = target.patch, Tilt(*tilting.get("tilt", NO_TILT)) if tilting else None
    for name, pair in tilting.items():
        for repeats, slope, axis in zip(grid.repeats[::-1], pair, "xy", strict=True):
            if repeats and (slope or name != "tilt"):
                raise InputError(f"{name}: on a patch that repeats in {axis}, bodies cannot tilt in {axis}")
    from app.contact.distance import tilt_levels  # here, for a help text without PETSc
    from app.contact.tilted_load import TiltedLoad

    tilt_levels(levels, tilt, comm)
    loading = make_loading(grid, target, uniform_compliance, **given)
    loading.tilt = target.tilt if tilting else NO_TILT
    for name, (x, y) in tilting.items():
        if name != "tilt":
            if not whole:
                raise InputError(f"{name}: not with a background pressure; prescribe the tilt instead")
            if loading.load is None:
                raise InputError(f"{name}: needs a prescribed load above 0")
            centre = (x / loading.load, y / loading.load) if name == "moment" else (x, y)
            loading = TiltedLoad.about(loading, centre, target, comm)
    return loading
