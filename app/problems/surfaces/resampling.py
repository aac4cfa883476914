"""Measured surfaces on any cells, by volume-preserving splines.

The volume under the surface, summed up to each edge of the file's cells, is interpolated by cubic splines, first along
rows, then along columns. The increase of this volume over a cell of the grid gives the mean height of the cell. (Such
splines are called *histosplines*; heights are parabolas between the edges.) So volumes are preserved, whole blocks of
cells get their mean, and quadratic surfaces are exact.
"""

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from app.base.errors import InputError
from app.base.memory import check_fits
from app.base.types import Floats
from app.base.units import format_lengths
from app.halfspace.grid import Grid

RUN = 1 << 18  # numbers that are interpolated together
ROUNDING = 1e-9  # relative rounding of sides, and of shares of a cell


@dataclass(frozen=True, eq=False)
class ResampledSurface:
    """A measured surface on any grid, from `Surface.resampled`.

    The middle of the surface lies in the middle of the grid's patch, which may be smaller. If the file states no
    spacing, the surface is as large as the patch. A cell of the grid is missing if it overlaps no known point of the
    file.

    Examples
    --------
    >>> from app import Grid, read_surface
    >>> bowl = read_surface(np.square(np.arange(10.0)) + np.zeros((4, 1)), "um", spacing=(0.1, 0.1))
    >>> fine = Grid.from_domain(40, 8, (0, 1, 0, 0.4))
    >>> heights = bowl.resampled().heights_on(fine)
    >>> np.allclose(heights[0].reshape(10, 4).mean(axis=1), bowl.heights()[0])
    True
    """

    surface: Any

    sampled = measured = refinable = True

    file, spacing, spike, rounding, rms_level, notes, warned = (
        property(attrgetter(f"surface.{name}"))
        for name in ("file", "spacing", "spike", "rounding", "rms_level", "notes", "warned")
    )

    def own_grid(self, grid: Grid) -> Grid:
        """Return the grid of the cells of the file."""
        return self.surface.grid(None if self.spacing else grid.domain, grid.periodic)

    def check_grid(self, grid: Grid) -> None:
        """Raise if a patch is larger than the surface."""
        sides, own = (np.array(g.sides) for g in (grid, self.own_grid(grid)))
        if np.any(sides > own * (1 + ROUNDING)):
            raise InputError(
                f"surface file {self.file}: is {own[0]:.10g} x {own[1]:.10g} mm, the domain {sides[0]:.10g} x "
                f"{sides[1]:.10g} mm; the domain must be no larger"
            )

    def filtered(
        self, grid: Grid, s_filter: float | None = None, l_filter: float | None = None
    ) -> "ResampledSurface":
        """Return the surface filtered on the file's cells, see `Surface.filtered`."""
        return ResampledSurface(self.surface.filtered(self.own_grid(grid), s_filter, l_filter))

    def cell(self, grid: Grid) -> tuple[float, float]:
        """Return the size dx, dy of a cell of the file [mm]."""
        return self.surface.cell(self.own_grid(grid))

    def rms_slope(self, grid: Grid) -> float:
        """Return the rms slope between the file's cells, see `Surface.rms_slope`."""
        return self.surface.rms_slope(self.own_grid(grid))

    def understood(self, grid: Grid) -> str:
        """Return a line on how the file was read."""
        line = self.surface.understood(self.own_grid(grid))
        return f"{line}; resampled to cells of {format_lengths(grid.dx, grid.dy)}"

    def heights_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return mean heights of cells in `rows` [mm]; NaN where missing."""
        own = self.own_grid(grid)
        ny, nx = own.shape
        check_fits(40.0 * own.n + 16.0 * ny * grid.nx, f"resampling {nx} x {ny} heights")
        x, y, around = _edges(own, grid, rows)
        heights, known = self.surface.heights(around=around), 1.0
        missing = np.isnan(heights)
        if missing.any():
            from app.problems.surfaces.fill import fill_missing  # sparse solvers load slowly

            heights[missing] = fill_missing(heights, around)
            known = _means(_means(1.0 - missing, x, 1).T, y, 1).T
        means = _means(_means(heights, x, 3, around[0]).T, y, 3, around[1]).T
        return np.where(known > ROUNDING, means, np.nan)

    def filled_on(self, grid: Grid, rows: slice = slice(None)) -> Floats | None:
        """Return the share of each cell's area that was filled in; None if none was."""
        own = self.own_grid(grid)
        share, (x, y, _) = self.surface.filled_on(own), _edges(own, grid, rows)
        return None if share is None else _means(_means(share, x, 1).T, y, 1).T

    def describe(self) -> dict[str, Any]:
        """Return how the file was read, by option names, for result files."""
        return {**self.surface.describe(), "surface_resample": 1}

    def __repr__(self):
        return f"<Resampled{repr(self.surface).removeprefix('<')}"


def common_grid(surfaces, cells=None, domain=None, periodic=False):
    """Return a grid on the surfaces' common patch.

    `cells` is (nx, ny); by default cells are as large as the first surface's cells. `domain`, x0, x1, y0, y1 [mm], is
    needed if a file does not state its spacing.
    """
    own = [surface.surface.grid(None if surface.spacing else domain, periodic) for surface in surfaces]
    if domain is None:
        lx, ly = np.min([grid.sides for grid in own], axis=0)
        domain = -lx / 2, lx / 2, -ly / 2, ly / 2
    x0, x1, y0, y1 = domain
    if cells is None:
        cells = max(round((x1 - x0) / own[0].dx), 1), max(round((y1 - y0) / own[0].dy), 1)
    return Grid.from_domain(*cells, domain, periodic)


def _edges(own, grid, rows):
    """Return edges of the grid's cells, in units of the file's cells.

    Return the edges in x, the edges in y of some rows, and two values that are true if x and y are periodic.
    """
    all_edges, around, (in_y, in_x) = [], [], grid.repeats
    directions = (own.nx, own.dx, grid.nx, grid.dx, in_x), (own.ny, own.dy, grid.ny, grid.dy, in_y)
    for n, width, cells, cell, repeats in directions:
        edges = (np.arange(cells + 1) - cells / 2) * (cell / width) + n / 2  # about the common middle
        if abs(edges[0]) <= ROUNDING * n:
            edges[[0, -1]] = 0, n
        all_edges.append(edges)
        around.append(bool(repeats and edges[0] == 0))
    start, stop, _ = rows.indices(grid.ny)
    return all_edges[0], all_edges[1][start : max(start, stop) + 1], tuple(around)


def _means(values, edges, degree, around=False):
    """Return each row's means over another grid's cells.

    A spline of a `degree` interpolates the sums of a row up to the edges of its n cells. `edges` are the edges of the
    other cells, in units of these n cells, from 0 to n. If `around` is true, rows are periodic.
    """
    from scipy.interpolate import make_interp_spline

    n, means = values.shape[1], np.empty((len(values), len(edges) - 1))
    degree, ends = min(degree, n), "periodic" if around and n > degree > 1 else None
    step = max(1, RUN // n)
    for first in range(0, len(values), step):
        run = values[first : first + step]
        middle = run.mean(axis=1, keepdims=True)
        sums = np.zeros((len(run), n + 1))
        np.cumsum(run - middle, axis=1, out=sums[:, 1:])
        sums[:, -1] = 0.0
        spline = make_interp_spline(np.arange(n + 1.0), sums, k=degree, axis=1, bc_type=ends)
        means[first : first + step] = np.diff(spline(edges), axis=1) / np.diff(edges) + middle
    return means
