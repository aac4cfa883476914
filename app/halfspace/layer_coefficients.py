"""Influence coefficients of layered bodies on a free patch.

Lengths are in thicknesses t of the layer. The displacement by a point force is ``1/r + g(r)`` times the compliance of
the layer's material, with ``g(r) = int_0^inf (S(x) - 1) J0(x r) dx`` and the ratio S of `app.halfspace.layer`. The
coefficient of a cell is the sum of three integrals over the cell: of 1/r, by Love's closed form; of c / sqrt(r^2 + 4)
with c = S(0) - 1, to which g tends far away, also in closed form; and of the *rest* of g, which is smooth and decays
like r^-3. The rest is tabulated, and its integral is computed by Gauss points. Near a cell that is not small, the
integral is computed from a table of ``Phi(r) = int_0^r rest r dr``: the integral over a rectangle with a corner at the
origin is a sum of two integrals of Phi over angles.
"""

from functools import lru_cache

import numpy as np

from app.halfspace.hankel import HankelRule
from app.halfspace.layer import displacement_ratio

_TABLE = 1024  # number of points of a table
_MIN_RADIUS = 1024.0  # of the tables; for a layer much stiffer than its substrate, 256 S(0)
_MAX_GAUSS_CELL = 0.25  # largest cell of which Gauss points suffice everywhere
_NEAR = 8  # longer sides of a cell within which larger cells need Phi
_FAR = 64  # longer sides of a cell beyond which two points in a direction suffice
_ANGLES = 64  # Gauss points of an angle
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
        v = np.linspace(0.0, np.arcsinh(self._radius), _TABLE)
        r = np.sinh(v)
        image = np.sqrt(r * r + 4)
        rule = HankelRule(r)
        near, far = ratio(rule.near) - 1, ratio(rule.far) - 1
        g = rule.transform(near, far, "J0")
        integral = r * r * rule.transform(near / rule.near, far / rule.far, "J1")  # of g r dr from 0
        rest = g - self._excess / image
        even = (1, 0.0), "not-a-knot"
        self._rest_table = CubicSpline(v, rest * image**3, bc_type=even)
        self._tail = rest[-1] * self._radius**3  # rest = tail / r^3 beyond the table
        self._phi_table = CubicSpline(v, integral - self._excess * (image - 2), bc_type=even)

    def rest(self, r):
        """Return the short-range part of `influence`, at distances r."""
        inside = self._rest_table(np.arcsinh(np.minimum(r, self._radius))) / np.sqrt(r * r + 4) ** 3
        return np.where(r <= self._radius, inside, self._tail / np.maximum(r, self._radius) ** 3)

    def influence(self, r):
        """Return the layer's displacement by a point force at distances r."""
        return self._excess / np.sqrt(r * r + 4) + self.rest(r)

    def _phi(self, r):
        """Return the integral of `rest`(s) s ds from 0 to r."""
        inside = self._phi_table(np.arcsinh(np.minimum(r, self._radius)))
        return inside + self._tail * np.maximum(0.0, 1 / self._radius - 1 / np.maximum(r, self._radius))

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
        total[j, i] += self._corner_integrals(cell, rows[j], columns[i])
        return total

    def _gauss_integrals(self, x, y, dx, dy, points):
        """Return integrals of `rest` over cells at (x, y), by Gauss points."""
        nodes, weights = np.polynomial.legendre.leggauss(points)
        total = np.zeros(x.shape)
        for a, in_x in zip(nodes, weights, strict=True):
            for b, in_y in zip(nodes, weights, strict=True):
                total += in_x * in_y * self.rest(np.hypot(x + a * dx / 2, y + b * dy / 2))
        return dx * dy / 4 * total

    def _corner_integrals(self, cell, rows, columns):
        """Return integrals of `rest` over cells, from their corners."""
        if not rows.size:
            return 0.0
        x, y = ((np.arange(k.max() + 1) + 0.5) * d for k, d in zip((columns, rows), cell, strict=True))
        to_corner = self._triangles(x, y[:, None]) + self._triangles(y[:, None], x)
        # Row and column -1 are the mirror images of row and column 0.
        to_corner = np.pad(to_corner, ((1, 0), (1, 0)), mode="edge")
        to_corner[0] *= -1
        to_corner[:, 0] *= -1
        return np.diff(np.diff(to_corner, axis=0), axis=1)[rows, columns]

    def _triangles(self, u, v):
        """Return the integrals of `rest` over triangles.

        The corners are (0, 0), (u, 0) and (u, v), with arrays u and v above 0 that are broadcast.
        """
        nodes, weights = np.polynomial.legendre.leggauss(_ANGLES)
        half, total = np.arcsinh(v / u) / 2, 0.0
        for node, weight in zip(nodes, weights, strict=True):
            stretch = np.cosh(half * (node + 1))
            total = total + weight * self._phi(u * stretch) / stretch
        return half * total


def _rectangle(x, y, a, b, z):
    """Integrate 1 / sqrt(r^2 + z^2) over a cell with half sides a, b."""

    def corner(x, y):
        to_x, to_y, to_all = np.hypot(x, z), np.hypot(y, z), np.sqrt(x * x + y * y + z * z)
        angle = np.arctan2(x * y, z * to_all)
        return x * np.arcsinh(y / to_x) + y * np.arcsinh(x / to_y) - z * angle

    return corner(x + a, y + b) - corner(x - a, y + b) - corner(x + a, y - b) + corner(x - a, y - b)
