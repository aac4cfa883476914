"""Construction of loadings from numbers of the user, and checks of these."""

from math import ulp

import numpy as np

from app.base.errors import InputError, format_exact, is_number, plain_number
from app.base.units import to_length
from app.contact.full_plasticity import LOAD_ROUNDING
from app.contact.loading import PrescribedApproach, PrescribedMeanGap
from app.contact.prescribed_load import PrescribedLoad
from app.options.option_table import LARGEST

LOADINGS = {"approach": "mm", "load": "N", "mean_pressure": "N/mm2", "mean_gap": "mm"}
_FULL_CONTACT_ROUNDING = 1e-12  # relative rounding error of the approach of full contact
_ROUNDING_ULPS = 4  # rounding error of numbers that users compute, in units in the last place


def single_loading(given, where=""):
    """Return the prescribed quantity, if exactly one is given; raise TypeError for an unknown one."""
    unknown = [kind for kind in given if kind not in LOADINGS]
    given = {kind: value for kind, value in given.items() if value is not None}
    if len(given) != 1 or unknown:
        *others, last = (f"{kind} [{unit}]" for kind, unit in LOADINGS.items())
        needed = f"exactly one of {', '.join(others)} and {last} is needed"
        if unknown:
            raise TypeError(f"{where}unexpected argument {unknown[0]!r}; {needed}")
        raise InputError(where + needed)
    return given.popitem()


def make_loading(grid, distance, uniform_compliance=0.0, **given):
    """Make the `Loading` for one prescribed number.

    `grid` is the target grid, and `distance` its undeformed distance. In `given` exactly one of `LOADINGS` is not None:
    approach or mean gap [mm], load [N], or mean pressure [N/mm2], the load divided by the area of the patch. If the
    bodies have a `uniform_compliance`, approaches beyond full contact are allowed. Raises InputError if not exactly one
    number is given, or the number is not allowed.
    """
    kind, number = single_loading(given)
    value = validate_number(kind, number)
    if kind in ("load", "mean_pressure"):
        if not value:  # the approach is not unique: first touch is chosen
            return PrescribedApproach(distance.approach_at(distance.touching), distance.touching)
        to_load = 1.0 if kind == "load" else grid.area
        if value * to_load > (1 + LOAD_ROUNDING) * (largest := distance.bounds.largest_load):
            limit = (
                f"{format_exact(largest / to_load)} {LOADINGS[kind]}, which all cells carry at their hardness"
            )
            raise InputError(f"{kind} {format_exact(value)}: must be at most {limit}")
        return PrescribedLoad(value * to_load, value / grid.area if kind == "load" else value)
    # On a periodic patch displacements have no mean: mean(gap) = mean(undeformed distance) - approach.
    holes = grid.n - distance.statistics.cells
    mean, reference = distance.statistics.mean, distance.reference
    full = distance.approach_at(mean)
    rounding = _FULL_CONTACT_ROUNDING * (abs(full) + distance.deviation)
    if kind == "mean_gap":
        _check_mean_gap(value, distance, grid, holes, rounding)
        # Plastic cells overlap: the mean of e is negative by more than the rounding of the approach.
        overlaps = distance.max_depth == np.inf and -value > _ROUNDING_ULPS * ulp(
            max(abs(full), abs(reference))
        )
        value = value if overlaps else max(value, 0.0)
        # Without the reference, which would cost digits.
        depth = (mean - value) + distance.statistics.mean_rest
        depth = _without_rounding(depth, mean, distance, np.inf)
        return PrescribedMeanGap(distance, depth, value)
    if uniform_compliance and distance.bounds.capped:
        what, advice = f"approach {format_exact(value)}", "use load, mean_pressure or mean_gap"
        raise InputError(f"{what}: not for a layer on a rigid base with a hardness; {advice}")
    if not grid.doubly_periodic or uniform_compliance:
        return PrescribedApproach(value)
    size = max(abs(value), abs(reference))
    if distance.max_depth == np.inf and not holes and value - full > _ROUNDING_ULPS * ulp(size):
        if not distance.depth_rounding(value - reference):
            return PrescribedApproach(value)
        return PrescribedApproach(value, _without_rounding(value - reference, size, distance, np.inf))
    if value - full > rounding and not holes:
        limit = f"it must be at most {full!r} mm, full contact"
        what = f"approach {format_exact(value)}: the mean gap of this periodic patch would be negative"
        raise InputError(f"{what}; {limit}")
    value, mean = (value, np.inf) if holes else (min(value, full), mean)
    return PrescribedApproach(value, _without_rounding(value - reference, size, distance, mean))


def _without_rounding(depth, size, distance, full):
    """Round a depth to first touch, full contact or full plasticity if close.

    `full` is the depth of full contact, infinite if plastic cells may overlap. A depth is close to these depths if it
    differs only by the rounding of numbers as large as `size`, from which it was computed. Then pressures or gaps would
    have no correct digits.
    """
    rounding, touching = _ROUNDING_ULPS * ulp(size), distance.touching
    if full - depth <= rounding:
        return full
    if 0 < distance.plastic_depth - depth <= rounding:
        return distance.plastic_depth
    return touching if 0 < depth - touching <= rounding else depth


def validate_number(kind, number):
    """Return a loading's prescribed number as a float.

    Raises InputError if it is no real number, too large or too small, or a negative load.
    """
    number = plain_number(number)
    if isinstance(number, str) and LOADINGS[kind] == "mm":
        number = to_length(kind, number)
    if not is_number(number):
        name = type(number).__name__
        is_sequence = hasattr(number, "__len__") and getattr(number, "shape", None) != ()  # () if masked
        if is_sequence and not isinstance(number, str | bytes):
            what = f"{kind}: {name} of {len(number)}"
            raise InputError(f"{what}; must be a number; ContactSolver.path takes many")
        raise InputError(f"{kind}: is {name}; must be a number [{LOADINGS[kind]}]")
    try:
        value = float(number)
    except OverflowError:
        value = np.inf
    if not (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
        allowed = f"must be a number of size {1 / LARGEST:g} to {LARGEST:g}, or 0"
        raise InputError(f"{kind} {format_exact(value)}: {allowed}")
    if value < 0 and kind in ("load", "mean_pressure"):
        limit = f"it must be at least 0 {LOADINGS[kind]}"
        raise InputError(f"{kind} {format_exact(value)}: the bodies do not stick together; {limit}")
    return value


def _check_mean_gap(value, distance, grid, holes, rounding):
    """Raise InputError if a mean gap cannot be prescribed.

    The mean gap determines the approach only on a patch periodic in x and y without holes. It must not be negative
    unless a hardness lets plastic cells overlap.
    """
    text, others = f"mean_gap {format_exact(value)}", "use approach, load or mean_pressure"
    doubt = f"contact is impossible in {holes} cells (NaN), whose gap is unknown" if holes else ""
    if not grid.doubly_periodic:
        doubt = "only on a periodic patch, in x and y, does it determine the approach"
    if doubt:
        raise InputError(f"{text}: {doubt}; {others}")
    if value < -rounding and distance.max_depth < np.inf:
        limit = "it must be at least 0 mm without a hardness"
        raise InputError(f"{text}: the bodies do not penetrate each other; {limit}")
