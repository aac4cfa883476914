"""Reading of measured surfaces.

Heights are read a few rows at a time. Each rank stores only its own rows. Each rank computes the level and the missing
points from all heights, in the same order, so that both are the same on any number of ranks.
"""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral

import numpy as np

from app.base.errors import InputError, is_number, warn_notes
from app.base.types import ArrayLike, PathLike
from app.base.units import UNITS, find_unit, format_lengths
from app.base.usage import usage
from app.halfspace.grid import validate_periodic
from app.problems.surfaces.doubts import note_doubts
from app.problems.surfaces.filters import check_cells, check_order
from app.problems.surfaces.height_map import TURNS, open_heights
from app.problems.surfaces.measured_surface import Surface
from app.problems.surfaces.moments import LEVELS, Moments

MISSING = ("hole", "fill")
MIN_NOTED_TILT = 4.0  # rise of the best plane over the patch, in rms heights about it
MAX_NOTED_ROWS = 4


@usage('read_surface("heights.npy", unit="um", spacing=(0.5, 0.5), spacing_unit="um")')
def read_surface(
    path: PathLike | ArrayLike,
    unit: str | None = None,
    level: str = "none",
    crop: Sequence[int] | None = None,
    missing: str = "hole",
    height_unit: str | None = None,
    orient: str | Sequence[str] = (),
    skip: int = 0,
    spacing: float | Sequence[float] | None = None,
    s_filter: float | None = None,
    l_filter: float | None = None,
    periodic: bool | str = False,
    channel: str | int | None = None,
    override: bool = False,
    spacing_unit: str | None = None,
) -> Surface:
    """Read measured heights.

    Parameters
    ----------
    path : str or Path, or array_like, shape (ny, nx)
        The heights, NaN or masked where a point is missing; or a file of heights: ``.npy``, ``.npz`` or ``.h5``
        (``:/dataset``), text with a row of cells per line, or text with points x, y, z of a regular grid in any order.
        Peaks towards the other body are positive; the first row has the smallest y. ``python -m app.convert`` converts
        files of instruments to ``.h5``.
    unit : str, optional
        Unit of the file's lengths: m, cm, mm, um (or µm), nm, pm, angstrom (or Å) or in. Needed if the file does not
        state one.
    level : str
        Least squares polynomial that is subtracted: none, mean, plane or quadratic. Missing points are left out.
    crop : sequence of int, optional
        i0, i1, j0, j1: only columns i0 to i1 - 1 and rows j0 to j1 - 1 are read.
    missing : str
        "hole": contact is impossible at missing points (NaN). "fill": missing points are filled by a harmonic function.
    height_unit : str, optional
        Unit of the heights alone, if x and y of points are in `unit`.
    orient : sequence of str, or str
        Turns of rows and columns, made first, one after the other: transpose, flip_x, flip_y. Several may be one text,
        separated by commas. By default an ESRI grid is flipped in y, because its rows go from north to south.
    skip : int
        Number of lines to leave out at the head of a text.
    spacing : float or pair of float, optional
        Size dx, dy of a cell before the turns, or the side of a square cell, if the file does not state it. If the size
        is unknown, `Surface.grid` needs a domain.
    s_filter, l_filter : float, optional
        Cut-off wavelengths (nesting indices) of Gaussian filters [mm], which are applied last. `s_filter` removes
        shorter waves, such as noise; `l_filter` removes longer waves, such as waviness. If the spacing is not known
        before `Surface.grid`, use `Surface.filtered` instead.
    periodic : bool or str
        True if the patch repeats without end, so that filters continue across its sides, "x" or "y" if in this
        direction only; also the default of `Surface.grid`.
    channel : str or int, optional
        Name or number, from 0, of a channel, if a text has several channels, one below the other.
    override : bool
        If true, `unit`, `height_unit` and `spacing` replace what the file states; else a contradiction is an error.
    spacing_unit : str, optional
        Unit of `spacing`; default: mm.

    Returns
    -------
    Surface
        A NoteWarning is issued for each doubt about its units, slopes, spikes and missing points.

    Raises
    ------
    InputError
        If the file cannot be read, its unit is unknown or contradicts `unit`, the crop lies outside, or a filter does
        not fit the cells.

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
    periodic = validate_periodic(periodic)
    unit, height_unit, spacing_unit = (
        name and (find_unit(name) or name) for name in (unit, height_unit, spacing_unit)
    )
    orient = orient.split(",") if isinstance(orient, str) else tuple(orient or ())
    if not (isinstance(skip, Integral) and skip >= 0):
        raise InputError(f"surface skip {skip!r}: must be a number of lines, from 0")
    for name, value, allowed in (
        ("level", level, LEVELS),
        ("missing", missing, MISSING),
        ("unit", unit, (*UNITS, None)),
        ("height unit", height_unit, (*UNITS, None)),
        ("spacing unit", spacing_unit, (*UNITS, None)),
        *(("orient", turn, TURNS) for turn in orient),
    ):
        if value not in allowed:
            raise InputError(f"surface {name} {value}: must be one of {', '.join(filter(None, allowed))}")
    try:
        source = open_heights(path, skip, orient, channel, coordinates=crop is not None)
    except (ValueError, OSError) as error:
        raise InputError(str(error)) from None
    if is_number(spacing):
        spacing = spacing, spacing
    if spacing_unit:
        if spacing is None:
            raise InputError("surface spacing_unit: has no effect without spacing=")
        spacing = tuple(UNITS[spacing_unit] * np.atleast_1d(spacing))
    source.settle(unit, height_unit, spacing, override)
    surface = replace(make_surface(source, level, crop, missing), periodic=periodic)
    check_cells(surface.file, s_filter, l_filter, surface.shape, surface.spacing)
    if surface.spacing:
        surface = surface.filtered(surface.grid(), s_filter, l_filter)
    warned = surface.notes
    if surface.spacing:
        warned += tuple(note_doubts(surface, surface.grid()))
    warn_notes(warned)
    return replace(surface, warned=warned)


def make_surface(source, level="none", crop=None, missing="hole"):
    """Return the `Surface` of a `HeightMap`, after `HeightMap.settle`.

    The arguments are as in `read_surface`.
    """
    crop, scale = source.check_crop(crop), UNITS[source.unit]
    ny, nx = crop[3] - crop[2], crop[1] - crop[0]
    moments = Moments(source.file, lambda *rows: scale * source.cropped_rows(crop, *rows), (ny, nx))
    holes, where = nx * ny - int(moments.count), f"surface file {source.file}"
    notes, filled = [], (np.zeros(0, int),) * 2
    if holes and missing == "fill":
        filled = np.nonzero(np.isnan(source.cropped_rows(crop, 0, ny)))
        notes.append(f"{where}: {holes} of {nx * ny} points were missing and are filled")
    elif holes:
        notes.append(
            f"{where}: {holes} of {nx * ny} points are missing: cells without any cannot touch; "
            "fill them by missing='fill' (-surface_missing fill)"
        )
    for kind, lines, shift in moments.unmeasured():
        numbers = [str(line + crop[2 if kind == "row" else 0]) for line in lines[:MAX_NOTED_ROWS]]
        more = ", ..." * (len(lines) > MAX_NOTED_ROWS)
        notes.append(
            f"{where}: all points in {kind}{'s'[: len(lines) != 1]} {', '.join(numbers)}{more} have the lowest "
            f"height, as if they were not measured, which moves the best plane by up to {format_lengths(shift)}; "
            "leave them out by crop= (-surface_crop), or mark them as missing, NaN"
        )
    rise, rms = moments.tilt()
    statistics = moments.roughness(level)
    height, steps, row, column = statistics["spike"]
    statistics["spike"] = height, steps, crop[2] + row, crop[0] + column
    tilted = level in ("none", "mean")
    if tilted and rise > max(MIN_NOTED_TILT * rms, moments.rounding):
        notes.append(
            f"{where}: is tilted by {rise:.3g} mm over the patch, its rms height about the best "
            f"plane is {rms:.3g} mm; level it by level='plane' (-surface_level plane) if that is the instrument's"
        )
    return Surface(
        file=source.file,
        unit=source.unit,
        shape=(ny, nx),
        spacing=source.cell,
        level=level,
        missing=missing,
        crop=crop,
        orient=source.orient,
        rounding=moments.rounding,
        missing_points=holes,
        notes=tuple(notes),
        _source=source,
        _level=moments.fit(level),
        _tilt=moments.slopes() if tilted else {},
        _filled=filled,
        **statistics,
    )
