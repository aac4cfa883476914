"""Influence matrix of periodic patches, diagonal in Fourier space.

A pressure wave ``p_q exp(i q x)`` displaces the half-space by ``u_q = 2 p_q / (E* |q|)``. The *symbol* is the function
lambda(q) that gives the eigenvalues of the matrix. The symbol depends on what the value of a cell means.
``Grid.periodic`` chooses one of two symbols:

- ``spectral``: the pressure is a sum of waves, with the given values at the cell centres (collocation, as in tamaas,
  ASPHER and ContactMechanics). ``lambda(q) = 2 / (E* |q|)`` for all waves on the grid.
- ``love``: the pressure is constant on each cell of the patch and of its images, as in (2.4). If the patch is large
  compared with the contact, the matrix acts nearly as the matrix of a free patch.

The two symbols differ by O(cell size). Both symbols have ``lambda(0) = 0``: displacements are relative to their mean,
because a mean pressure would displace the half-space without bound. So the gap has the same mean as the undeformed
distance.
"""

from functools import lru_cache

import numpy as np
from scipy.special import erfc

from app.halfspace import events
from app.halfspace.fft.multiplier import transform_even
from app.halfspace.grid import row_blocks

# Widths of the Gaussians of `_line_sums`, in sides of a cell. A narrower Gaussian is zero outside its cell, and a wider
# one leaves only the wave itself, both up to rounding.
_MIN_WIDTH, _MAX_WIDTH = 0.04, 2.0
_POINTS = 12  # Quadrature points per panel; the error is below rounding.


def wave_numbers(grid, columns, rows):
    """Return wave numbers of `columns` and `rows` waves on the patch [1/mm]."""
    return (2 * np.pi * np.asarray(index) / (n * d) for index, n, d in
            ((columns, grid.nx, grid.dx), (rows, grid.ny, grid.dy)))  # fmt: skip


def influence_symbol(grid, compliance, columns, rows):
    """Return eigenvalues of the periodic influence matrix.

    `columns` are frequencies in x, from 0 to nx // 2, and `rows` frequencies in y, from 0 to ny // 2. For ``love`` the
    frequencies may also be fractions. `compliance` is (1 - nu) / (pi G) [mm2/N]. The shape is (columns, rows), the unit
    mm / (N/mm2). The eigenvalue at frequency (0, 0) is zero.
    """
    symbol = {"spectral": _spectral, "love": _love}[grid.periodic]
    with events.coeffs:
        return 2 * np.pi * compliance * symbol(grid, np.asarray(columns), np.asarray(rows))


def _spectral(grid, columns, rows):
    qx, qy = wave_numbers(grid, columns, rows)
    q = np.hypot(qx[:, None], qy)
    return np.divide(1.0, q, out=np.zeros_like(q), where=q > 0)


def _love(grid, columns, rows):
    """Return the symbol ``love``, divided by 2 pi times the compliance.

    The symbol is the Fourier transform of the displacement (2.4) by a cell and all its images. For each frequency the
    symbol is the sum of ``sinc(qx dx / 2) sinc(qy dy / 2) / |q|`` over all waves q that have the same values at the
    cell centres (aliases). ``1 / |q|`` is written as an integral of ``exp(-s^2 |q|^2)`` over lengths s (Ewald). For
    each s the sum over aliases is a product of a sum in x and a sum in y. If s is more than two cells, only the longest
    wave matters, and its integral is known in closed form.
    """
    lengths, weights = _quadrature(*sorted((grid.dx, grid.dy)))
    x, y = (2 * np.pi / n * np.asarray(index) for index, n in ((columns, grid.nx), (rows, grid.ny)))
    total = np.empty((x.size, y.size))
    for columns in row_blocks(x.size, lengths.size):
        in_x = weights * _line_sums(x[columns], lengths / grid.dx)
        nonzero = in_x.any(axis=0)  # Most lengths are too long for most waves in x if cells are long in y.
        for rows in row_blocks(y.size, lengths.size):
            in_y = _line_sums(y[rows], lengths[nonzero] / grid.dy)
            total[columns, rows] = in_x[:, nonzero] @ in_y.T
    q = np.hypot(x[:, None] / grid.dx, y / grid.dy)
    wave = np.sinc(x / (2 * np.pi))[:, None] * np.sinc(y / (2 * np.pi))
    wave *= erfc(_MAX_WIDTH * max(grid.dx, grid.dy) * q)
    total += np.divide(wave, q, out=np.zeros_like(q), where=q > 0)
    total[np.ix_(x == 0, y == 0)] = 0.0
    return total


@lru_cache(maxsize=64)
def _quadrature(short, long):
    """Return nodes and weights of the integral over lengths s in `_love`.

    `short` and `long` are the sides of a cell. The integral is from 0 to `_MAX_WIDTH` times the long side. The weights
    include the factor 2 / sqrt(pi). The interval is divided into panels for Gauss's quadrature; a panel is at most
    twice as long as the panel before it. The first panel has one node, because the integrand is 1 there, up to
    rounding.
    """
    first, last = _MIN_WIDTH * short, _MAX_WIDTH * long
    panels = int(np.ceil(np.log2(last / first)))
    edges = np.append(first * (last / first) ** (np.arange(panels) / panels), last)
    places, weights = np.polynomial.legendre.leggauss(_POINTS)
    half = np.diff(edges)[:, None] / 2
    lengths = np.append(first / 2, edges[:-1, None] + half * (1 + places))
    return lengths, np.append(first, half * weights) * 2 / np.sqrt(np.pi)


def _line_sums(phases, lengths):
    """Return sums of ``sinc(q / 2) exp(-s^2 q^2)`` over aliased waves q.

    Aliased waves have equal values at the centres of cells of side 1. `phases` are their phase differences between
    neighbouring cells, from 0 to pi, and `lengths` the lengths s. The shape is (phases, lengths). For short lengths the
    same sum is computed in real space: it is a sum over neighbouring cells of a Gaussian integrated over the cell.
    """
    sums, short = np.zeros((phases.size, lengths.size)), lengths < 0.5
    long = ~short & (lengths * phases.min(initial=np.pi) < 6.5)  # For longer ones every term is 0.
    cells = np.arange(7)
    edges = erfc((np.arange(8)[:, None] - 0.5) / (2 * lengths[short]))
    sums[:, short] = np.cos(np.outer(phases, cells)) * np.where(cells, 1, 0.5) @ -np.diff(edges, axis=0)
    waves = phases[:, None] + 2 * np.pi * np.arange(-2, 2)
    terms = np.exp(-((lengths[long, None] * waves[:, None, :]) ** 2))
    sums[:, long] = (terms @ np.sinc(waves / (2 * np.pi))[:, :, None])[..., 0]
    return sums


def periodic_quadrant(grid, kernel):
    """Return periodic influence coefficients up to half a period [mm / (N/mm2)]."""
    symbol = kernel.eigenvalues(grid, np.arange(grid.nx // 2 + 1), np.arange(grid.ny // 2 + 1))
    in_y = transform_even(symbol, grid.ny)
    return transform_even(np.ascontiguousarray(in_y.T), grid.nx) / grid.n


def fold_offsets(offsets, n):
    """Return offsets within half a period, equivalent for even periodic functions."""
    return np.minimum(offsets % n, -offsets % n)
