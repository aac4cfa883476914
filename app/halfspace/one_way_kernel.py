"""Kernel of bodies under a pressure that repeats in one direction.

The pressure repeats in y with the period L, and the patch is free in x; or the other way round. At a distance r a point
force displaces the surface of a half-space by 1/r, for compliance 1. The sum over all copies of the force diverges, so
a constant is subtracted. The result is a sum over waves along the period with the wave numbers q_k = 2 pi k / L and the
modified Bessel function K0:

    K(x, y) = (2 / L) ln(D / |x|) + (4 / L) sum_{k > 0} K0(q_k |x|) cos(q_k y)

The first term is the line contact of plane strain. D is the distance from a line of force at which the displacement is
zero, on average over the period. D is arbitrary, and an approach depends on it. We take twice the longer side of the
patch, or four thicknesses of a layer if this is more. Then A is positive definite, and no influence coefficient of
half-spaces is negative.

Coefficients are integrals of K over cells. Far from the line x = 0, few waves are needed. Near it, K is the sum over
the copies at y = m L with |m| <= M, and a smooth rest. With the distance r_m from copy m, the Legendre polynomials P_l,
Hurwitz's zeta function, and Euler's constant gamma,

    K = sum_{|m| <= M} 1/r_m + sum_{l = 2, 4, ...} 2 r^l P_l(y / r) zeta(l + 1, M + 1) / L^(l+1)
        + (2 / L) (ln(D / 2 L) - H_M + gamma),    H_M = 1 + 1/2 + ... + 1/M

Both sums are exact up to rounding where they are used.

A layer of thickness t multiplies the compliance of waves by S(q t) (`app.halfspace.layer`). So it adds, for k >= 0,

    (2 or 4) / L cos(q_k y) integral over p > 0 of (S(q t) - 1) / q cos(p x),    q^2 = q_k^2 + p^2,

with the factor 2 for k = 0, and 4 otherwise. For k = 0 the limit of S - 1 at long waves is multiplied by the image of
the line of force at the depth 2 t, ln(D / sqrt(x^2 + 4 t^2)), whose transform is exp(-2 p t) / p.

For thin layers the sum over waves is too long. Far from a force, a layered body is displaced by S(0)/r + a t^2/r^3 +
b t^4/r^5 + ..., with numbers a, b of the layer. So for thin layers we add S(0) times the sum for half-spaces, the
difference between the layered body and S(0) times the half-space for the copies with |m| <= M, and for all further
copies the other terms of the far field.
"""

from functools import lru_cache
from itertools import pairwise
from math import comb

import numpy as np

from app.base.errors import InputError
from app.halfspace.kernel import HalfSpaceKernel
from app.halfspace.layer_coefficients import MAX_REACH, layered_coefficients
from app.halfspace.love import love_coefficients

_DATUM_SIDES = 2.0  # D over the longer side of the patch, or over the depth 2 t of images if this is more
_NEAR = 0.125  # distance from the line x = 0, in periods, from which waves are summed
_COPIES = 4  # M
_LARGEST_ORDER = 30  # of Legendre polynomials: the rest is below (1.4 / (M + 1))^32
_NEGLIGIBLE = 40.0  # q |x| from which K0 is below rounding
_WAVES = int(_NEGLIGIBLE / (2 * np.pi * _NEAR)) + 1
_GAUSS = np.polynomial.legendre.leggauss(16)  # exact for the powers of the smooth rest
_MAX_DECAY = 19.0  # q t above which S(q t) - 1 is below rounding
_MAX_SUMMED_THICKNESS = 1 / 512  # thickness over D below which copies are summed instead of waves
# Distance over S(0) t from which the terms above describe the displacement by a force on a thin layer.
_FAR_FIELD_DISTANCE = 150.0
_COPIES_PER_WAVE = 0.1  # number of copies over the number of waves for which both sums take as long
_MAX_PHASE = 8.0  # p x over an interval of integration
_BLOCK = 1024  # wave numbers p that are summed together


class OneWayKernel(HalfSpaceKernel):
    """Kernel of bodies under pressure periodic in one direction.

    Parameters
    ----------
    base : HalfSpaceKernel
        Kernel of the bodies on a free patch.
    axis : int
        0 if the pressure repeats in y, 1 if it repeats in x.
    period : float
        Period L [mm].
    datum : float
        Distance D at which a line of force does not displace the surface [mm].
    """

    encloses_images = True
    base = None

    def __init__(self, base, axis, period, datum):
        super().__init__(base.compliance)
        self.base, self.axis, self.period, self.datum = base, axis, float(period), float(datum)
        self.scale_free, self.far_reaching = base.scale_free, base.far_reaching
        # Laws of waves do not depend on the period.
        self.in_units, self.scale, self.scale_sampled = base.in_units, base.scale, base.scale_sampled
        self.smallest_eigenvalue, self.compliance_at = base.smallest_eigenvalue, base.compliance_at
        self.contrast = base.contrast
        self.film, self.is_thin_film, self.is_resolved = base.film, base.is_thin_film, base.is_resolved

    def period_cells(self, grid):
        """Return numbers of cells in y and x after which coefficients repeat."""
        if self.axis == 0:
            return max(1, round(self.period / grid.dy)), 0
        return 0, max(1, round(self.period / grid.dx))

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return *self.base.parameters, self.axis, self.period, self.datum

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients; see `HalfSpaceKernel.coefficients`."""
        return self.compliance * self.unit_coefficients(grid, rows, np.arange(columns))

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
        waves = _wave_integrals(width, period, max(count, int(across.max(initial=0)) + 1))[:, across]
        k = np.arange(1, _WAVES + 1)
        cosines = np.cos(2 * np.pi / n * (np.outer(folded, k) % n)) * (4 * length / period * np.sinc(k / n))
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
        half_space = total.copy() if self.base.layers else total
        for layer in self.base.layers:
            share = layer.plane_compliance / self.compliance
            if _sums_copies(layer, period, self.datum):
                total += share * (
                    _sum_thin_layer(layer, n, length, width, folded, across, half_space) - half_space
                )
                continue
            own = _layer_integrals(
                layer, width, period, self.datum, max(count, int(across.max(initial=0)) + 1)
            )
            k = np.arange(len(own))
            waves = np.where(k > 0, 4, 2) * length / period * np.sinc(k / n)
            own = np.cos(2 * np.pi / n * (np.outer(folded, k) % n)) * waves @ own[:, across]
            total += share * own
        return total[index]

    def _near_integrals(self, n, length, width, along, across):
        """Return `_integrals` over cells near x = 0."""
        period = n * length
        total = np.zeros((along.size, across.size))
        for m in range(-_COPIES, _COPIES + 1):
            distances = np.abs(along + m * n)
            total += love_coefficients((width, length), 1.0, distances, int(across.max()) + 1)[:, across]
        in_y, in_x = (_even_powers(at, size / period) for at, size in ((along, length), (across, width)))
        constant = np.log(self.datum / (2 * period)) - sum(1 / m for m in range(1, _COPIES + 1))
        rest = 2 / period * (constant + np.euler_gamma + in_y @ _smooth_rest() @ in_x.T)
        return total + length * width * rest

    def is_positive(self, grid):
        """Return whether no influence coefficient is negative."""
        return self.base.scale_free or (self.base.is_positive(grid) and _least_coefficient(self, grid) >= 0)

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded strip [mm].

        The pressure is 1 N/mm2; `lengths` are the sides in y and x [mm]. The strip is loaded over the whole period.
        """
        rigid, compliance = self.base.softest_parts(max(lengths))
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
    InputError for bodies that are neither half-spaces nor layered.
    """
    if not grid.one_way or kernel.encloses_images:
        return kernel
    axis = "yx".index(grid.one_way)
    sides, layers = grid.sides[::-1], kernel.layers
    if not (kernel.scale_free or layers):
        raise InputError(f"periodic: {grid.one_way!r}; must be True or False with a {type(kernel).__name__}")
    longest = max(*sides, *(2 * layer.thickness for layer in layers))
    return OneWayKernel(kernel, axis, sides[axis], _DATUM_SIDES * longest)


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


@lru_cache(maxsize=8)
def _layer_integrals(layer, width, period, datum, count):
    """Return integrals of the layer's part of waves over the width of cells.

    The part is the layer's integral in the module docstring, without the factor (2 or 4) / L. The shape is (waves,
    cells): waves from k = 0 on, cells at offsets from 0 to `count` - 1.
    """
    t, excess = layer.thickness, layer.long_wave_ratio - 1
    x, highest = width * np.arange(count), _MAX_DECAY / layer.thickness
    along = 2 * np.pi / period * np.arange(int(highest * period / (2 * np.pi)) + 1)
    table = np.zeros((along.size, count))
    p, weights = _across(min(np.pi / period, 1e-3 / t), min(_MAX_PHASE / (x[-1] + width), 0.5 / t), highest)
    for start in range(0, p.size, _BLOCK):
        part = slice(start, start + _BLOCK)
        q = np.hypot(along[:, None], p[part])
        waves = layer.ratio(q.ravel()).reshape(q.shape) - 1
        waves[0] -= excess * np.exp(-2 * p[part] * t)
        waves *= weights[part] * width * np.sinc(p[part] * width / (2 * np.pi)) / q
        table += waves @ np.cos(np.outer(p[part], x))
    nodes, gauss = _GAUSS
    if width < t:
        points = width * (np.arange(count)[:, None] + nodes / 2)
        table[0] += excess * width / 2 * (np.log(datum / np.hypot(points, 2 * t)) @ gauss)
    else:
        edges = x - width / 2, x + width / 2
        low, high = (
            a * (np.log(datum / np.hypot(a, 2 * t)) + 1) - 2 * t * np.arctan(a / (2 * t)) for a in edges
        )
        table[0] += excess * (high - low)
    return table


def _count_copies(layer, period):
    """Return the number of copies on each side that `_sum_thin_layer` adds one by one."""
    reach = MAX_REACH if layer.on_rigid_base else _FAR_FIELD_DISTANCE * max(1.0, layer.long_wave_ratio)
    return max(_COPIES, int(np.ceil(reach * layer.thickness / period)))


def _sums_copies(layer, period, datum):
    """Return whether a layer is so thin that a sum over copies takes less time than one over waves."""
    t = layer.thickness
    waves = datum / t * max(1.0, period / t)
    return t < _MAX_SUMMED_THICKNESS * datum and _count_copies(layer, period) < _COPIES_PER_WAVE * waves


def _sum_thin_layer(layer, n, length, width, along, across, half_space):
    """Integrate the displacement of a thin-layered body over cells.

    The displacement is by a point force, for compliance 1 of the layer's material; `half_space` are the same integrals
    for a half-space. The other arguments are as in `_integrals`, with `n` cells in a period.
    """
    t, period, limit = layer.thickness, n * length, layer.long_wave_ratio
    copies = _count_copies(layer, period)
    total = limit * half_space
    for m in range(-copies, copies + 1):
        rows = np.abs(along + m * n)
        love = love_coefficients((width, length), 1.0, rows, int(across.max()) + 1)[:, across]
        total += layered_coefficients(layer, (width, length), rows, across, love) - limit * love
    if layer.on_rigid_base:
        return total
    a, b, c = (number * t**power for number, power in zip(layer.far_field(), (2, 4, 6), strict=True))
    x, edges = width * across, width * np.stack([across - 0.5, across + 0.5])
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        y = length * (along[:, None] + node / 2)
        for s in ((copies + 0.5) * period - y, (copies + 0.5) * period + y):
            # Sums over further copies, by Euler and Maclaurin. The first terms of 1/r^3 are integrated over the cell.
            r, start = np.hypot(s[:, None], edges), s[:, None]
            cubes = edges / (start * period * (r + start))
            cubes -= period / 24 * edges / start * (1 / r**2 + 2 / start**2) / r
            r = np.hypot(s, x)
            ratio, square = s / r, r * (r + s)
            others = -7 / 5760 * a * period**3 * (45 - 105 * ratio**2) * ratio / r**6
            others += b * ((2 + ratio) / (3 * period * square**2) - 5 / 24 * period * ratio / r**6)
            others += c * (8 + 9 * ratio + 3 * ratio**2) / (15 * period * square**3)
            total += weight / 2 * length * (a * (cubes[:, 1] - cubes[:, 0]) + width * others)
    return total


def _across(first, step, highest):
    """Return points and weights of a composite Gauss rule from 0 to `highest`.

    The first interval has the length `first`; the next ones are twice as long each, up to the length `step`.
    """
    growing = first * 2.0 ** np.arange(max(int(np.log2(step / first)) + 1, 1))
    edges = np.concatenate([[0.0], growing, np.arange(growing[-1] + step, highest + step, step)])
    nodes, weights = _GAUSS
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    return (half * nodes + middle).ravel(), (half * weights).ravel()


@lru_cache(maxsize=16)
def _least_coefficient(kernel, grid):
    """Return the smallest of the influence coefficients at all small and some large offsets."""
    rows, columns = (
        np.unique(np.concatenate([np.arange(min(n, 32)), np.arange(0, n, max(1, n // 64)), [n - 1]]))
        for n in grid.shape
    )
    return float(kernel.unit_coefficients(grid, rows, columns).min())
