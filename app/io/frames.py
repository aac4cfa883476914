"""Conversion to pandas and xarray, which are optional packages."""

from importlib import import_module

import numpy as np

from app.base.quantities import QUANTITIES, unit_of

UNITS = {
    **dict.fromkeys(("gap", "displacement", "undeformed_distance", "plastic_depth", "x", "y"), "mm"),
    **dict.fromkeys(("worn_depth", "slip"), "mm"),
    **dict.fromkeys(("pressure", "hardness", "background_pressure", "traction"), "N/mm2"),
    **dict.fromkeys(("contact", "plastic"), "1"),
    "surface_compliance": "mm3/N",
    **dict.fromkeys(("flux_x", "flux_y"), "mm2"),
}
_LONG_NAMES = {
    "pressure": "pressure p",
    "gap": "gap e",
    "displacement": "displacement u",
    "undeformed_distance": "undeformed distance h",
    "contact": "contact",
    "plastic": "cells at the hardness",
    "plastic_depth": "permanent indentation",
}


def _import(package, what):
    try:
        return import_module(package)
    except ImportError:
        raise ImportError(f"{what} needs {package}: pip install {package}", name=package) from None


def to_dataframe(columns, index=None, units=()):
    """Return a pandas.DataFrame with units in ``attrs["units"]``.

    The column `index` numbers the rows. `units` has the units of columns that are not in `app.base.quantities`.
    """
    frame = _import("pandas", "to_dataframe()").DataFrame(dict(columns))
    known = {name: unit_of(name) for name in frame if name.removeprefix("analytic_") in QUANTITIES}
    frame.attrs["units"] = known | {name: unit for name, unit in dict(units).items() if name in frame}
    return frame if index is None else frame.set_index(index)


def to_xarray(result):
    """Return an xarray.Dataset of fields, with units in ``attrs``.

    Numbers and texts are attributes of the Dataset. Fields have the local rows only.
    """
    xarray = _import("xarray", "to_xarray()")
    fields = {name: field for name in _LONG_NAMES if (field := getattr(result, name)) is not None}
    fields |= {name: field for name, field in getattr(result, "extra", {}).items() if np.ndim(field) == 2}
    units = UNITS | getattr(result, "units", {})
    attributes = {name: {"long_name": _LONG_NAMES.get(name, name)} for name in fields}
    for name in fields.keys() & units.keys():
        attributes[name]["units"] = units[name]
    variables = {name: (("y", "x"), field, attributes[name]) for name, field in fields.items()}
    axes = {name: (name, getattr(result, name), {"units": units[name]}) for name in "xy"}
    facts = result.attributes
    facts = facts | {name: int(value) for name, value in facts.items() if isinstance(value, bool)}
    return xarray.Dataset(variables, axes, facts)
