"""Warnings about a measured surface's units and spikes."""

from app.base.units import format_lengths

MAX_SLOPE = 0.5  # rms slope of a body that is nearly a half-space
MIN_MEASURED_SLOPE = 2e-4  # rms slope of measured heights; below heights or spacing may be in another unit
WIDE_CELL, MIN_WIDE_SLOPE = 0.05, 5e-3  # the same for cells wider than this [mm]
MAX_SPIKE = 12.0  # rms steps by which a point may exceed its neighbours; Gaussian noise reaches five


def note_doubtful_units(surface, grid):
    """Return a warning if a measured surface has unusual slopes, else None."""
    slope = surface.rms_slope(grid)
    flat = MIN_WIDE_SLOPE if max(surface.cell(grid)) > WIDE_CELL else MIN_MEASURED_SLOPE
    if slope > MAX_SLOPE:
        what = f"steeper than the theory is for (slopes below {MAX_SLOPE:g}), by spikes, perhaps"
    elif 0 < slope < flat and surface.rms_level > surface.rounding:
        what = "flatter than most surfaces"
    else:
        return None
    what = f"surface file {surface.file}: is {what}"
    return f"{what}; are heights and spacing in the units said? {surface.understood(grid)}"


def note_spike(surface):
    """Return a warning if a measured surface has a spike, else None."""
    height, steps, row, column = surface.spike
    if steps <= MAX_SPIKE or height <= surface.rounding:
        return None
    return (
        f"surface file {surface.file}: has spikes: the point in row {row}, column {column} stands "
        f"{format_lengths(height)} above all beside it, {steps:.0f} times the rms step from cell to cell; they "
        "carry the load: take them out first"
    )
