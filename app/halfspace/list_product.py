"""Products u = A p from a list of cells to another list of cells.

If few cells are in contact, a product on all cells of a grid takes much more time than is necessary. Here the time
depends on the lists, and no array has the size of the grid. The method is Ewald's split: the influence coefficients K
of cells are the sum of a smooth part S and a local part.

A point force displaces the surface by k(r) at the distance r. From a radius on, k is a sum of Gaussians that are not
narrower than 1 / a, where a is three over the radius. For half-spaces, ``1/r = 2/sqrt(pi) * (integral of exp(-r^2 t^2)
over t > 0)`` shows this: those with t > a are negligible there. The images of a force in a layer have similar
integrals. The weights w_k for fixed t_k are fitted to k by least squares. A Gaussian is a product of a function of x
and a function of y, and so is its integral over a cell:

    S(x, y) = sum_k w_k g_k(x) g_k(y),    g_k(x) = integral of exp(-t_k^2 s^2) over |s - x| < dx / 2

- *Local part.* A table has K - S at all offsets up to the radius. The sums over pairs of near cells are products of a
  pressure and an entry of the table.
- *Smooth part.* S has hardly any waves shorter than two spacings of a coarse grid of nodes. A window spreads pressures
  to the nodes around each cell, as in non-uniform fast Fourier transforms. The nodal values are padded by zeros,
  transformed, and multiplied by the spectrum of S over the square of that of the window. The window gathers the
  displacements of cells from those of the nodes.

Error bound
-----------
`ListProduct.error_bound` limits the error of all coefficients. So the error of u is at most this number times the sum
of ``|p|``. The number is the sum of two.

*Fit.* The error of a coefficient beyond the radius is an integral over a cell of the error e(r) of the fit. So it is at
most the area of a cell times the largest ``|e|`` from half the diagonal of a cell inside the radius to the diagonal of
the patch. As a function of ln r, e is analytic and bounded for imaginary parts up to pi / 4. So up to rounding it is a
polynomial of degree 200 on this interval. If ``|e|`` is at most E at the 600 Chebyshev points, then it is at most ``E /
cos(pi / 6)`` in between [1]_.

*Nodes.* Consider Gaussian k in one direction, with lengths in spacings of nodes. Let M be the period of the nodes, and
C the coefficient that window, transforms and window make of it. Let g be g_k, periodic and smooth: ``g(x) = sum_n (g_k
f)(x + n M)``, where f fades from 1 to 0 around abs(x) = M / 2, and ``sum_n f(x + n M) = 1``. Let c_q be the Fourier
coefficients of g.

1. ``|g - g_k| <= (1 - f) g_k(0)`` at all offsets of the patch, because g_k is largest at 0.
2. The samples of g at nodes have the coefficients ``d_q = sum_m c_(q + m M)``. The sum of their waves with ``|q| <= M /
   2`` differs from g by at most twice the sum of ``|c_q|`` over all other q. Samples at twice as many points give all
   c_q that are not below rounding.
3. The window makes ``W_q exp(i q x) (1 + e_q(x))`` of a wave of the nodes, with a factor W_q that the spectrum is
   divided by. So C is the sum of the waves ``d_q exp(i q (x - x')) (1 + e_q(x)) (1 + conj(e_q(x')))``. It differs from
   the sum of waves in 2. by at most the sum of ``|d_q| ((1 + e_q)^2 - 1)``, where e_q is the largest ``|e_q(x)|``. Cell
   centres have as many positions x relative to nodes as there are cells between nodes, so the largest one is found.

Let D_k be the sum of the three numbers for x, and D'_k for y. The Gaussians g_k are between 0 and dx, or dy. So the
error of a coefficient is at most ``sum_k |w_k| ((dx + D_k) (dy + D'_k) - dx dy)``.

No offset and no position is left out. The largest error of a coefficient is a third to a half of the bound. Rounding is
not included (about 1e-13 of the coefficients), nor is the error of the coefficients of layers themselves.

References
----------
.. [1] H. Ehlich, K. Zeller, Schwankung von Polynomen zwischen Gitterpunkten, Math. Z. 86 (1964) 41-44.
"""

import numpy as np
from scipy.special import erf, erfc

from app.base.errors import InputError
from app.halfspace.cell_list import CellList, LocalSum, estimate_pairs
from app.halfspace.fft.lengths import fast_length
from app.halfspace.fft.multiplier import EvenMultiplier, transform_even
from app.halfspace.list_loops import gather, gather_on_rows, spread

# Either part of the error bound is about 1e-8 of S(0, 0).
_SPLIT = 0.4  # a times the spacing of nodes
_CUTOFF = 3.0  # a times the radius of the local part
WINDOW = 12  # nodes of the window in each direction; even
_WINDOW_SHAPE = 1.9 * WINDOW  # beta of the window exp(beta (sqrt(1 - z^2) - 1)), abs(z) < 1
_FADE, _FADE_NODES = 4.3, 10  # erfc(4.3) is 1e-9; nodes in which a Gaussian fades out, up to half the period
_GAUSSIANS = 48
_FIT_POINTS, _FIT_FACTOR = 600, 1.16  # 1 / cos(pi / 6), rounded up
_FIT_CUTOFF = 1e-8  # smallest singular value relative to the largest, so that weights are not large
_LAYER_SPLIT = 2.5  # largest t of a Gaussian times the thickness, for the displacement by layers alone
_NEAR_LAYER = 0.02  # least distance over the thickness there
_LEAST_INVERSE = 1e-3  # least eigenvalue of a preconditioner, over the largest one
_CELL = np.polynomial.legendre.leggauss(4)  # Gaussians are at least ten times as wide as a cell.
SPACINGS = 4, 8, 16, 32, 64  # longer sides of cells between nodes
_MOST_NODES = 150  # in each direction, if nothing is known about the lists
MAX_SLOWER = 1.5  # largest time of a product that is kept, over that with the best spacing
_LARGEST_TABLE = 4096  # cells of a grid on which all pairs of cells are summed
# Times in units of a point of a transform.
_PAIR, _WINDOW_NODE, _NODE = 0.7, 0.05, 0.6  # of a pair of segments, a node of a window, and a node
_ROW_PAIR = 0.05  # of a pair of cells in `displacement_on_rows`


class ListProduct:
    """Product u = A p between lists of cells, on a free patch of half-spaces or layers.

    Any rank that has all pressures can compute u in any cells. So a product sends no messages, and is the same on any
    number of ranks, up to rounding.

    Parameters
    ----------
    grid : Grid
        The grid; `suits` must be true.
    kernel : HalfSpaceKernel
        The kernel.
    cells : CellList, optional
        Cells about as many and as clustered as in later products. The spacing of nodes is chosen for them.
    spacing : int, optional
        Spacing of nodes in units of a cell's longer side; 0 for sums over all pairs of cells.

    Attributes
    ----------
    error_bound : float
        Largest error of an influence coefficient [mm / (N/mm2)]. The error of u is at most this number times the sum of
        ``|p|`` [N/mm2] over all sources.
    radius : float
        Radius of the local part [mm].
    """

    def __init__(self, grid, kernel, *, cells=None, spacing=None):
        if not self.suits(grid, kernel):
            raise InputError("list products: must be a free patch of half-spaces or layered bodies")
        self.grid, self.kernel = grid, kernel
        self._split = split = self.choose_split(grid, cells) if spacing is None else Split(grid, spacing)
        self.spacing, self.radius = split.spacing, split.radius
        self.diagonal = float(kernel.coefficients(grid, np.arange(1), 1)[0, 0])
        if not split.spacing:
            self._local = LocalSum(kernel.coefficients(grid, np.arange(grid.ny), grid.nx))
            self.error_bound = 0.0
            return
        nearest = split.radius - np.hypot(grid.dx, grid.dy) / 2
        t, weights, misfit = fit_gaussians(kernel.point_influence, split.a, nearest, np.hypot(*grid.sides))
        numbers = zip(grid.shape, split.sizes, split.steps, split.periods, strict=True)
        self._axes = in_y, in_x = [Axis(*each, t) for each in numbers]
        self._nodes = np.empty((in_y.nodes, in_x.nodes))
        self._smooth = EvenMultiplier(self._nodes.shape, split.periods)
        spectrum = (in_x.spectrum.T * weights) @ in_y.spectrum
        self._smooth.set_spectrum(lambda columns, rows: spectrum[columns])
        self._local = LocalSum(self._local_part(t, weights))
        self.error_bound = misfit * grid.cell_area + self._error_of_nodes(weights)

    @staticmethod
    def suits(grid, kernel):
        """Return whether the patch is free, and the bodies half-spaces or layered."""
        return not grid.periodic and kernel.has_image_sums

    def _error_of_nodes(self, weights):
        """Return a bound of the error of S, given the weights of the Gaussians [mm / (N/mm2)]."""
        in_y, in_x = self._axes
        products = (in_y.errors + in_y.largest) * (in_x.errors + in_x.largest)
        return float(np.abs(weights) @ (products - in_y.largest * in_x.largest))

    def _local_part(self, t, weights):
        """Return K - S at offsets up to the radius, else 0."""
        grid, sides = self.grid, zip(self.grid.shape, self._split.sizes, strict=True)
        y, x = (size * np.arange(min(n, int(self.radius / size) + 1)) for n, size in sides)
        smooth = (cell_integrals(y, grid.dy, t) * weights) @ cell_integrals(x, grid.dx, t).T
        table = self.kernel.coefficients(grid, np.arange(len(y)), len(x)) - smooth
        table[np.hypot(y[:, None], x) > self.radius] = 0.0
        return table

    def apply(self, sources, p, targets, out=None):
        """Return u at the targets [mm].

        Parameters
        ----------
        sources, targets : CellList
            Cells with pressures, and cells in which u is computed.
        p : ndarray, shape (sources,)
            Pressures [N/mm2].
        out : ndarray, shape (targets,), optional
            Array for u.
        """
        u = self._local.apply(sources, p, targets)
        if self.spacing and len(sources) and len(targets):
            gather(targets.ix, targets.iy, *self._nodal_values(sources, p), np.empty(WINDOW), u)
        if out is None:
            return u
        out[:] = u
        return out

    def apply_on_rows(self, sources, p, rows):
        """Return u in all cells of some `rows`, a slice, shape (rows, nx) [mm]; see `apply`."""
        p, u = np.array(p, float), np.zeros((rows.stop - rows.start, self.grid.nx))
        if self.spacing and len(sources):
            nodal_values, lines = self._nodal_values(sources, p), np.empty((WINDOW, self.grid.nx))
            gather_on_rows(rows.start, *nodal_values, lines, u)
        self._local.add_on_rows(sources, p, rows.start, u)
        return u

    def _nodal_values(self, sources, p):
        """Return the smooth part of u at the nodes [mm], and the weights of nodes in x and y."""
        nodes, (in_y, in_x) = self._nodes, (axis.weights for axis in self._axes)
        nodes[:] = 0.0
        spread(sources.ix, sources.iy, np.array(p, float), in_x, in_y, np.empty(WINDOW), nodes)
        self._convolve(nodes)
        return nodes, in_x, in_y

    def _convolve(self, nodes):
        """Replace the values of the nodes by their convolution with S."""
        self._smooth.apply(nodes, nodes)

    @staticmethod
    def choose_split(grid, cells):
        """Return the split whose products from `cells` to `cells` take the least time."""
        if grid.n <= _LARGEST_TABLE:
            return Split(grid, 0)
        splits = [Split(grid, spacing) for spacing in SPACINGS]
        if cells is None:
            return next((s for s in splits if max(grid.shape) <= _MOST_NODES * min(s.steps)), splits[-1])
        return cells.cached("split", lambda: min(splits, key=lambda split: split.cost(cells, cells)))

    def cost(self, sources, targets):
        """Estimate the time of a product, in units of `EvenMultiplier.points`.

        The time of a product on all cells is the product of its `periods` in this unit.
        """
        return self._split.cost(sources, targets)

    def stencil(self, radius):
        """Return the sums with an inverse of A, cut off at `radius` cells.

        The inverse is that of a periodic patch of 8 times the radius, and zero on constants. Its off-diagonal
        coefficients are negative (nearly all, if cells are long), so the cut makes it positive definite. If it does
        not, as for stiff layers as thin as a cell, the diagonal coefficient is raised.
        """
        offsets = np.arange(4 * radius + 1)
        return LocalSum(self._inverse(self.kernel.coefficients(self.grid, offsets, len(offsets)), radius))

    @staticmethod
    def _inverse(waves, radius):
        """Return the inverse's coefficients, given those of A at offsets up to 4 times the radius; see `stencil`."""
        period = 8 * radius
        for _ in range(2):
            waves = transform_even(waves, period).T.copy()
        inverse = np.divide(1.0, waves, out=np.zeros_like(waves), where=waves > 0)
        inverse[0, 0] = 0.0
        for _ in range(2):
            inverse = transform_even(inverse, period).T.copy() / period
        inverse[np.hypot(*np.ogrid[: len(inverse), : len(inverse)]) > radius] = 0.0
        waves = inverse.copy()  # transforms overwrite
        for _ in range(2):
            waves = transform_even(waves, period).T.copy()
        inverse[0, 0] += max(_LEAST_INVERSE * waves.max() - waves.min(), 0.0)
        return inverse[: radius + 1, : radius + 1]


def displacement_on_rows(grid, kernel, cells, p, rows):
    """Return u by the pressures `p` in `cells`, in all cells of some `rows`, a slice, shape (rows, nx) [mm].

    The spacing of nodes is the fastest one. For the error see `ListProduct.error_bound`.
    """
    sources, p = CellList(grid, cells[p != 0]), p[p != 0]

    def cost(spacing):
        split = Split(grid, spacing)
        area = (2 * split.radius) ** 2 / grid.cell_area
        return _ROW_PAIR * len(sources) * area + _NODE * split.periods[0] * split.periods[1]

    spacing = 0 if grid.n <= _LARGEST_TABLE else min(SPACINGS, key=cost)
    return ListProduct(grid, kernel, spacing=spacing).apply_on_rows(sources, p, rows)


class Split:
    """Numbers of a split with the given spacing of nodes; see `ListProduct`."""

    def __init__(self, grid, spacing):
        self.spacing, self.sizes = spacing, (grid.dy, grid.dx)
        if not spacing:
            self.radius, self.periods = float(np.hypot(*grid.sides)), (0, 0)
            return
        self.steps = [round(spacing * max(self.sizes) / size) for size in self.sizes]
        self.a = _SPLIT / max(step * size for step, size in zip(self.steps, self.sizes, strict=True))
        self.radius = _CUTOFF / self.a
        nodes = (-(-n // step) for n, step in zip(grid.shape, self.steps, strict=True))
        self.periods = tuple(fast_length(2 * (n + _FADE_NODES), even=True) for n in nodes)

    def cost(self, sources, targets):
        """Estimate the time of a product; see `ListProduct.cost`."""
        pairs = estimate_pairs(sources, targets, [self.radius / size for size in self.sizes])
        windows = WINDOW**2 * (len(sources) + len(targets)) if self.spacing else 0
        return _PAIR * pairs + _WINDOW_NODE * windows + _NODE * self.periods[0] * self.periods[1]


class Axis:
    """Nodes in one direction, and Gaussians ``exp(-t^2 s^2)`` on them.

    Parameters
    ----------
    n, size : int, float
        Number of cells, and their size [mm].
    step : int
        Cells between nodes.
    period : int
        Number of nodes, with padding.
    t : ndarray
        Inverse widths of the Gaussians [1/mm].

    Attributes
    ----------
    weights : ndarray, shape (cells between nodes, nodes)
        Weights of the window's nodes around a cell.
    spectrum : ndarray, shape (Gaussians, period // 2 + 1)
        Spectra of the integrals over a cell, divided by the square of the window's [mm].
    errors : ndarray, shape (Gaussians,)
        Largest errors of the integrals [mm].
    largest : float
        Upper bound of the integrals [mm].
    """

    def __init__(self, n, size, step, period, t):
        self.largest = size
        self.nodes = (n - 1) // step + WINDOW
        half = period // 2
        self.weights, window, window_errors = node_window(n, step, 2 * np.pi * np.arange(half + 1) / period)

        # Twice as many points as nodes show the waves that nodes do not resolve.
        x, gap = np.arange(period + 1) / 2, half - (n - 0.5) / step
        points = np.zeros((len(t), period + 1))
        for image in (x - period, x, x + period):
            fade = (erf(_FADE / gap * (image + half)) - erf(_FADE / gap * (image - half))) / 2
            points += fade * np.exp(-(np.outer(step * size * t, image) ** 2))
        waves = transform_even(points, 2 * period) * (size / (2 * period))
        waves *= np.sinc(np.arange(period + 1) / (period * step))  # mean over a cell
        on_nodes = waves[:, : half + 1] + waves[:, : half - 1 : -1]
        self.spectrum = on_nodes * (period / window**2)
        multiplicity = np.where(np.arange(half + 1) % half, 2, 1)
        self.errors = np.abs(on_nodes) @ (multiplicity * ((1 + window_errors) ** 2 - 1))
        self.errors += 4 * np.abs(waves[:, half:]).sum(axis=1) + erfc(_FADE) * size


def node_window(n, step, waves):
    """Return the weights of nodes around cells, and what they make of waves.

    Parameters
    ----------
    n, step : int
        Number of cells, and of cells between nodes.
    waves : ndarray
        Wave numbers, for a spacing of nodes of 1.

    Returns
    -------
    weights : ndarray, shape (step, WINDOW)
        Weights for the cells between two nodes.
    factors, errors : ndarray, shape (waves,)
        Factors on the waves, and the largest relative errors of these factors.
    """
    cells = (np.arange(min(n, step)) + 0.5) / step
    nodes = np.arange(WINDOW) + 1 - WINDOW // 2
    z = (cells[:, None] - nodes) * 2 / WINDOW
    weights = np.zeros((step, WINDOW))
    weights[: len(cells)] = near = np.exp(_WINDOW_SHAPE * (np.sqrt(1 - z**2) - 1))
    windows = near @ np.exp(1j * np.outer(nodes, waves)) * np.exp(-1j * np.outer(cells, waves))
    factors = windows.real.mean(axis=0)
    return weights, factors, np.abs(windows / factors - 1).max(axis=0)


def fit_gaussians(point_force, a, nearest, longest, relative=False):
    """Fit a sum of Gaussians to the displacement by a point force.

    Parameters
    ----------
    point_force : callable
        Function that returns the displacement at distances [mm/N].
    a : float
        Largest inverse width of a Gaussian [1/mm].
    nearest, longest : float
        Distances between which the sum must be right [mm].
    relative : bool
        True to fit the displacement times the distance.

    Returns
    -------
    t : ndarray
        Inverse widths [1/mm].
    weights : ndarray
        Weights [mm/N].
    error : float
        Bound of the error at all distances between the two [mm/N].
    """
    places, weights = np.polynomial.legendre.leggauss(_GAUSSIANS)
    stretch = np.log1p(a * longest)
    growth = np.exp(stretch * (1 + places) / 2)
    t, weights = a * (growth - 1) / np.expm1(stretch), weights * growth
    points = np.cos(np.pi * (np.arange(_FIT_POINTS) + 0.5) / _FIT_POINTS)
    r = nearest * max(longest / nearest, 2.0) ** ((1 + points) / 2)
    values, terms = point_force(r), weights * np.exp(-(np.outer(r, t) ** 2))
    scale = r if relative else np.ones(r.size)
    factors = np.linalg.lstsq(scale[:, None] * terms, scale * values, rcond=_FIT_CUTOFF)[0]
    error = np.abs(terms @ factors - values).max()
    return t, weights * factors, _FIT_FACTOR * float(error)


def uniform_displacement(kernel, cells):
    """Return the displacement of listed cells by pressure 1 on all cells of a free patch [mm / (N/mm2)].

    The part of half-spaces is a closed form. The part of layers is fitted by Gaussians that are no narrower than half
    the thickness (relative error of the sum up to 1e-5, if the layer is nearly incompressible on a rigid base).
    """
    grid = cells.grid
    y, x = (cells.iy + 0.5) * grid.dy, (cells.ix + 0.5) * grid.dx
    sides = [(b, a) for b in (y, grid.sides[1] - y) for a in (x, grid.sides[0] - x)]
    # Each of the four rectangles between a cell and the corners of the patch has the cell at a corner.
    total = sum(a * np.arcsinh(b / a) + b * np.arcsinh(a / b) for b, a in sides)
    if kernel.layers:
        thinnest, longest = min(layer.thickness for layer in kernel.layers), np.hypot(*grid.sides)
        nearest = _NEAR_LAYER * min(thinnest, longest)
        narrowest = _LAYER_SPLIT / thinnest
        t, weights, _ = fit_gaussians(kernel.layer_influence, narrowest, nearest, longest, relative=True)
        in_y, rows = _side_integrals(t, y, grid.sides[1])
        in_x, columns = _side_integrals(t, x, grid.sides[0])
        for each_y, each_x in zip(weights[:, None] * in_y, in_x, strict=True):
            total += each_y[rows] * each_x[columns]
    return kernel.compliance * total


def _side_integrals(t, x, side):
    """Return integrals of ``exp(-t^2 s^2)`` from the ends of a side, shape (Gaussians, places).

    Return also the place of each x, a distance from one end.
    """
    x, places = np.unique(x, return_inverse=True)
    return (erf(np.outer(t, x)) + erf(np.outer(t, side - x))) * (np.sqrt(np.pi) / 2 / t)[:, None], places


def cell_integrals(x, size, t):
    """Return integrals of ``exp(-t^2 s^2)`` over cells with centres x, shape (cells, Gaussians)."""
    places, weights = _CELL
    points = x[:, None, None] + size / 2 * places
    return np.exp(-((t[:, None] * points) ** 2)) @ (size / 2 * weights)
