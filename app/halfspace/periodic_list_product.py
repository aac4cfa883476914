"""Products u = A p between lists of cells of a periodic patch.

The method is that of `app.halfspace.list_product`. Here the pressure repeats in one or in both directions:

- *Smooth part.* In these directions the sums of Gaussians over all copies are Fourier series, and the nodes repeat,
  without padding. On a patch periodic in x and y the displacement has no mean. So a constant is missing in S, and the
  rest K - S is a constant far from the cell. The constant is found there, and is added to S.
- *Local part.* Copies of the cells near a side of the patch continue the lists on the other side.
- *Arms.* A sum of waves (``spectral``) has no wave shorter than two cells. It ends there with a bend, so far from a
  cell the coefficients oscillate in the cell's row and column, and decay like 1 / x^2 only. In the next rows this is
  less by a factor of 5, and from the third row on by a factor of 100. A table has these few rows and columns.

`error_bound` needs no estimate of the coefficients: it is the largest difference of K and its approximation, of all
offsets, plus the error of the nodes. For this a quadrant of K is computed once, a quarter of a field.
"""

import numpy as np

from app.base.errors import InputError
from app.halfspace import list_product
from app.halfspace.cell_list import CellList, LocalSum
from app.halfspace.fft.multiplier import EvenMultiplier, transform_even
from app.halfspace.grid import Grid, row_blocks
from app.halfspace.influence import quadrant_rows
from app.halfspace.list_loops import sum_arms
from app.halfspace.list_product import (
    SPACINGS,
    WINDOW,
    Axis,
    ListProduct,
    Split,
    cell_integrals,
    fit_gaussians,
    node_window,
)

_MIN_CELLS = 512  # of a grid in each direction
_MIN_NODES = 2 * WINDOW  # in a period
# Largest distance at which the Gaussians fit, over the diagonal of a patch periodic in both directions, or in one
_FIT_RANGE = 4.0, 64.0
_MIN_PERIOD = 0.5  # t times the period below which the sum over all copies is constant up to rounding
_LARGEST_ARM = 24  # rows or columns of arms
_ARM = 1e-8  # largest coefficient left out of the arms, over the largest one
_BLOCK_CELLS = 1 << 20  # cells in which the displacement is computed at once
_MARGIN = 64  # the margin of a list is a multiple of this number of cells


class PeriodicListProduct(ListProduct):
    """Product u = A p between lists of cells, on a periodic patch of half-spaces or layers.

    Parameters and attributes are as in `ListProduct`.

    Attributes
    ----------
    quadrant : ndarray, shape (ny // 2 + 1 or ny, nx // 2 + 1 or nx)
        Influence coefficients at offsets up to half a period, or up to the sides of the patch [mm / (N/mm2)].
    """

    def __init__(self, grid, kernel, *, cells=None, spacing=None):
        splits = _splits(grid) if self.suits(grid, kernel) else ()
        if not splits:
            raise InputError("list products: must be a large periodic patch of half-spaces or layered bodies")
        self.grid, self.kernel = grid, kernel
        if spacing is not None:
            splits, cells = [split for split in splits if split.spacing == spacing], None
        self._split = split = splits[0] if cells is None else self.choose_split(grid, cells)
        self.spacing, self.radius = split.spacing, split.radius
        rows, columns = (
            n // 2 + 1 if whole else n for n, whole in zip(grid.shape, grid.repeats, strict=True)
        )
        self.quadrant, read_rows = np.empty((rows, columns)), quadrant_rows(grid, kernel)
        for block in row_blocks(rows, columns):
            self.quadrant[block] = read_rows(block, columns)
        self.diagonal = float(self.quadrant[0, 0])
        nearest = split.radius - np.hypot(grid.dx, grid.dy) / 2
        longest = _FIT_RANGE[bool(grid.one_way)] * np.hypot(*grid.sides)
        t, weights, _ = fit_gaussians(kernel.base.point_influence, split.a, nearest, longest)
        if grid.doubly_periodic:
            waves = t * max(grid.sides) > _MIN_PERIOD
            t, weights = t[waves], weights[waves]
        numbers = zip(grid.shape, split.sizes, split.steps, split.periods, grid.repeats, strict=True)
        self._axes = in_y, in_x = [self._axis(*each, t) for each in numbers]
        self._nodes = np.empty((in_y.nodes, in_x.nodes))
        self._smooth = EvenMultiplier([axis.repeated or axis.nodes for axis in self._axes], split.periods)
        spectrum = (in_x.spectrum.T * weights) @ in_y.spectrum
        smooth = (in_y.values * weights) @ in_x.values.T
        if grid.doubly_periodic:
            spectrum[0, 0] = 0.0
            smooth -= (in_y.mean * weights) @ in_x.mean
        self._smooth.set_spectrum(lambda columns, rows: spectrum[columns])
        np.subtract(self.quadrant, smooth, out=smooth)
        self._local, self._constant, left = self._split_rest(smooth)
        self.error_bound = left + self._error_of_nodes(weights)

    @staticmethod
    def suits(grid, kernel):
        """Return whether the patch is large and periodic, and the bodies half-spaces or layered."""
        return bool(grid.periodic) and kernel.has_image_sums and bool(_splits(grid))

    @staticmethod
    def choose_split(grid, cells):
        """Return the split whose products from `cells` to `cells` take the least time."""
        return cells.cached("split", lambda: min(_splits(grid), key=lambda split: split.cost(cells, cells)))

    def _axis(self, n, size, step, period, repeats, t):
        if repeats:
            return _PeriodicAxis(n, size, step, period, t, self.grid.symbol == "spectral")
        return _FreeAxis(n, size, step, period, t)

    def _split_rest(self, rest):
        """Return the local sum, the constant, and the largest coefficient that both leave out of the `rest`."""
        grid, radius = self.grid, self.radius
        y, x = (size * np.arange(n) for size, n in zip(self._split.sizes, rest.shape, strict=True))
        far = np.hypot(y[:, None], x) > radius
        without_arms = (slice(_LARGEST_ARM, None),) * 2
        others, there = rest[without_arms], far[without_arms]
        extremes = others.max(where=there, initial=-np.inf), others.min(where=there, initial=np.inf)
        constant = float(sum(extremes)) / 2
        rest -= constant
        near = [int(radius / size) + 1 for size in self._split.sizes]
        table = np.where(far[: near[0], : near[1]], 0.0, rest[: near[0], : near[1]])
        rest[~far] = 0.0
        arms, least = [], _ARM * self.diagonal
        for lines, period in ((rest, grid.nx), (rest.T, grid.ny)) if grid.doubly_periodic else ():
            large = np.abs(lines[:_LARGEST_ARM]) > least
            large = large[: int(np.argmin(np.append(large.any(axis=1), False)))]
            large |= np.maximum.accumulate(large[:, ::-1], axis=1)[:, ::-1]  # all up to the last one
            arm = np.where(large, lines[: len(large)], 0.0)
            lines[: len(large)] -= arm
            if period % 2 == 0:
                arm[:, -1] /= 2  # half a period away there are two copies of a cell
            arms.append(arm)
        left = float(max(rest.max(), -rest.min()))
        return _PeriodicSum(grid, table, arms), constant, left

    def apply(self, sources, p, targets, out=None):
        """Return u at the targets [mm]; see `ListProduct.apply`."""
        u = super().apply(sources, p, targets, out)
        u += self._constant * p.sum()
        return u

    def apply_on_rows(self, sources, p, rows):
        """Return u in all cells of some `rows`, a slice, shape (rows, nx) [mm]; see `apply`."""
        nx = self.grid.nx
        u, block = np.empty((rows.stop - rows.start, nx)), max(1, _BLOCK_CELLS // nx)
        for first in range(rows.start, rows.stop, block):
            last = min(first + block, rows.stop)
            targets = CellList(self.grid, np.arange(first * nx, last * nx))
            self.apply(sources, p, targets, u[first - rows.start : last - rows.start].reshape(-1))
        return u

    def _convolve(self, nodes):
        """Replace the values of the nodes by their convolution with S."""
        axes = [axis.repeated for axis in self._axes]
        _fold(nodes, axes[0])
        _fold(nodes.T, axes[1])
        inner = nodes[: axes[0] or None, : axes[1] or None]
        values = np.ascontiguousarray(inner)
        self._smooth.apply(values, values)
        inner[...] = values
        _repeat(nodes.T, axes[1])
        _repeat(nodes, axes[0])

    def stencil(self, radius):
        """Return the sums with an inverse of A; see `ListProduct.stencil`."""
        inverse = self._inverse(self.quadrant[: 4 * radius + 1, : 4 * radius + 1].copy(), radius)
        return _PeriodicSum(self.grid, inverse)


def displacement_on_rows(grid, kernel, cells, p, rows):
    """Return u by the pressures `p` in `cells`, in all cells of some `rows`.

    See `list_product.displacement_on_rows`; this function also suits periodic patches.
    """
    if not grid.periodic:
        return list_product.displacement_on_rows(grid, kernel, cells, p, rows)
    sources = CellList(grid, cells[p != 0])
    return PeriodicListProduct(grid, kernel, cells=sources).apply_on_rows(sources, p[p != 0], rows)


def _fold(nodes, period):
    """Add the nodes beyond a period to those that they repeat."""
    if period:
        nodes[: len(nodes) - period] += nodes[period:]


def _repeat(nodes, period):
    """Copy nodes to those beyond a period."""
    if period:
        nodes[period:] = nodes[: len(nodes) - period]


def _splits(grid):
    """Return the possible splits of a grid."""
    if min(grid.shape) < _MIN_CELLS:
        return []
    splits = [_PeriodicSplit(grid, spacing) for spacing in SPACINGS]
    return [split for split in splits if split.is_possible]


class _PeriodicSplit(Split):
    """Numbers of a split; see `Split`. Nodes must divide the period, and the local part must fit into it."""

    def __init__(self, grid, spacing):
        super().__init__(grid, spacing)
        numbers = list(zip(grid.shape, self.steps, self.sizes, grid.repeats, strict=True))
        self.is_possible = all(
            n % step == 0 and n // step >= _MIN_NODES and self.radius < (n // 2 - _MARGIN) * size
            for n, step, size, repeats in numbers
            if repeats
        )
        self.periods = tuple(
            n // step if repeats else period
            for (n, step, _, repeats), period in zip(numbers, self.periods, strict=True)
        )


class _FreeAxis(Axis):
    """Axis of the free direction of a patch that is periodic in the other one; see `_PeriodicAxis`."""

    repeated = 0

    def __init__(self, n, size, step, period, t):
        super().__init__(n, size, step, period, t)
        self.values = cell_integrals(size * np.arange(n), size, t)


class _PeriodicAxis:
    """Nodes in a direction in which the patch repeats, and Gaussians on them; see `Axis`.

    If `sampled`, a cell's pressure is a sum of waves with values in cell centres; otherwise it is uniform.

    Attributes
    ----------
    repeated : int
        Number of nodes in a period.
    values : ndarray, shape (n // 2 + 1, Gaussians)
        Sums over all copies at the offsets of cells [mm].
    mean, largest : ndarray, shape (Gaussians,)
        Their means and maxima [mm].
    """

    def __init__(self, n, size, step, period, t, sampled):
        half, length = period // 2, n * size
        self.repeated, self.nodes = period, period + WINDOW - 1
        self.weights, window, window_errors = node_window(n, step, 2 * np.pi * np.arange(half + 1) / period)
        # From a whole period of waves on, the waves are below rounding.
        wave = 2 * np.pi / length * np.arange(period + 1)
        waves = np.exp(-((wave / (2 * t[:, None])) ** 2)) * (np.sqrt(np.pi) / t[:, None] * size / length)
        if not sampled:
            waves *= np.sinc(wave * size / (2 * np.pi))
        on_nodes = waves[:, : half + 1] + waves[:, ::-1][:, : half + 1]
        self.spectrum = on_nodes * (period / window**2)
        multiplicity = np.where((np.arange(half + 1) > 0) & (2 * np.arange(half + 1) < period), 2, 1)
        self.errors = np.abs(on_nodes) @ (multiplicity * ((1 + window_errors) ** 2 - 1))
        self.errors += 4 * np.abs(waves[:, half + period % 2 :]).sum(axis=1)
        self.mean, self.largest = waves[:, 0], waves[:, 0] + 2 * np.abs(waves[:, 1:]).sum(axis=1)
        samples = np.zeros((len(t), n // 2 + 1))
        samples[:, : period + 1] = waves
        self.values = transform_even(samples, n).T


class _PeriodicSum:
    """Sums over near cells of a periodic patch, and over arms.

    Parameters
    ----------
    grid : Grid
    quadrant : ndarray
        Coefficients at near offsets in y and x, from 0 on.
    arms : pair of ndarray, shape (rows, offsets in x) and (columns, offsets in y)
        Coefficients at offsets up to half a period, in the first rows and in the first columns.
    """

    def __init__(self, grid, quadrant, arms=()):
        self._sum = LocalSum(quadrant)
        self._arms = [
            (arm, *_ends(arm), flip) for arm, flip in zip(arms, (False, True), strict=False) if len(arm)
        ]
        self._margins = [
            _MARGIN * -(-n // _MARGIN) if repeats else 0
            for n, repeats in zip(quadrant.shape, grid.repeats, strict=True)
        ]
        ny, nx = (n + 2 * margin for n, margin in zip(grid.shape, self._margins, strict=True))
        self._grid = Grid(nx, ny, grid.dx, grid.dy)

    def apply(self, sources, p, targets, out=None):
        """Return the sums at the targets, added to `out` if it is given; see `LocalSum.apply`."""
        p = np.asarray(p, float)
        around, which = self._continued(sources)
        u = self._sum.apply(around, p[which], self._moved(targets), out)
        for table, first, last, flip in self._arms:
            starts, places, order = _lines(targets, flip)
            of, source_places, which = _lines(sources, flip, continued=True)
            sums = np.zeros(len(targets))
            sum_arms(starts, places, of, source_places, p[which], table, first, last, sums)
            u[order] += sums
        return u

    def _moved(self, cells):
        """Return cells in the grid with margins."""
        y, x = self._margins
        return cells.cached(
            ("moved", y, x), lambda: CellList(self._grid, (cells.iy + y) * self._grid.nx + cells.ix + x)
        )

    def _continued(self, cells):
        """Return cells and their copies in the margins, and of which cell each is a copy."""
        margins = tuple(self._margins)

        def make():
            rows, columns, which = cells.iy, cells.ix, np.arange(len(cells))
            (ny, nx), (y, x) = cells.grid.shape, margins
            for low, high, move in ((ny - y, ny, -ny), (0, y, ny)) if y else ():
                part = np.flatnonzero((rows[: len(cells)] >= low) & (rows[: len(cells)] < high))
                rows, columns = np.append(rows, rows[part] + move), np.append(columns, columns[part])
                which = np.append(which, which[part])
            count = len(rows)
            for low, high, move in ((nx - x, nx, -nx), (0, x, nx)) if x else ():
                part = np.flatnonzero((columns[:count] >= low) & (columns[:count] < high))
                rows, columns = np.append(rows, rows[part]), np.append(columns, columns[part] + move)
                which = np.append(which, which[part])
            numbers = (rows + y) * self._grid.nx + columns + x
            order = np.argsort(numbers, kind="stable")
            return CellList(self._grid, numbers[order]), which[order]

        return cells.cached(("continued", *margins), make)


def _lines(cells, flip, continued=False):
    """Return the first cell of each row, or of each column if `flip`, positions in these lines, and the cells' order.

    If `continued`, copies continue each line by half a period on both sides.
    """

    def make():
        lines, places = (cells.ix, cells.iy) if flip else (cells.iy, cells.ix)
        which, (count, period) = np.arange(len(cells)), cells.grid.shape[:: -1 if flip else 1]
        if continued:
            other = places + np.where(2 * places < period, period, -period)
            lines, places, which = np.tile(lines, 2), np.append(places, other), np.tile(which, 2)
        order = np.lexsort((places, lines))
        starts = np.searchsorted(lines[order], np.arange(count + 1))
        return starts, places[order], which[order]

    return cells.cached(("lines", flip, continued), make)


def _ends(arm):
    """Return the least and the largest offset of coefficients of each line that are not zero."""
    there = arm != 0
    first, last = np.argmax(there, axis=1), arm.shape[1] - 1 - np.argmax(there[:, ::-1], axis=1)
    return np.maximum(first, 1), np.where(there.any(axis=1), last, 0)
