"""Kernel of half-spaces under a pressure that repeats in one direction.

The pressure repeats in y with the period L, and the patch is free in x; or the other way round. A point force displaces
the surface at a distance by 1/rho, for unit compliance. The sum of this over all copies of a force diverges, so a
constant is subtracted. The rest is a sum over waves along the period, q_k = 2 pi k / L:

    K(x, y) = (2 / L) ln(D / |x|) + (4 / L) sum_{k > 0} K0(q_k |x|) cos(q_k y)

The first term is the line contact of plane strain. D is the distance from a line of force at which the displacement is
zero, on average over the period. It is arbitrary, and an approach depends on it. We take twice the longer side of the
patch. Then no influence coefficient is negative, and A is positive definite.

Coefficients are integrals of K over cells. Far from the line x = 0, few waves are needed. Near it, K is the sum of
1/rho over the nearest copies, |m| <= M, and a smooth rest. With Legendre polynomials P_l and Hurwitz's zeta function

    K = sum_{|m| <= M} 1/rho_m + sum_{l = 2, 4, ...} 2 r^l P_l(y / r) zeta(l + 1, M + 1) / L^(l+1)
        + (2 / L) (ln(D / 2 L) - H_M + gamma),    H_M = 1 + 1/2 + ... + 1/M

Both sums are exact up to rounding where they are used.
"""

from functools import lru_cache
from itertools import pairwise
from math import comb

import numpy as np

from app.base.errors import InputError
from app.halfspace.kernel import HalfSpaceKernel
from app.halfspace.love import love_coefficients

_DATUM_SIDES = 2.0  # D over the longer side of the patch
_NEAR = 0.125  # distance from the line x = 0, in periods, from which waves are summed
_COPIES = 4  # M
_LARGEST_ORDER = 30  # of Legendre polynomials: the rest is below (1.4 / (M + 1))^32
_NEGLIGIBLE = 40.0  # q |x| from which K0 is below rounding
_WAVES = int(_NEGLIGIBLE / (2 * np.pi * _NEAR)) + 1
_GAUSS = np.polynomial.legendre.leggauss(16)  # exact for the powers of the smooth rest


class OneWayKernel(HalfSpaceKernel):
    """Kernel of half-spaces under a pressure periodic in one direction.

    Parameters
    ----------
    compliance : float
        1 / (pi E*) [mm2/N].
    axis : int
        0 if the pressure repeats in y, 1 if it repeats in x.
    period : float
        Period L [mm].
    datum : float
        Distance D at which a line of force does not displace the surface [mm].
    """

    encloses_images = True

    def __init__(self, compliance, axis, period, datum):
        super().__init__(compliance)
        self.axis, self.period, self.datum = axis, float(period), float(datum)

    def period_cells(self, grid):
        """Return numbers of cells in y and x after which coefficients repeat."""
        if self.axis == 0:
            return max(1, round(self.period / grid.dy)), 0
        return 0, max(1, round(self.period / grid.dx))

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        return self.compliance, self.axis, self.period, self.datum

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients; see `HalfSpaceKernel.coefficients`."""
        return self.compliance * self.unit_coefficients(grid, rows, np.arange(columns))

    def unit_coefficients(self, grid, rows, columns):
        """Return influence coefficients for unit compliance [mm]."""
        if self.axis == 0:
            return self._integrals(grid.dy, grid.dx, rows, columns, grid.nx)
        return self._integrals(grid.dx, grid.dy, columns, rows, grid.ny).T

    def _integrals(self, length, width, along, across, count):
        """Return the integrals of K over cells.

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
        return total[index]

    def _near_integrals(self, n, length, width, along, across):
        """Return integrals of K over cells near the line x = 0."""
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
        """Return whether no influence coefficient is negative; see `_DATUM_SIDES`."""
        return True

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded strip [mm].

        The pressure is 1 N/mm2; `lengths` are the sides in y and x [mm]. The strip is loaded over the whole period.
        """
        return 2 * self.compliance * _log_integral(self.datum, lengths[1 - self.axis] / 2) * 2

    def punch_stiffness(self, area):
        """Return the stiffness of a flat punch as long as the period [N/mm].

        `area` is that of its end [mm2].
        """
        half_width = min(area / (2 * self.period), self.datum / 2)
        return self.period / (2 * self.compliance * np.log(2 * self.datum / half_width))


def patch_kernel(kernel, grid):
    """Return the kernel of the same bodies on a patch.

    The `kernel` is that of a free patch, ``Material.kernel``, or already that of this patch. Raises InputError for a
    coated body on a patch that is periodic in one direction.
    """
    if not grid.one_way or kernel.encloses_images:
        return kernel
    if type(kernel) is not HalfSpaceKernel:
        raise InputError(
            f"periodic: {grid.one_way!r} (-periodic {grid.one_way}); must be True or False with a coating or layer"
        )
    axis = "yx".index(grid.one_way)
    sides = grid.ny * grid.dy, grid.nx * grid.dx
    return OneWayKernel(kernel.compliance, axis, sides[axis], _DATUM_SIDES * max(sides))


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
    """Return integrals of K0(q_k |x|) over the width of cells.

    The shape is (waves, cells), for offsets from 0 to `count` - 1. It is zero in cells near the line x = 0. A cell
    wider than the period has only the part at more than half a period.
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
    """Return means over cells of even powers of the coordinate.

    Cells have the `size`, and centres at `offsets` times the size. The shape is (offsets, powers).
    """
    nodes, weights = _GAUSS
    squares = (size * (offsets[:, None] + nodes / 2)) ** 2
    return np.stack([squares**a @ weights / 2 for a in range(_LARGEST_ORDER // 2 + 1)], axis=1)


@lru_cache(maxsize=1)
def _smooth_rest():
    """Return coefficients of even powers of y / L and x / L in the smooth rest.

    The rest is that of the module docstring, times L / 2, without its constant.
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
