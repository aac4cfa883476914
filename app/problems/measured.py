"""Measured surfaces: heights in a file, in their own unit, cropped, with missing points, levelled, filtered.

A height map is read in runs of rows, and each rank keeps its own rows only; what is found in all of it (level, missing
points) every rank finds for itself, in the same order, so that it is the same on any number of ranks.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from app.errors import InputError
from app.halfspace.grid import Grid, symbol_name
from app.problems.arrays import real_numbers
from app.problems.filters import band_pass, check_cells, check_order
from app.problems.height_file import (
    TURNS,
    HeightArray,
    HeightFile,
    agreed_spacing,
    agreed_units,
    checked_crop,
    cropped,
)
from app.problems.moments import LEVELS, Moments, take_off
from app.problems.resampled import ResampledSurface
from app.units import UNITS, in_words, unit_named

MISSING = ("hole", "fill")
_TILTED = 4.0  # rise of the best plane over the patch in rms heights about it that is worth a note


@dataclass(frozen=True, eq=False)
class Surface:
    """A measured surface, made by `read_surface`; give it to `ContactProblem` among its ``surfaces``.

    Attributes
    ----------
    file : str
        ``(array)`` if it is none.
    unit : str
        Of the file's heights.
    shape : tuple of int
        ny, nx: cells, after cropping and averaging.
    spacing : tuple of float or None
        Size dx, dy of a cell [mm]; None: nobody has said.
    level, missing : str
        How it was levelled, what became of missing points.
    crop : tuple of int
        Columns i0 to i1 - 1 and rows j0 to j1 - 1 of the file.
    orient : tuple of str
        How rows and columns of the file were turned, before all else.
    rms_height : float
        Standard deviation of the heights in the file that are not missing, after levelling and filters [mm].
    rms_level, skewness, kurtosis : float
        The same about their best plane, or about level "quadratic" [mm], and the third and fourth standardised moments.
    steps : tuple of float
        Root mean square of the steps from cell to cell of the file in x and in y, about the same, after filters [mm].
    spike : tuple
        How high the point that stands out most does above the highest of its four neighbours [mm], how many rms steps
        that is, its row and column; before filters, which only smear it.
    missing_points : int
        Of the file, within the crop.
    notes : tuple of str
        What a user should look at twice.
    s_filter, l_filter : float or None
        Nesting indices of what was filtered, see `filtered` [mm].
    periodic : bool
        Whether it was read, or filtered, for a periodic patch.
    """

    file: str
    unit: str
    shape: tuple
    spacing: tuple | None
    level: str
    missing: str
    crop: tuple
    orient: tuple
    rms_height: float
    rms_level: float
    skewness: float
    kurtosis: float
    steps: tuple
    spike: tuple
    missing_points: int
    notes: tuple
    _source: object
    _coefficients: dict  # powers of x, y, from -1 to 1 over the crop -> [mm]
    _filled: tuple  # rows, columns of the crop, values [mm]
    _averaged: tuple = (1, 1)
    s_filter: float | None = None
    l_filter: float | None = None
    periodic: bool = False
    _rest: np.ndarray | None = None  # what filters left of the crop [mm]

    sampled = measured = True

    def grid(self, domain=None, periodic=None):
        """Grid of its cells; its patch lies about the origin, or where `domain` says [mm].

        Not collective. It repeats for ever where `periodic` says so, by default as the surface was read.

        Raises
        ------
        InputError
            If the patch has no size, or another one than the file says.
        """
        ny, nx = self.shape
        if domain is None:
            if self.spacing is None:
                raise InputError(
                    f"domain= (-domain) is missing: surface file {self.file} does not say its spacing, nor did "
                    "spacing= of read_surface; needed: x0,x1,y0,y1 [mm]"
                )
            lx, ly = nx * self.spacing[0], ny * self.spacing[1]
            domain = -lx / 2, lx / 2, -ly / 2, ly / 2
        grid = Grid.from_domain(nx, ny, domain, self.periodic if periodic is None else periodic)
        self.check_grid(grid)
        return grid

    def averaged(self, shape):
        """The same on fewer cells, the mean of whole blocks of cells each.

        Not collective.

        Raises
        ------
        InputError
            If the blocks are not whole.
        """
        if shape == self.shape:
            return self
        ny, nx = self.shape
        if min(shape) < 1 or ny % shape[0] or nx % shape[1]:
            raise InputError(
                f"grid {shape[1]},{shape[0]}: surface file {self.file} has {nx} x {ny} cells; allowed: -grid {nx},{ny} "
                "and whole fractions of both numbers, whose cells are averaged, or any by resampled() "
                "(-surface_resample)"
            )
        fy, fx = ny // shape[0], nx // shape[1]
        spacing = self.spacing and (fx * self.spacing[0], fy * self.spacing[1])
        before = self._averaged
        note = f"surface file {self.file}: {fx} x {fy} cells averaged to one: slopes and peaks are lower"
        return replace(
            self,
            shape=tuple(shape),
            spacing=spacing,
            notes=(*self.notes, note),
            _averaged=(before[0] * fy, before[1] * fx),
        )

    def resampled(self):
        """The same on whatever cells it is asked for: a surface of a problem on any grid, see `ResampledSurface`.

        Not collective.
        """
        return ResampledSurface(self)

    def filtered(self, grid, s_filter=None, l_filter=None):
        """The same without waves shorter than one length and longer than another, see `app.problems.filters`.

        Not collective: every rank filters all of it, and keeps it.

        Parameters
        ----------
        grid : Grid
            That of this surface; whether it is periodic counts.
        s_filter, l_filter : float, optional
            Nesting indices of S-filter and L-filter, of which half passes [mm].

        Returns
        -------
        Surface

        Raises
        ------
        InputError
            If the cells do not resolve them, the patch is shorter, nothing is left between them, or it is filtered.
        """
        if s_filter is None and l_filter is None:
            return self
        if self._rest is not None:
            raise InputError(f"surface file {self.file}: is filtered already")
        check_order(s_filter, l_filter)
        self.check_grid(grid)
        ny, nx, cell = self.crop[3] - self.crop[2], self.crop[1] - self.crop[0], self.cell(grid)
        check_cells(self.file, s_filter, l_filter, (ny, nx), cell)
        rest = band_pass(self._levelled(0, ny), s_filter, l_filter, cell, bool(grid.periodic))
        moments = Moments(self.file, lambda *rows: rest[slice(*rows)], (ny, nx))
        found = moments.roughness("none") | {"s_filter": s_filter, "l_filter": l_filter}
        return replace(self, **found, periodic=bool(grid.periodic), _rest=rest, _source=None)

    def cell(self, grid=None):
        """Size dx, dy of a cell of the file, where `grid` is that of this surface [mm]. Not collective."""
        grid = grid or self.grid()
        return grid.dx / self._averaged[1], grid.dy / self._averaged[0]

    def rms_slope(self, grid=None):
        """Root mean square of the gradient in the file, about the best plane. Not collective."""
        return float(np.sqrt(np.nansum(np.square(self.steps) / np.square(self.cell(grid)))))

    def understood(self, grid=None):
        """What was read, in a line for people to compare with what they know. Not collective."""
        grid = grid or self.grid()
        nx, ny = self.crop[1] - self.crop[0], self.crop[3] - self.crop[2]
        turned = f" after {','.join(self.orient)}" if self.orient else ""
        what = "filled" if self.missing == "fill" else "missing"
        holes = f", {self.missing_points} of {nx * ny} points {what}" if self.missing_points else ""
        shape = f", skewness {self.skewness:.2g}, kurtosis {self.kurtosis:.2g}" if self.rms_level > 0 else ""
        filters = (("S", self.s_filter), ("L", self.l_filter))
        filtered = "".join(f", {name}-filtered at {in_words(index)}" for name, index in filters if index)
        return (
            f"{nx} x {ny} heights in {self.unit}, cells of {in_words(*self.cell(grid))}, patch of "
            f"{in_words(grid.nx * grid.dx, grid.ny * grid.dy)}{holes}{filtered}; {self._about}: rms height "
            f"{in_words(self.rms_level)}, rms slope {self.rms_slope(grid):.2g}{shape}; rows along x, the first "
            f"at the smallest y{turned}"
        )

    @property
    def _about(self):
        """What rms height and the like are about."""
        return "after quadratic level" if self.level == "quadratic" else "about the best plane"

    def check_grid(self, grid):
        """Refuse a grid whose cells are not the surface's, or that filters were not made for. Not collective."""
        if grid.shape != self.shape:
            raise InputError(
                f"surface file {self.file}: has {self.shape[1]} x {self.shape[0]} cells, the grid {grid.nx} x "
                f"{grid.ny}; needed: the same cells, of two files, too, or resampled() (-surface_resample)"
            )
        if self.spacing and not np.allclose((grid.dx, grid.dy), self.spacing, rtol=1e-6, atol=0):
            raise InputError(
                f"surface file {self.file}: says that its patch is {grid.nx * self.spacing[0]:.7g} x "
                f"{grid.ny * self.spacing[1]:.7g} mm; "
                f"the domain is {grid.nx * grid.dx:.7g} x {grid.ny * grid.dy:.7g} mm"
            )
        if bool(grid.periodic) != self.periodic and (self.periodic or self._rest is not None):
            kinds = "free", "periodic"
            raise InputError(
                f"surface file {self.file}: was read for a {kinds[self.periodic]} patch, this one is "
                f"{kinds[not self.periodic]}; needed: the same periodic= of read_surface and of the problem"
            )

    def __str__(self):
        if self.spacing:
            return f"surface file {self.file}: {self.understood()}"
        return (
            f"surface file {self.file}: {self.shape[1]} x {self.shape[0]} heights in {self.unit}, rms height "
            f"{self._about} {in_words(self.rms_level)}, in cells of a size it does not say"
        )

    def __repr__(self):
        return f"<Surface{str(self).removeprefix('surface file')}>"

    def heights(self, rows=slice(None)):
        """Heights of some rows, peaks positive, shape (rows, nx) [mm]; NaN: missing. Not collective."""
        start, stop, _ = rows.indices(self.shape[0])
        fy, fx = self._averaged
        fine = self._levelled(fy * start, fy * max(start, stop))
        if fy == fx == 1:
            return fine
        blocks = fine.reshape(-1, fy, self.shape[1], fx)
        known = ~np.isnan(blocks)
        with np.errstate(invalid="ignore"):
            return np.where(known, blocks, 0.0).sum(axis=(1, 3)) / known.sum(axis=(1, 3))

    def heights_on(self, grid, rows=slice(None)):
        """See `heights`; only on the surface's own cells."""
        if grid.shape != self.shape:
            raise ValueError("a measured surface is known on its own grid only")
        return self.heights(rows)

    def describe(self):
        """Data for the result file, by the names of the options. Not collective."""
        names = "file", "unit", "level", "missing", "missing_points", "s_filter", "l_filter"
        facts = {f"surface_{name}": getattr(self, name) for name in names}
        facts |= {"surface_crop": list(self.crop), "surface_orient": ",".join(self.orient)}
        return {name: value for name, value in facts.items() if value is not None}

    def _levelled(self, start, stop):
        """Rows of the crop, before averaging [mm]."""
        if self._rest is not None:
            return self._rest[start:stop].copy()
        values = cropped(self._source, self.crop, start, stop)
        values *= UNITS[self.unit]
        j, i, heights = self._filled
        here = slice(*np.searchsorted(j, (start, stop)))
        values[j[here] - start, i[here]] = heights[here]
        return take_off(self._coefficients, values, start, self.crop[3] - self.crop[2])


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
        m, mm, um (or µm) or nm: of the file; needed where it does not say.
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
    periodic = bool(symbol_name(periodic))
    unit, height_unit = (name and (unit_named(name) or name) for name in (unit, height_unit))
    orient = orient.split(",") if isinstance(orient, str) else tuple(orient or ())
    if not (isinstance(skip, Integral) and skip >= 0):
        raise InputError(f"surface skip {skip!r}: needed: a number of lines, from 0")
    for name, value, allowed in (
        ("level", level, LEVELS),
        ("missing", missing, MISSING),
        ("unit", unit, (*UNITS, "µm", None)),
        ("height unit", height_unit, (*UNITS, "µm", None)),
        *(("orient", turn, TURNS) for turn in orient),
    ):
        if value not in allowed:
            raise InputError(
                f"surface {name} {value}: not allowed; allowed: {', '.join(filter(None, allowed))}"
            )
    try:
        if isinstance(path, str | os.PathLike):
            source = HeightFile(path, skip, orient)
            if crop is None:
                source.refuse_coordinates()
        else:
            if skip:
                raise InputError(f"surface skip {skip}: of an array there are no lines")
            source = HeightArray(
                real_numbers("surface", path, "a file name, or an array of real numbers"), orient
            )
    except (ValueError, OSError) as error:
        raise InputError(str(error)) from None
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
    notes, filled = [], (np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    if holes and missing == "fill":
        values = cropped(source, crop, 0, ny)
        values *= scale
        from app.problems.fill import harmonic_fill  # sparse solvers take a while to load

        filled = harmonic_fill(values)
        notes.append(f"surface file {source.file}: {holes} of {nx * ny} points were missing and are filled")
    elif holes:
        notes.append(
            f"surface file {source.file}: {holes} of {nx * ny} points are missing: cells without any cannot touch; "
            "fill them by missing='fill' (-surface_missing fill)"
        )
    (height, times, row, column), (rise, rms) = moments.spike(), moments.tilt()
    if level in ("none", "mean") and rise > _TILTED * rms > 0:
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
        spike=(height, times, crop[2] + row, crop[0] + column),
        missing_points=holes,
        notes=tuple(notes),
        _source=source,
        _coefficients=moments.fit(level),
        _filled=filled,
        **moments.roughness(level),
    )
