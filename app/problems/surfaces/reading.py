"""Measured surfaces: heights in a file, in their own unit, cropped, with missing points, levelled, filtered.

A height map is read in runs of rows, and each rank keeps its own rows only; what is found in all of it (level, missing
points) every rank finds for itself, in the same order, so that it is the same on any number of ranks.
"""

from __future__ import annotations

from dataclasses import replace
from numbers import Integral

import numpy as np

from app.base.errors import InputError
from app.base.units import UNITS, find_unit, format_lengths
from app.halfspace.grid import validate_symbol
from app.problems.surfaces.filters import check_cells, check_order
from app.problems.surfaces.height_file import (
    TURNS,
    agreed_spacing,
    agreed_units,
    checked_crop,
    cropped,
    open_heights,
    replace_stated,
)
from app.problems.surfaces.measured_surface import Surface
from app.problems.surfaces.moments import LEVELS, Moments

MISSING = ("hole", "fill")
_TILTED = 4.0  # rise of the best plane over the patch in rms heights about it that is worth a note
_NAMED = 4  # rows that a note names


def read_surface(
    path,
    unit=None,
    level="none",
    crop=None,
    missing="hole",
    height_unit=None,
    orient=(),
    skip=0,
    spacing=None,
    s_filter=None,
    l_filter=None,
    periodic=False,
    channel=None,
    override=False,
):
    """Read measured heights.

    Not collective: every rank looks at the whole file, a run of rows after the other.

    Parameters
    ----------
    path : str or Path, or array_like, shape (ny, nx)
        The heights, NaN or masked where a point is missing; or a file of them: ``.npy``, ``.npz`` or ``.h5``
        (``:/dataset``), text with a row of cells a line, or text with points x, y, z of a regular grid in any order.
        Peaks towards the other body are positive; the first row is the one of smallest y. What instruments
        write ``python -m app.convert`` turns into ``.h5``.
    unit : str, optional
        m, cm, mm, um (or µm), nm, pm, angstrom (or Å) or in: of the file; needed where it does not say.
    level : str
        What is taken off: none, mean, plane or quadratic (least squares on the points that are there).
    crop : sequence of int, optional
        i0, i1, j0, j1: columns i0 to i1 - 1 and rows j0 to j1 - 1 only.
    missing : str
        What becomes of missing points (NaN): "hole", contact is impossible there, or "fill" by a harmonic function.
    height_unit : str, optional
        Of the heights alone, where x and y of points are in `unit`.
    orient : sequence of str, or str
        How rows and columns are turned before all else, one after the other: transpose, flip_x, flip_y, or a text of
        these with commas between. Without any an ESRI grid is flipped in y: its rows go from north to south.
    skip : int
        Lines at the head of a text to leave out.
    spacing : pair of float, optional
        Size dx, dy of a cell before it is turned [mm], where the file does not say; else `Surface.grid` needs a domain.
    s_filter, l_filter : float, optional
        Nesting indices (cut-off wavelengths) of Gaussian filters [mm], which come last: waves shorter than `s_filter`
        are taken off as noise, those longer than `l_filter` as waviness. Where only `Surface.grid` knows the spacing,
        `Surface.filtered` does it.
    periodic : bool
        Whether the patch repeats for ever, so that filters go around; `Surface.grid` does then, too.
    channel : str or int, optional
        Name or number, from 0, of a channel of a text that has several, one below the other.
    override : bool
        Whether `unit`, `height_unit` and `spacing` replace what the file states; else a contradiction is refused.

    Returns
    -------
    Surface

    Raises
    ------
    InputError
        If it cannot be read, its unit is not known or not what the file says, the crop lies outside, or a filter does
        not fit to its cells.

    Examples
    --------
    >>> import tempfile
    >>> path = tempfile.mkdtemp() + "/tilted.npy"
    >>> np.save(path, np.cos(np.arange(60.0)) + 3 * np.arange(40.0)[:, None])
    >>> surface = read_surface(path, unit="um", level="plane")
    >>> surface.shape, bool(np.abs(surface.heights()).max() < 2e-3)
    ((40, 60), True)
    >>> surface.grid(domain=(0, 0.6, 0, 0.4)).dx
    0.01
    """
    check_order(s_filter, l_filter)
    periodic = bool(validate_symbol(periodic))
    unit, height_unit = (name and (find_unit(name) or name) for name in (unit, height_unit))
    orient = orient.split(",") if isinstance(orient, str) else tuple(orient or ())
    if not (isinstance(skip, Integral) and skip >= 0):
        raise InputError(f"surface skip {skip!r}: needed: a number of lines, from 0")
    for name, value, allowed in (
        ("level", level, LEVELS),
        ("missing", missing, MISSING),
        ("unit", unit, (*UNITS, None)),
        ("height unit", height_unit, (*UNITS, None)),
        *(("orient", turn, TURNS) for turn in orient),
    ):
        if value not in allowed:
            raise InputError(f"surface {name} {value}: must be one of {', '.join(filter(None, allowed))}")
    try:
        source = open_heights(path, skip, orient, channel, coordinates=crop is not None)
    except (ValueError, OSError) as error:
        raise InputError(str(error)) from None
    if override:
        replace_stated(source, unit, height_unit, spacing, "override=True")
    surface = surface_of(source, unit, level, crop, missing, height_unit, spacing)
    surface = replace(surface, periodic=periodic)
    check_cells(surface.file, s_filter, l_filter, surface.shape, surface.spacing)
    return surface.filtered(surface.grid(), s_filter, l_filter) if surface.spacing else surface


def surface_of(source, unit=None, level="none", crop=None, missing="hole", height_unit=None, spacing=None):
    """Surface of a `HeightFile` or `HeightArray` that is turned already; all else as of `read_surface`.

    Not collective.
    """
    unit, lateral = agreed_units(source, unit, height_unit)
    sides = agreed_spacing(source, lateral, spacing, source.orient)
    crop = checked_crop(source, crop)
    scale = UNITS[unit]
    ny, nx = crop[3] - crop[2], crop[1] - crop[0]
    moments = Moments(source.file, lambda *rows: scale * cropped(source, crop, *rows), (ny, nx))
    holes = nx * ny - int(moments.count)
    notes, filled = [], (np.zeros(0, int),) * 2
    if holes and missing == "fill":
        filled = np.nonzero(np.isnan(cropped(source, crop, 0, ny)))
        notes.append(f"surface file {source.file}: {holes} of {nx * ny} points were missing and are filled")
    elif holes:
        notes.append(
            f"surface file {source.file}: {holes} of {nx * ny} points are missing: cells without any cannot touch; "
            "fill them by missing='fill' (-surface_missing fill)"
        )
    for what, lines, moved in moments.unmeasured():
        first = crop[2] if what == "row" else crop[0]
        numbers = ", ".join(map(str, first + lines[:_NAMED])) + ", ..." * (len(lines) > _NAMED)
        notes.append(
            f"surface file {source.file}: all points in {what}{'s'[: len(lines) != 1]} {numbers} have the lowest "
            f"height, as if they were not measured, which moves the best plane by up to {format_lengths(moved)}; "
            "leave them out by crop= (-surface_crop), or mark them as missing, NaN"
        )
    rise, rms = moments.tilt()
    found = moments.roughness(level)
    height, times, row, column = found["spike"]
    found["spike"] = height, times, crop[2] + row, crop[0] + column
    tilted = level in ("none", "mean")
    if tilted and rise > max(_TILTED * rms, moments.rounding):
        notes.append(
            f"surface file {source.file}: is tilted by {rise:.3g} mm over the patch, its rms height about the best "
            f"plane is {rms:.3g} mm; level it by level='plane' (-surface_level plane) if that is the instrument's"
        )
    return Surface(
        file=source.file,
        unit=unit,
        shape=(ny, nx),
        spacing=sides,
        level=level,
        missing=missing,
        crop=crop,
        orient=source.orient,
        rounding=moments.rounding,
        missing_points=holes,
        notes=tuple(notes),
        _source=source,
        _coefficients=moments.fit(level),
        _tilt=moments.slopes() if tilted else {},
        _filled=filled,
        **found,
    )
