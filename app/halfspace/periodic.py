"""Influence of a patch that repeats for ever in x and y: diagonal in Fourier space.

A pressure wave ``p_q exp(i q x)`` displaces the half-space by ``u_q = 2 p_q / (E* |q|)``. What the matrix makes of the
wave depends on what a number stands for; ``Grid.periodic`` chooses:

- ``spectral``: the values of waves in the cell centres (collocation, as tamaas, ASPHER and ContactMechanics do):
  ``lambda(q) = 2 / (E* |q|)`` for all waves that the grid can carry.
- ``love``: constant pressures on cells, (2.4), of the patch and of all its images: what the matrix of the free patch
  tends to when the images are far away. The two differ by O(cell).

``lambda(0) = 0``: displacements are counted from their mean, as the mean pressure would displace the half-space without
bound. So mean(gap) = mean(undeformed distance) - approach, exactly.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import erf, erfc, zeta

from app.halfspace.chebyshev import nodes, polynomials
from app.halfspace.fft.multiplier import transform_even
from app.halfspace.grid import runs
from app.halfspace.love import love_coefficients

# Ewald's splitting of 1/rho: beyond so many lengths erfc(rho) / rho, and beyond so many waves erfc(q / 2) / q, vanish.
_RANGE = 6.2
_SPLITTING = 0.7  # lengths in the longer side of a cell
_TERMS = 48  # even polynomials that leave nothing but rounding of what is smooth, over its range


def frequencies(grid, columns, rows):
    """Wave numbers in x and y of the frequencies asked for [1/mm]. Not collective."""
    return (2 * np.pi * np.asarray(index) / (n * d) for index, n, d in
            ((columns, grid.nx, grid.dx), (rows, grid.ny, grid.dy)))  # fmt: skip


def influence_symbol(grid, compliance, columns, rows):
    """Eigenvalues of the periodic influence matrix at some frequencies.

    Not collective.

    Parameters
    ----------
    grid : Grid
        A periodic one.
    compliance : float
        (1 - nu) / (pi G) = 1 / (pi E*) [mm2/N].
    columns, rows : ndarray of int
        Frequencies in x, from 0 to nx // 2, and in y, from 0 to ny // 2; of ``love`` also floats between them.

    Returns
    -------
    ndarray, shape (columns, rows), [mm / (N/mm2)]
        Zero at frequency (0, 0).
    """
    of_kind = {"spectral": _spectral, "love": _love}[grid.periodic]
    return 2 * np.pi * compliance * of_kind(grid, np.asarray(columns), np.asarray(rows))


def _spectral(grid, columns, rows):
    """1 / |q|."""
    qx, qy = frequencies(grid, columns, rows)
    q = np.hypot(qx[:, None], qy)
    return np.divide(1.0, q, out=np.zeros_like(q), where=q > 0)


def _love(grid, columns, rows):
    """Transform of the integral of 1/rho over a cell and all its images, over 2 pi.

    By Ewald's method: what is long of 1/rho as a sum over all waves that look alike in cell centres, what is short of
    it as a sum over cells near by. One cell and its images are an endless strip, whose waves are summed up at once.
    """
    qx, qy = frequencies(grid, columns, rows)
    if 1 in grid.shape:
        along, across = _of_strips(qx, grid.dx)[:, None], _of_strips(qy, grid.dy)
        return np.where(qx[:, None] > 0, along, across)
    alpha = _SPLITTING / max(grid.dx, grid.dy)
    total = np.zeros((len(columns), len(rows)))
    for x in _aliases(qx, grid.dx, alpha):
        for y in _aliases(qy, grid.dy, alpha):
            q = np.hypot(x[:, None], y)
            part = np.sinc(x * grid.dx / (2 * np.pi))[:, None] * np.sinc(y * grid.dy / (2 * np.pi))
            total += np.divide(part * erfc(q / (2 * alpha)), q, out=np.zeros_like(q), where=q > 0)
    near = _short_range(grid.dx, grid.dy, alpha)
    # Long cells have thousands of neighbours across, and ten along.
    if grid.dx > grid.dy:
        short = _cosines(columns, grid.nx, near.shape[1]) @ even_sums(near.T, grid.ny, rows)
    else:
        short = (_cosines(rows, grid.ny, near.shape[0]) @ even_sums(near, grid.nx, columns)).T
    total += short / (2 * np.pi)
    total[np.ix_(np.asarray(columns) == 0, np.asarray(rows) == 0)] = 0.0
    return total


def _cosines(frequencies, period, count):
    """Waves at offsets 0, 1, ... of both signs, shape (frequencies, count)."""
    offsets = np.arange(count)
    return np.cos(2 * np.pi / period * np.outer(frequencies, offsets)) * np.where(offsets > 0, 2.0, 1.0)


def even_sums(near, period, frequencies):
    """Sums of near times waves along axis 1, whose offsets are 0, 1, ... of both signs, as many as there are.

    Not collective. Of whole frequencies, 0 to period // 2, by an FFT.
    """
    if frequencies.dtype.kind == "f":
        return near @ _cosines(frequencies, period, near.shape[1]).T
    offsets = np.arange(near.shape[1])
    place = folded(offsets, period)
    met = np.where((offsets > 0) & ((place == 0) | (2 * place == period)), 2.0, 1.0)  # by both signs
    samples = np.zeros((near.shape[0], period // 2 + 1))
    np.add.at(samples, (slice(None), place), met * near)
    return transform_even(samples, period)[:, frequencies]


def _of_strips(q, width):
    """Sum of sinc(k width / 2) / |k| over all k that look like q in the middle of strips; 0 at 0."""
    place = np.where(q > 0, q * width / (2 * np.pi), 0.5)  # up to that
    ends = zeta(2, place / 2) + zeta(2, (1 - place) / 2)
    middle = zeta(2, (1 + place) / 2) + zeta(2, 1 - place / 2)
    return np.where(q > 0, width * np.sin(np.pi * place) * (ends - middle) / (8 * np.pi**2), 0.0)


def _aliases(q, step, alpha):
    """Wave numbers that look like q in cell centres, and matter."""
    most = int(np.ceil(2 * alpha * _RANGE * step / (2 * np.pi) + 0.5))
    return [q + 2 * np.pi * m / step for m in range(-most, most + 1)]


@lru_cache(maxsize=64)
def _short_range(dx, dy, alpha):
    """Integral of erfc(alpha rho) / rho over cells near by, at non-negative offsets (j, i)."""
    if dx < dy:
        return _short_range(dy, dx, alpha).T
    rows, columns = (int(np.ceil(_RANGE / (alpha * d) + 0.5)) + 1 for d in (dy, dx))
    whole = love_coefficients((dx, dy), 1.0, np.arange(rows), columns)
    if rows <= _TERMS:
        return whole - _smooth_range(dx, dy, alpha, np.arange(rows), columns)
    # Long cells have many neighbours across: what is smooth is known from few of them.
    few = _smooth_range(dx, dy, alpha, (rows - 1) * nodes(_TERMS), columns)
    few = np.linalg.solve(polynomials(nodes(_TERMS), _TERMS), few)
    for part in runs(rows, _TERMS, 1 << 20):
        whole[part] -= polynomials(np.arange(part.start, part.stop) / (rows - 1), _TERMS) @ few
    return whole


def _smooth_range(dx, dy, alpha, rows, columns):
    """Integral of erf(alpha rho) / rho over cells, at offsets `rows` and 0, 1, ... columns - 1."""
    (x, weights_x), (y, weights_y) = _nodes(dx, alpha, np.arange(columns)), _nodes(dy, alpha, rows)
    rho = np.hypot(x[None, :, None, :], y[:, None, :, None])
    smooth = erf(alpha * rho) / np.where(rho > 0, rho, 1.0)
    smooth[rho == 0] = 2 * alpha / np.sqrt(np.pi)
    return np.einsum("jikl,k,l->ji", smooth, weights_y, weights_x)


def _nodes(side, alpha, offsets):
    """Nodes of Gauss's quadrature in cells at some offsets, shape (cells, nodes), and weights [mm].

    What is integrated is smooth over 1 / alpha: in short cells a few nodes leave nothing but rounding.
    """
    count = 24 if alpha * side > 0.2 else 8 if alpha * side > 0.02 else 4
    places, weights = np.polynomial.legendre.leggauss(count)
    return (offsets[:, None] + 0.5 * places) * side, weights * side / 2


def periodic_quadrant(grid, compliance):
    """Influence coefficients of a periodic grid at offsets up to half a period. Not collective.

    Returns
    -------
    ndarray, shape (ny // 2 + 1, nx // 2 + 1), [mm / (N/mm2)]
        The inverse transform of the symbol, in O(n log n).
    """
    symbol = influence_symbol(grid, compliance, np.arange(grid.nx // 2 + 1), np.arange(grid.ny // 2 + 1))
    in_y = transform_even(symbol, grid.ny)
    return transform_even(np.ascontiguousarray(in_y.T), grid.nx) / grid.n


def folded(offsets, n):
    """Offsets up to half a period that offsets from 0 on are alike to. Not collective."""
    return np.minimum(offsets % n, -offsets % n)
