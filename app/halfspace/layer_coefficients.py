"""Influence coefficients of layered bodies on a free patch.

Lengths are in thicknesses t of the layer. The displacement by a point force is ``1/r + g(r)`` times the compliance of
the layer's material, with ``g(r) = int_0^inf (S(x) - 1) J0(x r) dx`` and the ratio S of `app.halfspace.layer`. The
coefficient of a cell is the sum of three integrals over the cell: of 1/r, by Love's closed form; of c / sqrt(r^2 + 4)
with c = S(0) - 1, to which g tends far away, also in closed form; and of the *rest* of g, which is smooth and decays
like r^-3. The rest is tabulated, and its integral is computed by Gauss points. Near the origin, cells that are not
small are divided into panels.
"""

from functools import cached_property, lru_cache

import numpy as np

from app.halfspace.hankel import HankelRule
from app.halfspace.layer import displacement_ratio

_DENSITY = 134  # number of points of a table over arcsinh of the distance
_MIN_RADIUS = 4096.0  # of the tables; for a layer much stiffer than its substrate, 1024 S(0)
_MAX_GAUSS_CELL = 0.25  # largest cell of which Gauss points suffice everywhere
_NEAR = 8  # longer sides of a cell within which larger cells need panels
_FAR = 64  # longer sides of a cell beyond which two points in a direction suffice
_POINTS, _FIRST_PANEL = 8, 1.5  # Gauss points of a panel in a larger cell; length of the panel at the origin
MAX_REACH = 30.0  # distance in thicknesses beyond which a layer on a rigid base is not displaced


def layered_coefficients(layer, cell, rows, columns, love):
    """Return influence coefficients of a layered body [mm].

    They are divided by the compliance of the layer's material; `love` has the coefficients of a half-space of this
    material. `cell` is the size (dx, dy) of a cell [mm]; `rows` and `columns` are arrays of offsets in y and x.
    """
    cell = cell[0] / layer.thickness, cell[1] / layer.thickness
    own = love + layer.thickness * layer_tables(layer).integrals(cell, rows, columns)
    if layer.on_rigid_base:
        x, y = cell[0] * np.maximum(columns - 0.5, 0), cell[1] * np.maximum(rows - 0.5, 0)
        own[np.hypot(x, y[:, None]) > MAX_REACH] = 0.0  # below rounding
    return own


def layer_tables(layer):
    """Return a layer's `LayerTables`, which all grids share."""
    mu = float(f"{layer.modulus_ratio:.13g}")  # the same in all units
    return _tables(mu, *layer.poisson)


@lru_cache(maxsize=8)
def _tables(mu, nu1, nu2):
    limit = mu * (1 - nu2) / (1 - nu1)
    radius = _MIN_RADIUS * max(1.0, limit / 4)
    return LayerTables(lambda x: displacement_ratio(x, mu, nu1, nu2), limit, radius)


class LayerTables:
    """Tables of the influence of a layer.

    The influence is the difference between a layered body and a half-space of the layer's material. `ratio` is a
    function that returns S(x) for arrays of x = q t, and `limit` is S(0). The tables reach up to `radius`.
    """

    def __init__(self, ratio, limit, radius):
        from scipy.interpolate import CubicSpline

        self._excess, self._radius = float(limit) - 1.0, radius
        end = np.arcsinh(self._radius)
        v = np.linspace(0.0, end, int(_DENSITY * end))
        r = np.sinh(v)
        image = np.sqrt(r * r + 4)
        rule = HankelRule(r)
        near, far = ratio(rule.near) - 1, ratio(rule.far) - 1
        g = rule.transform(near, far, "J0")
        rest = g - self._excess / image
        even = (1, 0.0), "not-a-knot"
        self._rest_table = CubicSpline(v, rest * image**3, bc_type=even)
        self._tail = rest[-1] * self._radius**3  # rest = tail / r^3 beyond the table
        near, far = (
            (values - self._excess * np.exp(-2 * q)) / q for values, q in ((near, rule.near), (far, rule.far))
        )
        line = rule.transform(near, far, "cos")
        self._line_table = CubicSpline(v, line * image**2, bc_type=even)
        self._line_tail = line[-1] * self._radius**2

    def rest(self, r):
        """Return the short-range part of `influence`, at distances r."""
        inside = self._rest_table(np.arcsinh(np.minimum(r, self._radius))) / np.sqrt(r * r + 4) ** 3
        return np.where(r <= self._radius, inside, self._tail / np.maximum(r, self._radius) ** 3)

    def influence(self, r):
        """Return the layer's displacement by a point force at distances r."""
        return self._excess / np.sqrt(r * r + 4) + self.rest(r)

    def least_influence(self, near, far):
        """Return lower bounds of 1 / r + `influence` from distances `near` to distances `far`, arrays of one shape.

        f = 1 / r + c / sqrt(r^2 + 4) falls with r and is positive, because c is at least -1. So its least value is at
        the larger distance, of the whole range or of each piece of the spline of the rest.
        """
        both = np.stack([near.ravel(), far.ravel()], axis=1)
        pieces = np.searchsorted(self._rest_table.x, np.arcsinh(both), side="right") - [1, 0]
        rest, total = (
            np.minimum.reduceat(least, pieces.ravel())[::2].reshape(far.shape)
            for least in self._least_of_pieces
        )
        return np.maximum(1 / far + self._excess / np.sqrt(far * far + 4) + rest, total)

    @cached_property
    def _least_of_pieces(self):
        """Lower bounds of `rest`, and of f + `rest`, in each piece of its spline, and beyond; then infinity.

        A polynomial is at least its smallest Bernstein coefficient.
        """
        v, (a, b, c, d) = self._rest_table.x, self._rest_table.c
        h, r = np.diff(v), np.sinh(v)
        image = np.sqrt(r * r + 4)
        scaled = np.min(
            [d, d + c * h / 3, d + (2 * c + b * h) * h / 3, d + (c + (b + a * h) * h) * h], axis=0
        )
        rest = scaled / np.where(scaled < 0, image[:-1], image[1:]) ** 3
        beyond = [min(self._tail / self._radius**3, 0.0), np.inf]
        return [*rest, *beyond], [*(1 / r[1:] + self._excess / image[1:] + rest), *beyond]

    def beyond_base(self, r):
        """Return the displacement by a point force minus that of the base, at distances r above 0.

        It decays like r^-3; on a rigid base, faster.
        """
        image = np.sqrt(r * r + 4)
        values = self.rest(r) - self._excess * 4 / (r * image * (r + image))
        return values if self._excess > -1 else np.where(r > MAX_REACH, 0.0, values)

    def line_beyond_base(self, x):
        """Return half the integral of `beyond_base` over a line, at distances x above 0 from the line."""
        inside = self._line_table(np.arcsinh(np.minimum(x, self._radius))) / (
            np.minimum(x, self._radius) ** 2 + 4
        )
        rest = np.where(x <= self._radius, inside, self._line_tail / np.maximum(x, self._radius) ** 2)
        values = rest - self._excess / 2 * np.log1p(4 / x**2)
        return values if self._excess > -1 else np.where(x > MAX_REACH, 0.0, values)

    def integrals(self, cell, rows, columns):
        """Return the layer's part of influence coefficients, in thicknesses.

        It is the integral of `influence` over each cell. `cell` is the size (dx, dy) of a cell; `rows` and `columns`
        are arrays of offsets in y and x. The shape is (rows, columns).
        """
        dx, dy = cell
        x, y, widest = dx * columns[None, :], dy * rows[:, None], max(dx, dy)
        total = self._excess * _rectangle(x, y, dx / 2, dy / 2, 2.0)
        cells = np.maximum(x, y) / widest
        near = _NEAR if widest > _MAX_GAUSS_CELL else 0
        for points, low, high in ((3, near, _FAR), (2, _FAR, np.inf)):
            j, i = np.nonzero((cells >= low) & (cells < high))
            total[j, i] += self._gauss_integrals(x[0, i], y[j, 0], dx, dy, points)
        j, i = np.nonzero(cells < near)
        total[j, i] += self._near_integrals(cell, rows, columns, j, i)
        return total

    def _gauss_integrals(self, x, y, dx, dy, points):
        """Return integrals of `rest` over cells at (x, y), by Gauss points."""
        nodes, weights = np.polynomial.legendre.leggauss(points)
        total = np.zeros(x.shape)
        for a, in_x in zip(nodes, weights, strict=True):
            for b, in_y in zip(nodes, weights, strict=True):
                total += in_x * in_y * self.rest(np.hypot(x + a * dx / 2, y + b * dy / 2))
        return dx * dy / 4 * total

    def _near_integrals(self, cell, rows, columns, j, i):
        """Return integrals of `rest` over the cells ``rows[j], columns[i]``, which are not far from the origin."""
        if not j.size:
            return 0.0
        across = [_panels(cell[0], columns[k]) for k in range(i.max() + 1)]
        x, in_x = (np.concatenate(parts) for parts in zip(*across, strict=True))
        starts = np.cumsum([0, *(len(points) for points, _ in across[:-1])])
        table = np.zeros((j.max() + 1, len(across)))
        for k in np.unique(j):
            y, in_y = _panels(cell[1], rows[k])
            table[k] = np.add.reduceat(in_y @ self.rest(np.hypot(x, y[:, None])) * in_x, starts)
        return table[j, i]


def _panels(side, offset):
    """Return points and weights of a composite Gauss rule over a cell, in one direction.

    The cell has the `side`, and its centre at `offset` times the side. Panels are longer at larger distances from the
    origin, around which the function is even.
    """
    low, high = max((offset - 0.5) * side, 0.0), (offset + 0.5) * side
    if side <= _MAX_GAUSS_CELL:
        low, edges, points = (offset - 0.5) * side, [], 3
    else:
        edges, points = (
            _FIRST_PANEL * 2.0 ** np.arange(max(0, int(np.log2(high / _FIRST_PANEL))) + 1),
            _POINTS,
        )
        edges = [edge for edge in edges if low < edge < high]
    edges = np.array([low, *edges, high])
    nodes, weights = np.polynomial.legendre.leggauss(points)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    twice = 2 if low == 0 else 1
    return (middle + half * nodes).ravel(), twice * (half * weights).ravel()


def _rectangle(x, y, a, b, z):
    """Integrate 1 / sqrt(r^2 + z^2) over a cell with half sides a, b."""

    def corner(x, y):
        to_x, to_y, to_all = np.hypot(x, z), np.hypot(y, z), np.sqrt(x * x + y * y + z * z)
        angle = np.arctan2(x * y, z * to_all)
        return x * np.arcsinh(y / to_x) + y * np.arcsinh(x / to_y) - z * angle

    return corner(x + a, y + b) - corner(x - a, y + b) - corner(x + a, y - b) + corner(x - a, y - b)
