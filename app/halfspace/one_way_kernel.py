"""Kernel of bodies under a pressure that repeats in one direction.

The pressure repeats in y with the period L, and the patch is free in x; or the other way round. At a distance r a point
force displaces the surface of a half-space by 1/r, for compliance 1. The sum over all copies of the force diverges, so
a constant is subtracted. The result is a sum over waves along the period with the wave numbers q_k = 2 pi k / L and the
modified Bessel function K0:

    K(x, y) = (2 / L) ln(D / |x|) + (4 / L) sum_{k > 0} K0(q_k |x|) cos(q_k y)

The first term is the line contact of plane strain. D is the distance from a line of force at which the displacement is
zero, on average over the period. D is arbitrary, and an approach depends on it. We take twice the longer side of the
patch, or four thicknesses of a layer if this is more, or for a stiff layer 2 t sqrt(S(0)), about the length on which
it bends and stretches. Then A is positive definite, and no influence coefficient of
half-spaces is negative.

Coefficients are integrals of K over cells. Far from the line x = 0, few waves are needed. Near it, K is the sum over
the copies at y = m L with |m| <= M, and a smooth rest. With the distance r_m from copy m, the Legendre polynomials P_l,
Hurwitz's zeta function, and Euler's constant gamma,

    K = sum_{|m| <= M} 1/r_m + sum_{l = 2, 4, ...} 2 r^l P_l(y / r) zeta(l + 1, M + 1) / L^(l+1)
        + (2 / L) (ln(D / 2 L) - H_M + gamma),    H_M = 1 + 1/2 + ... + 1/M

Both sums are exact up to rounding where they are used.

A layer of thickness t on a substrate displaces the surface far away as the substrate does, S(0)/r
(`app.halfspace.layer`). So a layered body adds to S(0) K the sum over copies of a function G(r) that decays like r^-3.
Three copies are integrated over cells as on a free patch. The effect of further copies is smooth, and is interpolated
by polynomials. Their sum ends by a smooth taper w(y): the sum of the smooth function (1 - w) G over copies is the same
for all y up to rounding, so it is an integral over y. Far from the line x = 0, the whole sum over copies is this
integral, and is tabulated (`LayerTables.line_beyond_base`). The cost does not depend on the ratios of thickness, period
and cells.
"""

from functools import lru_cache
from itertools import pairwise
from math import comb

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from app.halfspace.chebyshev import chebyshev_nodes, fit_even_chebyshev
from app.halfspace.kernel import Kernel
from app.halfspace.layer_coefficients import layer_tables, layered_coefficients
from app.halfspace.love import love_coefficients

_DATUM_SIDES = 2.0  # D over the longer side of the patch, or over the reach of layers if this is more
_NEAR = 0.125  # distance from the line x = 0, in periods, from which waves are summed
_COPIES = 4  # M
_LARGEST_ORDER = 30  # of Legendre polynomials: the rest is below (1.4 / (M + 1))^32
_NEGLIGIBLE = 40.0  # q |x| from which K0 is below rounding
_WAVES = int(_NEGLIGIBLE / (2 * np.pi * _NEAR)) + 1
_GAUSS = np.polynomial.legendre.leggauss(16)  # exact for the powers of the smooth rest
# Sums over the copies of a force on a layered body, lengths in periods:
_REACH = 4.0  # distance from the line x = 0 from which waves along the period are negligible
_TAPER_CENTRE, _TAPER_WIDTH = (
    9.5,
    1.6,
)  # distance of a copy at which its weight is 1/2, and width of the decrease
_TAPER_RANGE = 4.8  # widths on each side of the centre after which the weight is 1 or 0
_LEAST_DISTANCE = 1.25  # of the further copies from any cell of the period
_DIGITS = 13.0  # half the logarithm of the accuracy of polynomials across the period
_ROWS = 10  # number of polynomials along the period
_INFINITY = 1e6  # end of the integral over the far field, in scales of this field


class OneWayKernel(Kernel):
    """Kernel of bodies under pressure periodic in one direction.

    Parameters
    ----------
    base : Kernel
        Kernel of the bodies on a free patch.
    axis : int
        0 if the pressure repeats in y, 1 if it repeats in x.
    period : float
        Period L [mm].
    datum : float
        Distance D at which a line of force does not displace the surface [mm].
    """

    encloses_images = has_image_sums = True
    base = None

    def __init__(self, base, axis, period, datum):
        super().__init__(base.compliance)
        self.base, self.axis, self.period, self.datum = base, axis, float(period), float(datum)
        self.layers, self.far_reaching, self.film = base.layers, base.far_reaching, base.film
        # Laws of waves do not depend on the period.
        self.in_units, self.wave_compliance, self.scale_sampled = (
            base.in_units,
            base.wave_compliance,
            base.scale_sampled,
        )
        self.smallest_eigenvalue, self.softest_parts = base.smallest_eigenvalue, base.softest_parts
        self.is_thin_film, self.is_resolved = base.is_thin_film, base.is_resolved

    def period_cells(self, grid):
        """Return numbers of cells in y and x after which coefficients repeat."""
        if self.axis == 0:
            return max(1, round(self.period / grid.dy)), 0
        return 0, max(1, round(self.period / grid.dx))

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return *self.base.parameters, self.axis, self.period, self.datum

    def unit_coefficients(self, grid, rows, columns):
        """Return influence coefficients for unit compliance [mm]."""
        if self.axis == 0:
            return self._integrals(grid.dy, grid.dx, rows, columns, grid.nx)
        return self._integrals(grid.dx, grid.dy, columns, rows, grid.ny).T

    def _integrals(self, length, width, along, across, count):
        """Return integrals of the displacement K by a point force over cells.

        A cell has the `length` along the period and the `width` across it. `along` and `across` are arrays of offsets
        in cells; the shape is (along, across). `count` is the number of cells across the patch.
        """
        n = max(1, round(self.period / length))
        period = n * length
        folded = np.asarray(along) % n
        folded, index = np.unique(np.minimum(folded, n - folded), return_inverse=True)
        across = np.asarray(across)
        count = max(count, int(across.max(initial=0)) + 1)
        waves = _wave_integrals(width, period, count)[:, across]
        k = np.arange(1, _WAVES + 1)
        cosines = np.cos(2 * np.pi / n * np.arange(n))[np.outer(folded, k) % n]
        cosines *= 4 * length / period * np.sinc(k / n)
        total = cosines @ waves
        near = (across - 0.5) * width < _NEAR * period
        total[:, ~near] += 2 * length / period * _log_integrals(self.datum, across[~near], width)
        if near.any():
            inner = min(width, period)  # wider cells: beyond that, waves are summed
            columns = across[near]
            total[:, near] += self._near_integrals(n, length, inner, folded, columns)
            if width > period:
                outside = _log_integral(self.datum, width / 2) - _log_integral(self.datum, inner / 2)
                total[:, near] += 2 * length / period * 2 * outside
        half_space = total.copy() if self.layers else total
        for layer in self.layers:
            share = layer.plane_compliance / self.compliance
            own = _layer_integrals(layer, n, length, width, folded, across, count, half_space)
            total += share * (own - half_space)
        return total[index]

    def _near_integrals(self, n, length, width, along, across):
        """Return `_integrals` over cells near x = 0."""
        period = n * length
        total = np.zeros((along.size, across.size))
        for m in range(-_COPIES, _COPIES + 1):
            distances = np.abs(along + m * n)
            total += love_coefficients((width, length), 1.0, distances, across)
        in_y, in_x = (_even_powers(at, size / period) for at, size in ((along, length), (across, width)))
        constant = np.log(self.datum / (2 * period)) - sum(1 / m for m in range(1, _COPIES + 1))
        rest = 2 / period * (constant + np.euler_gamma + in_y @ _smooth_rest() @ in_x.T)
        return total + length * width * rest

    def is_positive(self, grid):
        """Return whether no influence coefficient is negative."""
        return not self.layers or (self.base.is_positive(grid) and _least_coefficient(self, grid) >= 0)

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded strip [mm].

        The pressure is 1 N/mm2; `lengths` are the sides in y and x [mm]. The strip is loaded over the whole period.
        """
        rigid, compliance = self.softest_parts(max(lengths))
        return rigid + 4 * compliance * _log_integral(self.datum, lengths[1 - self.axis] / 2)

    def punch_stiffness(self, area):
        """Return the stiffness of a flat strip punch that spans the period [N/mm].

        `area` is the contact area of the punch [mm2].
        """
        half_width = min(area / (2 * self.period), self.datum / 2)
        compliance = self.compliance_at(4 * half_width) / np.pi
        return self.period / (2 * compliance * np.log(2 * self.datum / half_width))


def patch_kernel(kernel, grid):
    """Return the same bodies' kernel on a patch.

    The `kernel` is the kernel of a free patch, ``Material.kernel``, or already the kernel of this patch. Raises
    InputError if there is no kernel for this periodicity.
    """
    kernel.check_patch(grid)
    if not grid.one_way or kernel.encloses_images:
        return kernel
    axis, sides = "yx".index(grid.one_way), grid.sides[::-1]
    return OneWayKernel(kernel, axis, sides[axis], _DATUM_SIDES * max(*sides, kernel.line_reach()))


def _log_integral(datum, x):
    """Return the integral of ln(datum / t) from 0 to x."""
    return x * (np.log(datum / x) + 1)


def _log_integrals(datum, offsets, width):
    """Return integrals of ln(datum / |x|) over cells, at offsets from 1 on.

    Gauss points lose no digits at large distances.
    """
    nodes, weights = _GAUSS
    return width / 2 * (np.log(datum / (width * (offsets[:, None] + nodes / 2))) @ weights)


@lru_cache(maxsize=16)
def _wave_integrals(width, period, count):
    """Return integrals of waves K0(q_k |x|) over cells.

    The wave numbers are q_k = 2 pi k / `period`. The shape is (waves, cells) for offsets from 0 to `count` - 1. It is
    zero in cells near the line x = 0. In a cell wider than the period, the integral is over |x| above half a period.
    """
    from scipy.special import k0

    table = np.zeros((_WAVES, count))
    low = (np.arange(count) - 0.5) * width
    nodes, weights = _GAUSS
    q = 2 * np.pi / period * np.arange(1, _WAVES + 1)

    def integrate(k, low, high):
        half = (high - low) / 2
        return half * (k0(q[k, None] * (low + half)[:, None] + (q[k] * half)[:, None] * nodes) @ weights)

    k, i = np.nonzero((low >= _NEAR * period) & (q[:, None] * low < _NEGLIGIBLE))
    table[k, i] = integrate(k, low[i], low[i] + width)
    edges = np.minimum(period * 2.0 ** np.arange(-1, 4), width / 2)
    for start, stop in pairwise(edges):
        if stop > start:
            k = np.arange(_WAVES)
            table[:, 0] += 2 * integrate(k, np.full(_WAVES, start), np.full(_WAVES, stop))
    return table


def _even_powers(offsets, size):
    """Return cell means of even powers of the coordinate.

    Cells have the `size`, and centres at `offsets` times the size. The shape is (offsets, powers).
    """
    nodes, weights = _GAUSS
    squares = (size * (offsets[:, None] + nodes / 2)) ** 2
    return np.stack([squares**a @ weights / 2 for a in range(_LARGEST_ORDER // 2 + 1)], axis=1)


@lru_cache(maxsize=1)
def _smooth_rest():
    """Return the power series of K's smooth part.

    This part is the second sum in K in the module docstring: the effect of the copies further away than M periods,
    without the constant. The result has the coefficients of even powers of x / L and y / L, for K L / 2.
    """
    from scipy.special import zeta

    count = _LARGEST_ORDER // 2 + 1
    table = np.zeros((count, count))
    for order in range(2, _LARGEST_ORDER + 1, 2):
        factor = zeta(order + 1, _COPIES + 1) / 2**order
        for j in range(order // 2 + 1):  # P_l(t) = 2^-l sum_j (-1)^j C(l, j) C(2 l - 2 j, l) t^(l - 2 j)
            term = (-1) ** j * comb(order, j) * comb(2 * order - 2 * j, order) * factor
            for a in range(j + 1):  # r^(2 j) = (x^2 + y^2)^j
                table[order // 2 - a, a] += term * comb(j, a)
    return table


def _layer_integrals(layer, n, length, width, along, across, count, half_space):
    """Integrate the displacement of a layered body over cells.

    The displacement is by a point force, for compliance 1 of the layer's material; `half_space` are the same integrals
    for a half-space. The other arguments are as in `_integrals`, with `n` cells in a period.
    """
    period, limit, scale = n * length, layer.long_wave_ratio, 2 / n
    total, near = limit * half_space, (across - 0.5) * width < _REACH * period
    if not near.all():
        edges = width * (across[~near] + np.array([[-0.5], [0.5]]))
        total[:, ~near] += scale * _line_integrals(layer, *edges)
    if not near.any():
        return total
    inner, columns = min(width, 2 * _REACH * period), across[near]
    rows, index = np.unique(np.abs(along + n * np.arange(-1, 2)[:, None]), return_inverse=True)
    love = love_coefficients((inner, length), 1.0, rows, columns)
    own = layered_coefficients(layer, (inner, length), rows, columns, love) - limit * love
    total[:, near] += own[index.reshape(3, -1)].sum(axis=0)
    sides = (n // 2 + 0.5) * length, (min(count, int(_REACH * period / width + 0.5) + 1) - 0.5) * inner
    terms = _further_copies(layer, period, *sides)
    in_y, in_x = (
        _cell_integrals(places, cell, side, k)
        for places, cell, side, k in zip((along, columns), (length, inner), sides, terms.shape, strict=True)
    )
    total[:, near] += in_y @ terms @ in_x.T
    for low in inner / 2 * 2.0 ** np.arange(int(np.ceil(np.log2(width / inner)))):  # beyond, on both sides
        total[:, near] += (
            2 * scale * _line_integrals(layer, np.array([low]), np.array([min(2 * low, width / 2)]))
        )
    return total


def _line_integrals(layer, low, high):
    """Return integrals of the layer's displacement by a line of force, from `low` to `high` on one side of the line.

    That of the base is subtracted. The force is 1/2 per length.
    """
    nodes, weights = _GAUSS
    x = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * nodes
    return (high - low) / 2 * (layer_tables(layer).line_beyond_base(x / layer.thickness) @ weights)


@lru_cache(maxsize=16)
def _further_copies(layer, period, side_y, side_x):
    """Return the displacement by the copies of a force from the second on, a smooth function of the position.

    That of the base is subtracted. The result has the coefficients [y, x] of even Chebyshev polynomials for positions
    up to the sides. Copies are summed with a taper; the rest of the sum is an integral.
    """
    from scipy.special import erfc

    t, influence = layer.thickness, layer_tables(layer).beyond_base
    count = int(np.ceil(_DIGITS / np.arcsinh(_LEAST_DISTANCE * period / side_x))) + 2
    y, x = side_y * chebyshev_nodes(_ROWS)[:, None], side_x * chebyshev_nodes(count)
    last, total = _TAPER_CENTRE + _TAPER_RANGE * _TAPER_WIDTH, np.zeros((_ROWS, count))
    for m in [m for m in range(-int(last) - 2, int(last) + 3) if abs(m) > 1]:
        place = np.abs(y + m * period)
        taper = erfc((place / period - _TAPER_CENTRE) / _TAPER_WIDTH) / 2
        total += taper * influence(np.hypot(place, x) / t) / t
    first = _TAPER_CENTRE - _TAPER_RANGE * _TAPER_WIDTH
    end = max(period, side_x, t * max(1.0, layer.long_wave_ratio)) * _INFINITY
    edges = period * np.append(
        np.arange(first, last), last * 2.0 ** np.arange(np.log2(end / period / last) + 2)
    )
    nodes, weights = _GAUSS
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    s, weights = (middle + half * nodes).ravel(), (half * weights).ravel()
    weights *= erfc((_TAPER_CENTRE - s / period) / _TAPER_WIDTH) / period
    total += influence(np.hypot(x[:, None], s) / t) @ weights / t
    return fit_even_chebyshev(total)


def _cell_integrals(offsets, cell, side, count):
    """Return integrals of even Chebyshev polynomials over cells, shape (offsets, count).

    Cells have the size `cell`, and centres at `offsets` times the size; the polynomials are those of the position over
    `side`.
    """
    k = 2 * np.arange(count)
    powers = chebvander(cell / side * (offsets + np.array([[-0.5], [0.5]])), 2 * count)
    # The integral of T_k is T_(k+1) / 2 (k + 1) - T_(k-1) / 2 (k - 1).
    integrals = powers[..., 1::2][..., :count] / (2 * (k + 1))
    integrals[..., 1:] -= powers[..., 1 : 2 * count - 1 : 2] / (2 * (k[1:] - 1))
    integrals[..., 0] *= 2
    return side * (integrals[1] - integrals[0])


@lru_cache(maxsize=16)
def _least_coefficient(kernel, grid):
    """Return the smallest of the influence coefficients at all small and some large offsets."""
    rows, columns = (
        np.unique(np.concatenate([np.arange(min(n, 32)), np.arange(0, n, max(1, n // 64)), [n - 1]]))
        for n in grid.shape
    )
    return float(kernel.unit_coefficients(grid, rows, columns).min())
