"""Measured surface: heights after levelling, filling, filtering and averaging.

Each rank stores only its own rows. Each rank fills all missing points, so that the filled heights are the same on any
number of ranks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from app.base import views
from app.base.errors import InputError
from app.base.types import Axes, Figure, Floats, Length
from app.base.units import UNITS, format_lengths
from app.halfspace.grid import Grid, repeats_in
from app.problems.surfaces.filters import band_pass, check_cells, check_order
from app.problems.surfaces.moments import Moments, add_polynomial
from app.problems.surfaces.resampling import ResampledSurface


@dataclass(frozen=True, eq=False)
class Surface:
    """A measured surface, made by `read_surface`.

    Attributes
    ----------
    file, unit, level, missing, crop, orient, s_filter, l_filter, periodic
        Arguments of `read_surface`; `file` is ``(array)`` if an array was given.
    shape : tuple of int
        ny, nx: numbers of cells after cropping and averaging.
    spacing : tuple of float or None
        Size dx, dy of a cell [mm], if stated.
    rms_height : float
        Standard deviation of the heights in the file that are not missing, after levelling and filters [mm].
    rms_level, skewness, kurtosis : float
        Standard deviation of these heights about their best plane [mm], and their third and fourth standardised
        moments. With `level` "quadratic" the best quadratic is used instead of the plane.
    steps : tuple of float
        Rms height difference of neighbouring points of the file in x, and in y, after subtraction of this plane or
        quadratic and after filters [mm].
    spike : tuple
        The point that stands out most, after subtraction of the plane or quadratic and before filters. Four numbers:
        its height above the highest of its four neighbours [mm], this height divided by the smaller of `steps`, its row
        and its column.
    rounding : float
        Height differences up to this number may come from the rounding of numbers in the file [mm].
    missing_points : int
        Number of missing points of the file, within the crop.
    notes : tuple of str
        Warnings for the user.
    warned : tuple of str
        Notes that `read_surface` has issued as warnings.
    """

    file: str
    unit: str
    shape: tuple[int, int]
    spacing: tuple[float, float] | None
    level: str
    missing: str
    crop: tuple[int, int, int, int]
    orient: tuple[str, ...]
    rms_height: float
    rms_level: float
    skewness: float
    kurtosis: float
    steps: tuple[float, float]
    spike: tuple[float, float, int, int]
    rounding: float
    missing_points: int
    notes: tuple[str, ...]
    _source: object
    _level: dict  # polynomial that is subtracted, see `Moments.fit`
    _tilt: dict  # slopes of the best plane that remains
    _filled: tuple  # rows and columns of the filled points in the crop
    _fillings: dict = field(default_factory=dict)  # their heights [mm], by whether x and y wrap around
    _averaged: tuple = (1, 1)
    s_filter: float | None = None
    l_filter: float | None = None
    periodic: str = ""
    _filtered: np.ndarray | None = None  # the crop [mm]
    warned: tuple[str, ...] = ()

    sampled = measured = by_rows = True

    def grid(self, domain: Sequence[Length] | None = None, periodic: bool | str | None = None) -> Grid:
        """Return a grid with the cells of the surface.

        `domain` is x0, x1, y0, y1 [mm], by default centred at the origin. It is needed if the spacing is unknown.
        """
        ny, nx = self.shape
        if domain is None:
            if self.spacing is None:
                raise InputError(
                    f"domain= (-domain) is missing: surface file {self.file} does not say its spacing, nor did "
                    "spacing= of read_surface; must be x0,x1,y0,y1 [mm]"
                )
            lx, ly = nx * self.spacing[0], ny * self.spacing[1]
            domain = -lx / 2, lx / 2, -ly / 2, ly / 2
        grid = Grid.from_domain(nx, ny, domain, self.periodic if periodic is None else periodic)
        self.check_grid(grid)
        return grid

    def averaged(self, shape: tuple[int, int]) -> "Surface":
        """Return the surface averaged over blocks of cells.

        `shape` is the number of blocks in y and x.
        """
        if shape == self.shape:
            return self
        ny, nx = self.shape
        if min(shape) < 1 or ny % shape[0] or nx % shape[1]:
            raise InputError(
                f"grid {shape[1]},{shape[0]}: surface file {self.file} has {nx} x {ny} cells; must be -grid {nx},{ny} "
                "or whole fractions of both numbers, whose cells are averaged, or any by resampled() "
                "(-surface_resample)"
            )
        fy, fx = ny // shape[0], nx // shape[1]
        note = f"surface file {self.file}: {fx} x {fy} cells averaged to one: slopes and peaks are lower"
        return replace(
            self,
            shape=tuple(shape),
            spacing=self.spacing and (fx * self.spacing[0], fy * self.spacing[1]),
            notes=(*self.notes, note),
            _averaged=(self._averaged[0] * fy, self._averaged[1] * fx),
        )

    def resampled(self) -> ResampledSurface:
        """Return the surface as a `ResampledSurface`, for any grid."""
        return ResampledSurface(self)

    def filtered(self, grid: Grid, s_filter: float | None = None, l_filter: float | None = None) -> "Surface":
        """Return the surface without short and long waves.

        Waves shorter than `s_filter` and longer than `l_filter` [mm] are removed; waves of just these lengths keep half
        of their height. Every rank filters and keeps the whole surface. On a periodic grid the filters continue across
        the sides of the patch.
        """
        if s_filter is None and l_filter is None:
            return self
        if self._filtered is not None:
            raise InputError(f"surface file {self.file}: is filtered already")
        check_order(s_filter, l_filter)
        self.check_grid(grid)
        ny, nx, cell = self.crop[3] - self.crop[2], self.crop[1] - self.crop[0], self.cell(grid)
        check_cells(self.file, s_filter, l_filter, (ny, nx), cell)
        heights = band_pass(
            self._levelled(0, ny, grid.repeats[::-1]), s_filter, l_filter, cell, grid.periodic
        )
        moments = Moments(self.file, lambda *rows: heights[slice(*rows)].copy(), (ny, nx))
        statistics = {
            **moments.roughness("none"),
            "spike": self.spike,
            "s_filter": s_filter,
            "l_filter": l_filter,
        }
        return replace(
            self,
            **statistics,
            periodic=grid.periodic,
            _tilt=moments.slopes(),
            _filtered=heights,
            _source=None,
            _fillings={},
        )

    def cell(self, grid: Grid | None = None) -> tuple[float, float]:
        """Return the size dx, dy of a cell of the file [mm]."""
        grid = grid or self.grid()
        return grid.dx / self._averaged[1], grid.dy / self._averaged[0]

    def rms_slope(self, grid: Grid | None = None) -> float:
        """Return the rms slope between cells of the file.

        The slope of the best plane is subtracted first.
        """
        return float(np.sqrt(np.nansum(np.square(self.steps) / np.square(self.cell(grid)))))

    def understood(self, grid: Grid | None = None) -> str:
        """Return a line on how the file was read."""
        grid = grid or self.grid()
        nx, ny = self.crop[1] - self.crop[0], self.crop[3] - self.crop[2]
        turned = f" after {','.join(self.orient)}" if self.orient else ""
        fate = "filled" if self.missing == "fill" else "missing"
        holes = f", {self.missing_points} of {nx * ny} points {fate}" if self.missing_points else ""
        shape = f", skewness {self.skewness:.2g}, kurtosis {self.kurtosis:.2g}" if self.rms_level > 0 else ""
        filters = (("S", self.s_filter), ("L", self.l_filter))
        filtered = "".join(f", {name}-filtered at {format_lengths(size)}" for name, size in filters if size)
        return (
            f"{nx} x {ny} heights in {self.unit}, cells of {format_lengths(*self.cell(grid))}, patch of "
            f"{format_lengths(*grid.sides)}{holes}{filtered}; {self._about}: rms height "
            f"{format_lengths(self.rms_level)}, rms slope {self.rms_slope(grid):.2g}{shape}; rows along x, the first "
            f"at the smallest y{turned}"
        )

    @property
    def _about(self):
        """Words that say to which level or plane the rms height refers."""
        return "after quadratic level" if self.level == "quadratic" else "about the best plane"

    def check_grid(self, grid: Grid) -> None:
        """Raise unless `grid`'s cells and period fit this surface."""
        if grid.shape != self.shape:
            raise InputError(
                f"surface file {self.file}: has {self.shape[1]} x {self.shape[0]} cells, the grid {grid.nx} x "
                f"{grid.ny}; must be equal, also those of two files, or resample by resampled() (-surface_resample)"
            )
        if self.spacing and not np.allclose((grid.dx, grid.dy), self.spacing, rtol=1e-6, atol=0):
            raise InputError(
                f"surface file {self.file}: says that its patch is {grid.nx * self.spacing[0]:.7g} x "
                f"{grid.ny * self.spacing[1]:.7g} mm; the domain is {grid.sides[0]:.7g} x {grid.sides[1]:.7g} mm"
            )
        other = grid.repeats != repeats_in(self.periodic)
        if other and (self.periodic or self._filtered is not None):
            kind, this = (
                {"": "free", "x": "x-periodic", "y": "y-periodic"}.get(name, "periodic")
                for name in (self.periodic, grid.periodic)
            )
            raise InputError(
                f"surface file {self.file}: was read for a {kind} patch, this one is {this}; must "
                "be the same periodic= of read_surface and of the problem"
            )

    def __str__(self):
        if self.spacing:
            return f"surface file {self.file}: {self.understood()}"
        return (
            f"surface file {self.file}: {self.shape[1]} x {self.shape[0]} heights in {self.unit}, rms height "
            f"{self._about} {format_lengths(self.rms_level)}, in cells of a size it does not say"
        )

    def __repr__(self):
        return f"<Surface{str(self).removeprefix('surface file')}>"

    def heights(self, rows: slice = slice(None), around: tuple[bool, bool] | None = None) -> Floats:
        """Return these rows' heights [mm], with shape (rows, nx).

        Peaks are positive, missing points are NaN. The two values of `around`, for x and y, are true if missing points
        are filled as on a surface periodic in this direction. Default: `periodic`, as given to `read_surface`.
        """
        start, stop, _ = rows.indices(self.shape[0])
        stop, (fy, fx) = max(start, stop), self._averaged
        fine = self._levelled(fy * start, fy * stop, around or repeats_in(self.periodic)[::-1])
        if fy == fx == 1:
            return fine
        # Average about the best plane: the known points of a block need not lie about it evenly.
        tilt = self._tilt if self.missing_points else {}
        add_polynomial(fine, tilt, fy * start, fy * self.shape[0], sign=-1)
        blocks = fine.reshape(stop - start, fy, self.shape[1], fx)
        known = ~np.isnan(blocks)
        with np.errstate(invalid="ignore"):
            means = np.where(known, blocks, 0.0).sum(axis=(1, 3)) / known.sum(axis=(1, 3))
        return add_polynomial(means, tilt, start, self.shape[0])

    def heights_about_plane(self) -> Floats:
        """Return all heights about their best plane [mm]."""
        heights = add_polynomial(self.heights(), self._tilt, 0, self.shape[0], sign=-1)
        return heights - np.nanmean(heights) if self.level == "none" else heights

    def plot(self, ax: Axes | None = None) -> tuple[Figure, Any]:
        """Draw heights, profiles, distribution and spectrum.

        On given axes `ax`, only the heights are drawn.

        Returns
        -------
        figure, axes
        """
        return views.load().plot_surface(self, ax)

    def _repr_html_(self):
        return views.load().surface_html(self)

    def heights_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return heights in some rows of a grid with these cells [mm].

        On a periodic grid missing points are filled across the sides of the patch, too.
        """
        if grid.shape != self.shape:
            raise ValueError("a measured surface is known on its own grid only")
        return self.heights(rows, grid.repeats[::-1])

    def filled_on(self, grid: Grid, rows: slice = slice(None)) -> Floats | None:
        """Return the share of filled points in each cell; None if none was filled."""
        if not len(self._filled[0]):
            return None
        start, stop, _ = rows.indices(self.shape[0])
        (fy, fx), (j, i), shape = self._averaged, self._filled, (max(stop - start, 0), self.shape[1])
        inside = slice(*np.searchsorted(j, (fy * start, fy * (start + shape[0]))))
        cells = np.ravel_multi_index((j[inside] // fy - start, i[inside] // fx), shape)
        return np.bincount(cells, minlength=shape[0] * shape[1]).reshape(shape) / (fy * fx)

    def describe(self) -> dict[str, Any]:
        """Return how the file was read, by option names, for result files."""
        names = "file", "unit", "level", "missing", "missing_points", "s_filter", "l_filter"
        facts = {f"surface_{name}": getattr(self, name) for name in names}
        facts |= {"surface_crop": list(self.crop), "surface_orient": ",".join(self.orient)}
        return {name: value for name, value in facts.items() if value is not None}

    def _levelled(self, start, stop, around):
        """Return rows of the crop, after levelling, filling and filters [mm].

        The heights belong to the points of the file, before averaging.
        """
        if self._filtered is not None:
            return self._filtered[start:stop].copy()
        heights = self._read(start, stop)
        (j, i), ny = self._filled, self.crop[3] - self.crop[2]
        if len(j):
            if around not in self._fillings:
                from app.problems.surfaces.fill import fill_missing  # sparse solvers load slowly

                self._fillings[around] = fill_missing(self._read(0, ny), around)
            inside = slice(*np.searchsorted(j, (start, stop)))
            heights[j[inside] - start, i[inside]] = self._fillings[around][inside]
        return heights

    def _read(self, start, stop):
        """Return the crop's rows from the file, levelled [mm]."""
        heights = self._source.cropped_rows(self.crop, start, stop)
        heights *= UNITS[self.unit]
        return add_polynomial(heights, self._level, start, self.crop[3] - self.crop[2], sign=-1)
