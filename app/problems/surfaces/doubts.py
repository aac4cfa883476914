"""Warnings about a measured surface's units and spikes."""

from app.base.units import format_lengths

MAX_SLOPE = 0.5  # rms slope of a body that is nearly a half-space
MIN_MEASURED_SLOPE = 2e-4  # rms slope of measured heights; below heights or spacing may be in another unit
WIDE_CELL, MIN_WIDE_SLOPE = 0.05, 5e-3  # the same for cells wider than this [mm]
MAX_SPIKE = 12.0  # rms steps by which a point may exceed its neighbours; Gaussian noise reaches five


def note_doubtful_units(surface, grid):
    """Return a warning if a measured surface has unusual slopes."""
    slope = surface.rms_slope(grid)
    flat = MIN_WIDE_SLOPE if max(surface.cell(grid)) > WIDE_CELL else MIN_MEASURED_SLOPE
    if slope > MAX_SLOPE:
        what = f"is steeper than the theory allows (slopes below {MAX_SLOPE:g}), perhaps because of spikes"
    elif 0 < slope < flat and surface.rms_level > surface.rounding:
        what = "is flatter than most surfaces"
    else:
        return []
    doubt = f"surface file {surface.file}: {what}; are the units right?"
    return [f"{doubt} It was read as {surface.understood(grid)}"]


def note_spike(surface):
    """Return a warning if a measured surface has a spike."""
    height, steps, row, column = surface.spike
    if steps <= MAX_SPIKE or height <= surface.rounding:
        return []
    return [
        f"surface file {surface.file}: has spikes: the point in row {row}, column {column} is {format_lengths(height)} "
        f"above its highest neighbour, {steps:.0f} times the rms step from cell to cell; spikes carry the load: remove "
        "them first"
    ]


def note_doubts(surface, grid):
    """Return all warnings about a measured surface."""
    return note_doubtful_units(surface, grid) + note_spike(surface)
