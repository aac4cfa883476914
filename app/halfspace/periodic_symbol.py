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
from scipy.special import erfc

from app.halfspace import events
from app.halfspace.fft.multiplier import transform_even
from app.halfspace.grid import row_blocks

# Widths of the Gaussians of `_line_sums`, in sides of a cell. To rounding, a narrower one stays in its cell, and a
# wider one leaves only the wave itself.
_SHORTEST, _LONGEST = 0.04, 2.0
_POINTS = 12  # of quadrature in a panel; they leave only rounding


def wave_numbers(grid, columns, rows):
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
    with events.coeffs:
        return 2 * np.pi * compliance * of_kind(grid, np.asarray(columns), np.asarray(rows))


def _spectral(grid, columns, rows):
    """1 / |q|."""
    qx, qy = wave_numbers(grid, columns, rows)
    q = np.hypot(qx[:, None], qy)
    return np.divide(1.0, q, out=np.zeros_like(q), where=q > 0)


def _love(grid, columns, rows):
    """Compute the transform of the integral of 1/rho over a cell and all its images, over 2 pi.

    It is the sum of ``sinc(qx dx / 2) sinc(qy dy / 2) / |q|`` over all waves that look alike in cell centres. Here
    ``1 / |q|`` is an integral of ``exp(-s^2 |q|^2)`` over lengths s (Ewald). For each s the sum is a product of one sum
    in x and one in y. From two cells on, only the wave itself is left, whose integral is known.
    """
    lengths, weights = _quadrature(*sorted((grid.dx, grid.dy)))
    x, y = (2 * np.pi / n * np.asarray(index) for index, n in ((columns, grid.nx), (rows, grid.ny)))
    total = np.empty((x.size, y.size))
    for some in row_blocks(x.size, lengths.size):
        in_x = weights * _line_sums(x[some], lengths / grid.dx)
        left = in_x.any(axis=0)  # Most lengths are too long for most waves in x if cells are long in y.
        for others in row_blocks(y.size, lengths.size):
            in_y = _line_sums(y[others], lengths[left] / grid.dy)
            total[some, others] = in_x[:, left] @ in_y.T
    q = np.hypot(x[:, None] / grid.dx, y / grid.dy)
    wave = np.sinc(x / (2 * np.pi))[:, None] * np.sinc(y / (2 * np.pi))
    total += np.divide(
        wave * erfc(_LONGEST * max(grid.dx, grid.dy) * q), q, out=np.zeros_like(q), where=q > 0
    )
    total[np.ix_(x == 0, y == 0)] = 0.0
    return total


@lru_cache(maxsize=64)
def _quadrature(short, long):
    """Return lengths s and weights of the integral from 0 to `_LONGEST` long sides, times 2 / sqrt(pi).

    Gauss's quadrature is used on panels that double at most. The first panel has one point: there the integrand is 1
    to rounding.
    """
    first, last = _SHORTEST * short, _LONGEST * long
    panels = int(np.ceil(np.log2(last / first)))
    edges = np.append(first * (last / first) ** (np.arange(panels) / panels), last)
    places, weights = np.polynomial.legendre.leggauss(_POINTS)
    half = np.diff(edges)[:, None] / 2
    lengths = np.append(first / 2, edges[:-1, None] + half * (1 + places))
    return lengths, np.append(first, half * weights) * 2 / np.sqrt(np.pi)


def _line_sums(phases, lengths):
    """Sum ``sinc(q / 2) exp(-lengths^2 q^2)`` over all q that look like a wave in the centres of cells of side 1.

    For short lengths the same function is summed in x: a Gaussian integrated over cells near by.

    Parameters
    ----------
    phases : ndarray
        Phases of the waves from cell to cell, from 0 to pi.
    lengths : ndarray

    Returns
    -------
    ndarray, shape (phases, lengths)
    """
    sums, short = np.zeros((phases.size, lengths.size)), lengths < 0.5
    long = ~short & (lengths * phases.min(initial=np.pi) < 6.5)  # Longer ones leave nothing of any wave.
    cells = np.arange(7)
    edges = erfc((np.arange(8)[:, None] - 0.5) / (2 * lengths[short]))
    sums[:, short] = np.cos(np.outer(phases, cells)) * np.where(cells, 1, 0.5) @ -np.diff(edges, axis=0)
    waves = phases[:, None] + 2 * np.pi * np.arange(-2, 2)
    terms = np.exp(-((lengths[long, None] * waves[:, None, :]) ** 2))
    sums[:, long] = (terms @ np.sinc(waves / (2 * np.pi))[:, :, None])[..., 0]
    return sums


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


def fold_offsets(offsets, n):
    """Offsets up to half a period that offsets from 0 on are alike to. Not collective."""
    return np.minimum(offsets % n, -offsets % n)
