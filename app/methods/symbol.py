"""Eigenvalues of the circulant that stands for A, and what stencils can say of them and of their inverse.

A patch that is continued periodically has, but for its mean, the influence matrix of
`app.halfspace.periodic_symbol`, with
``love``'s cells. In units of a cell, its eigenvalues depend on the aspect of the cell alone: all grids of a problem
share what is found here. They are `sinc sinc / |q|`, which is that of a cell, and what its images in Fourier space
add, which is smooth and interpolated.

They, about 1 / |q|, and their inverse are smooth but for q = 0; those of the ``spectral`` symbol, 1 / |q| itself, have
a kink at the highest waves, too. So a stencil gives them for all but long waves; what is left is of long waves alone,
and known on a grid twice as coarse; and so on:

    g_0 = lambda or 1 / lambda,    g_l = n_l + 4 c^6 g_(l+1)(2 k),    c^6 = cos(kx / 2)^6 cos(ky / 2)^6,

`n_l` a stencil of 5 x 5 cells, 4 c^6 what interpolation from the coarser grid and its transpose do to a wave. Of long
cells only the shorter sides are joined first, until they are nearly square: then it is 2 cos(ky / 2)^6, or that of x.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from app.halfspace import events
from app.halfspace.chebyshev import chebyshev_nodes, even_chebyshev, fit_even_chebyshev
from app.halfspace.grid import Grid
from app.halfspace.periodic_symbol import influence_symbol

REACH = 2  # of a stencil, cells in each direction
CHEBYSHEV_TERMS = 10  # even Chebyshev polynomials in a direction: rounding is left
SAMPLED_WAVES = 48  # waves in a direction that a stencil is fitted to
MIN_FITTED_WAVE = (
    0.32  # share of the highest frequency up to which waves are long: they are left to coarser grids
)
MAX_ASPECT = 1.75  # ratio of the sides of a cell from which on only the shorter ones are joined
MAX_CELLS_PER_COARSE_CELL = 256  # cells in one of the coarsest grid, at most
MAX_INTERPOLATED_ASPECT = 16.0  # ratio of the sides of a cell from which on interpolation has too many terms


class StencilLevel(NamedTuple):
    """What is said of a level by a stencil, and how the next one is coarser."""

    stencil: np.ndarray  # (REACH + 1, REACH + 1), a quadrant [x, y], whose sides count twice, as cosines do
    factors: tuple  # (fy, fx)

    def times(self, unit):
        """Return the same in another unit. Not collective."""
        return self._replace(stencil=unit * self.stencil)


def coarsening_factors(near):
    """How many cells (in y, in x) one of the grid below some levels is made of. Not collective."""
    return tuple(int(np.prod([level.factors[axis] for level in near])) for axis in (0, 1))


def eigenvalues(grid, compliance, x, y):
    """Eigenvalues of A, continued periodically, but for the mean.

    Not collective.

    Parameters
    ----------
    grid : Grid
    compliance : float
        [mm2/N].
    x, y : ndarray
        Wave numbers in x and y over the highest ones, pi / dx and pi / dy, 0 to 1.

    Returns
    -------
    ndarray, shape (x, y), [mm / (N/mm2)]
        Infinite for a wave number 0 in both.
    """
    side = max(grid.dx, grid.dy)
    with events.coeffs:
        return 2 * np.pi * compliance * side * _eigenvalues(_kind(grid), grid.dx / side, grid.dy / side, x, y)


def _kind(grid):
    """``love``, as if periodic, or of a periodic grid what it is."""
    return grid.periodic or "love"


def _eigenvalues(kind, dx, dy, x, y):
    if kind == "spectral" or max(dx, dy) > MAX_INTERPOLATED_ASPECT * min(dx, dy):
        found = _directly(kind, dx, dy, x, y)
        found[(x[:, None] == 0) & (y == 0)] = np.inf
        return found
    terms = _smooth_part(dx, dy)
    in_x, in_y = (even_chebyshev(t, count) for t, count in zip((x, y), terms.shape, strict=True))
    return _of_cell(dx, dy, x, y) + in_x @ terms @ in_y.T


def _of_cell(dx, dy, x, y):
    cell = np.sinc(x / 2)[:, None] * (np.sinc(y / 2) / np.pi)
    with np.errstate(divide="ignore"):
        return cell / np.sqrt((x / dx)[:, None] ** 2 + (y / dy) ** 2)


def _directly(kind, dx, dy, x, y):
    two = Grid(2, 2, dx, dy, periodic=kind)  # whose wave numbers are pi / d times "frequencies"
    return influence_symbol(two, 1 / (2 * np.pi), x, y)


@lru_cache(maxsize=16)
def _smooth_part(dx, dy):
    """Coefficients [x, y] of even Chebyshev polynomials for what images in Fourier space add."""
    counts = [int(np.ceil(CHEBYSHEV_TERMS * max(1.0, ratio))) for ratio in (dy / dx, dx / dy)]
    x, y = map(chebyshev_nodes, counts)
    return fit_even_chebyshev(_directly("love", dx, dy, x, y) - _of_cell(dx, dy, x, y))


def centre(grid):
    """Entries of the inverse between a cell and its eight neighbours, shape (3, 3), in some unit. Not collective."""
    side = max(grid.dx, grid.dy)
    return _centre(grid.dx / side, grid.dy / side)


@lru_cache(maxsize=16)
def _centre(dx, dy):
    t = _samples()
    quarter = _cosines(t, 2).T @ _powers("love", dx, dy, t, t, -1) @ _cosines(t, 2)
    return quarter[np.ix_((1, 0, 1), (1, 0, 1))].T


def stencils(grid, power=-1):
    """Fit the stencils of all levels. Not collective.

    Parameters
    ----------
    grid : Grid
    power : int
        1: of A; -1: of its inverse.

    Returns
    -------
    tuple of StencilLevel
        For unit compliance and cells whose longer side is 1.
    """
    side = max(grid.dx, grid.dy)
    with events.coeffs:
        return _stencils(_kind(grid), grid.dx / side, grid.dy / side, power)


@lru_cache(maxsize=32)
def _stencils(kind, dx, dy, power):
    t, near = _samples(), []
    cosines = _cosines(t, REACH + 1)
    shapes = np.einsum("ia,jb->ijab", cosines, cosines)
    while np.prod(cells := coarsening_factors(near)) < MAX_CELLS_PER_COARSE_CELL:
        x, y = t / cells[1], t / cells[0]
        whole = _powers(kind, dx, dy, x, y, power)
        wanted = coarser(whole, near, x, y)
        fy, fx = factors = _coarsening(cells[1] * dx, cells[0] * dy)
        short = np.hypot((fx - 1) * t[:, None], (fy - 1) * t) > MIN_FITTED_WAVE
        weight = np.where(short, 1.0, 1e-3) / whole
        system = (weight[..., None, None] * shapes).reshape(t.size**2, -1)
        stencil, *_ = np.linalg.lstsq(system, (weight * wanted).reshape(-1), rcond=None)
        near.append(StencilLevel(stencil.reshape(REACH + 1, REACH + 1), factors))
    return tuple(near)


def _coarsening(dx, dy):
    if dx > MAX_ASPECT * dy:
        return 2, 1
    return (1, 2) if dy > MAX_ASPECT * dx else (2, 2)


def near_field_correction(grid, levels):
    """What is left of A on the coarsest grid, less that grid's own influence coefficients. Not collective.

    It is next to nothing far away, where only the load of a cell counts, not its shape.

    Parameters
    ----------
    grid : Grid
    levels : int
        Stencils before it.

    Returns
    -------
    ndarray, shape (offsets in y, offsets in x)
        For unit compliance and cells (of the finest grid) whose longer side is 1.
    """
    side = max(grid.dx, grid.dy)
    return _left_near_by(grid.dx / side, grid.dy / side, levels)


@lru_cache(maxsize=32)
def _left_near_by(dx, dy, levels):
    t, near = _samples(), _stencils("love", dx, dy, 1)[:levels]
    cy, cx = coarsening_factors(near)
    left = coarser(_powers("love", dx, dy, t / cx, t / cy, 1), near, t / cx, t / cy)
    side = max(cx * dx, cy * dy)  # of cells so many times as large, by whose mean pressure is multiplied
    left -= side / (cx * cy) * _powers("love", cx * dx / side, cy * dy / side, t, t, 1)
    cosines = _cosines(t, SAMPLED_WAVES // 4)
    return (cosines.T @ left @ cosines).T / t.size**2


def _samples():
    return (np.arange(SAMPLED_WAVES) + 0.5) / SAMPLED_WAVES


def _powers(kind, dx, dy, x, y, power):
    """g_0 at wave numbers."""
    return (2 * np.pi * _eigenvalues(kind, dx, dy, x, y)) ** power


def spectrum_of(stencil, x, y):
    """Eigenvalues, shape (x, y), of a quadrant [x, y] of an even stencil whose sides count twice. Not collective."""
    return _cosines(x, len(stencil)) @ stencil @ _cosines(y, len(stencil)).T


def coarser(whole, near, x, y):
    """What is left of g_0 on a coarser grid, if those before it have stencils. Not collective.

    Parameters
    ----------
    whole : ndarray, shape (x, y)
        g_0.
    near : sequence of StencilLevel
        n_0, n_1, ...; in units of g_0.
    x, y : ndarray
        Wave numbers over the highest ones of the finest grid.

    Returns
    -------
    ndarray, shape (x, y)
    """
    left = whole
    for stencil, (fy, fx) in near:
        in_x, in_y = (
            2 * np.cos(np.pi / 2 * t) ** 6 if factor == 2 else np.ones(t.size)
            for t, factor in ((x, fx), (y, fy))
        )
        left = (left - spectrum_of(stencil, x, y)) / (in_x[:, None] * in_y)
        x, y = fx * x, fy * y
    return left


def _cosines(t, count):
    return np.cos(np.pi * t[:, None] * np.arange(count))
