"""Influence coefficients of an elastic half-space, eqs. (2.4)-(2.6).

``A_IJ = (1 - nu) / (pi G) * integral over cell J of 1/rho``, rho the distance from the centre of cell I.
On equal cells A depends only on ``|ix - jx|`` and ``|iy - jy|``: everything is known from the *quadrant*
``K[j, i]``, the displacement i cells to the right of and j cells above a cell under unit pressure.

========================  ===========================  ==============
paper                     here                         unit
========================  ===========================  ==============
G, nu                     ``Material``                 N/mm2, 1
A_(0,0),(i,j)             ``quadrant[j, i]``           mm / (N/mm2)
(1 - nu) / (pi G)         ``Material.compliance``      mm2/N
========================  ===========================  ==============
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

# The closed form subtracts numbers that are (rho/cell)^2 times larger than their difference. From 8 cells
# on Gauss quadrature of 1/rho over the cell is exact to round-off with ever fewer points, and cancels nothing:
# its relative error is (q!)^4 / ((2q+1) (2q)!^2) (cell/rho)^(2q).
_CLOSED_FORM_UP_TO = 8.0
_GAUSS_POINTS_FROM = ((8.0, 6), (16.0, 5), (32.0, 4), (128.0, 3), (2048.0, 2))


@dataclass(frozen=True)
class Material:
    """Combined elastic constants of the two bodies (Sec. 2.2).

    Parameters
    ----------
    shear_modulus : float
        G with 2/G = 1/G1 + 1/G2 [N/mm2]; a rigid body has 1/G1 = 0.
    poisson_ratio : float
        nu, from 0 to 0.5.
    """

    shear_modulus: float
    poisson_ratio: float

    def __post_init__(self):
        if not (np.isfinite(self.shear_modulus) and self.shear_modulus > 0):
            raise ValueError(f"shear modulus {self.shear_modulus:g}: must be positive and finite")
        if not 0 <= self.poisson_ratio <= 0.5:
            raise ValueError(f"Poisson ratio {self.poisson_ratio:g}: must be from 0 to 0.5")
        if not np.isfinite(self.compliance):
            raise ValueError(f"shear modulus {self.shear_modulus:g}: too small, its reciprocal is infinite")

    @property
    def compliance(self):
        """(1 - nu) / (pi G) [mm2/N]."""
        return (1 - self.poisson_ratio) / (np.pi * self.shear_modulus)

    @property
    def contact_modulus(self):
        """E* = G / (1 - nu) [N/mm2]."""
        return self.shear_modulus / (1 - self.poisson_ratio)


def _love(a, b):
    """Potential whose alternating sum over the corners of a rectangle is the integral of 1/rho over it."""
    return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))


def _closed_form(x, y, dx, dy):
    west, east = x - dx / 2, x + dx / 2
    south, north = y - dy / 2, y + dy / 2
    return _love(east, north) - _love(west, north) - _love(east, south) + _love(west, south)


def influence_quadrant(grid, compliance, rows=slice(None)):
    """Influence coefficients at all offsets with non-negative components.

    Not collective.

    Parameters
    ----------
    grid : Grid
    compliance : float
        (1 - nu) / (pi G) [mm2/N].
    rows : slice
        Offsets in y to compute, out of 0 .. ny-1.

    Returns
    -------
    ndarray, shape (number of rows, nx), [mm / (N/mm2)]
    """
    dx, dy = grid.dx, grid.dy
    cell = max(dx, dy)
    x = np.arange(grid.nx) * dx
    limits = [r for r, _ in _GAUSS_POINTS_FROM] + [np.inf]
    rules = []
    for _, q in _GAUSS_POINTS_FROM:
        nodes, weights = np.polynomial.legendre.leggauss(q)
        rules.append((nodes * dy / 2, weights * dy / 2, (x + nodes[:, None] * dx / 2) ** 2, weights * dx / 2))
    offsets = np.arange(grid.ny)[rows]
    quadrant = np.empty((len(offsets), grid.nx))
    for row, j in zip(quadrant, offsets, strict=True):
        y = j * dy
        distance = np.hypot(x, y) / cell  # increases along the row: each rule holds on one stretch of it
        edges = np.searchsorted(distance, limits)
        row[: edges[0]] = _closed_form(x[: edges[0]], y, dx, dy)
        for (start, stop), (y_nodes, y_weights, x_squared, x_weights) in zip(
            itertools.pairwise(edges), rules, strict=True
        ):
            if start == stop:
                continue
            row[start:stop] = 0
            for node, weight in zip(y_nodes, y_weights, strict=True):
                row[start:stop] += weight * (
                    x_weights @ (1 / np.sqrt(x_squared[:, start:stop] + (y + node) ** 2))
                )
    quadrant *= compliance
    return quadrant


def dense_matrix(grid, compliance):
    """The influence matrix itself, shape (n, n): for coarsest grids and checks. Not collective."""
    quadrant = influence_quadrant(grid, compliance)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    dj, di = np.abs(j[:, None] - j), np.abs(i[:, None] - i)
    return quadrant[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)
