"""Stencils that approximate A and its inverse on a periodic patch.

The stencils of a hierarchy of grids make up a multilevel product (`app.methods.multilevel_product`). The stencils are
fitted to the eigenvalues lambda(q) of A at wave vectors q. A free patch is continued periodically: except for q = 0,
`app.halfspace.periodic_symbol` has the eigenvalues (``love``, for uniform pressure on cells). In units of a cell they
depend only on the ratio of its sides, so all grids of a problem share the stencils. An eigenvalue is the spectrum of
one cell, `sinc sinc / |q|`, plus its aliases. The sum of the aliases is smooth in q, and is interpolated.

lambda, about 1 / |q|, and 1 / lambda are smooth except at q = 0. (With the ``spectral`` symbol, 1 / |q|, they also have
a kink at the highest waves.) So a stencil approximates them, except for long waves. The remainder contains only long
waves, so it is represented on a grid twice as coarse, and so on for level l = 0, 1, ...:

    g_0 = lambda or 1 / lambda,    g_l(k) = n_l(k) + 4 c^6 g_(l+1)(2 k),    c^6 = cos(kx / 2)^6 cos(ky / 2)^6,

Here k are the wave numbers in units of the cells of level l, `n_l` the eigenvalues of a stencil of 5 x 5 cells, and 4
c^6 the factor of restriction and interpolation. Long cells are first coarsened only in their shorter direction, until
they are nearly square. The factor is then 2 cos(kx / 2)^6 or 2 cos(ky / 2)^6 instead of 4 c^6.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from app.halfspace import events
from app.halfspace.chebyshev import chebyshev_nodes, even_chebyshev, fit_even_chebyshev
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.periodic_symbol import influence_symbol

REACH = 2  # cells of a stencil in each direction
CHEBYSHEV_TERMS = 10  # even polynomials in each direction: accurate to rounding
SAMPLED_WAVES = 48  # wave numbers in each direction to which a stencil is fitted
MIN_FITTED_WAVE = (
    0.32  # smallest fitted wave number over the highest one; longer waves are left to coarser grids
)
MAX_ASPECT = 1.75  # largest side ratio of cells that are coarsened in both directions
MAX_CELLS_PER_COARSE_CELL = 256  # fine cells per cell of the coarsest grid
MAX_INTERPOLATED_ASPECT = 16.0  # largest side ratio of cells; longer ones would need too many Chebyshev terms
_WAVES = (np.arange(SAMPLED_WAVES) + 0.5) / SAMPLED_WAVES


class StencilLevel(NamedTuple):
    """Stencil of a level, and its coarsening factors to the next level."""

    stencil: (
        np.ndarray
    )  # (REACH + 1, REACH + 1), a quadrant [x, y] as factors of cosines: twice the weight of a side
    factors: tuple  # (fy, fx), fine cells per coarse cell


def coarsening_factors(near):
    """Return the size (y, x) of a coarse cell in finest cells.

    `near` lists the StencilLevels from the finest grid to the coarse grid. They treat the near field of the kernel.
    """
    return tuple(int(np.prod([level.factors[axis] for level in near])) for axis in (0, 1))


def eigenvalues(grid, compliance, x, y):
    """Compute eigenvalues of the periodic continuation of A.

    Parameters
    ----------
    grid : Grid
    compliance : float
        Compliance of the half-space [mm2/N].
    x, y : ndarray
        Wave numbers in x and y, divided by the highest ones, pi / dx and pi / dy: 0 to 1.

    Returns
    -------
    ndarray, shape (x.size, y.size), [mm / (N/mm2)]
        Eigenvalue for each pair of wave numbers; infinite for the constant, where both are 0.
    """
    side = max(grid.dx, grid.dy)
    with events.coeffs:
        values = _eigenvalues(grid.symbol or "love", grid.dx / side, grid.dy / side, x, y)
    return 2 * np.pi * compliance * side * values


def _eigenvalues(kind, dx, dy, x, y):
    if kind == "spectral" or max(dx, dy) > MAX_INTERPOLATED_ASPECT * min(dx, dy):
        values = _compute_directly(kind, dx, dy, x, y)
        values[(x[:, None] == 0) & (y == 0)] = np.inf
        return values
    terms = _smooth_part(dx, dy)
    in_x, in_y = (even_chebyshev(t, count) for t, count in zip((x, y), terms.shape, strict=True))
    return _of_cell(dx, dy, x, y) + in_x @ terms @ in_y.T


def _of_cell(dx, dy, x, y):
    cell = np.sinc(x / 2)[:, None] * (np.sinc(y / 2) / np.pi)
    with np.errstate(divide="ignore"):
        return cell / np.sqrt((x / dx)[:, None] ** 2 + (y / dy) ** 2)


def _compute_directly(kind, dx, dy, x, y):
    two = Grid(2, 2, dx, dy, periodic=kind)  # its wave numbers are pi / d times "frequencies"
    return influence_symbol(two, 1 / (2 * np.pi), x, y)


@lru_cache(maxsize=16)
def _smooth_part(dx, dy):
    """Return Chebyshev coefficients of the smooth part of eigenvalues.

    The smooth part is the sum over the aliases of a wave. The shape of the result is (terms in x, terms in y).
    """
    counts = [int(np.ceil(CHEBYSHEV_TERMS * max(1.0, ratio))) for ratio in (dy / dx, dx / dy)]
    x, y = map(chebyshev_nodes, counts)
    return fit_even_chebyshev(_compute_directly("love", dx, dy, x, y) - _of_cell(dx, dy, x, y))


def centre(grid, kernel=UNIT):
    """Return the 3 x 3 centre of B, up to a factor.

    B is the inverse of the periodic continuation of A.
    """
    side = max(grid.dx, grid.dy)
    return _centre(grid.dx / side, grid.dy / side, kernel.in_units(side))


@lru_cache(maxsize=16)
def _centre(dx, dy, kernel):
    t = _WAVES
    quarter = _cosines(t, 2).T @ _powers("love", dx, dy, t, t, -1, kernel) @ _cosines(t, 2)
    return quarter[np.ix_((1, 0, 1), (1, 0, 1))].T


def fit_stencils(grid, power=-1, kernel=UNIT):
    """Fit stencils to A (`power` 1) or to its inverse (`power` -1).

    Return StencilLevels, finest first, for compliance 1 and cells whose longer side is 1.
    """
    side = max(grid.dx, grid.dy)
    with events.coeffs:
        return _stencils(grid.symbol or "love", grid.dx / side, grid.dy / side, power, kernel.in_units(side))


@lru_cache(maxsize=32)
def _stencils(kind, dx, dy, power, kernel):
    t, near = _WAVES, []
    cosines = _cosines(t, REACH + 1)
    shapes = np.einsum("ia,jb->ijab", cosines, cosines)
    while np.prod(cells := coarsening_factors(near)) < MAX_CELLS_PER_COARSE_CELL:
        x, y = t / cells[1], t / cells[0]
        values = _powers(kind, dx, dy, x, y, power, kernel)
        fitted = coarsen_symbol(values, near, x, y)
        wide, high = cells[1] * dx, cells[0] * dy
        factors = (2, 1) if wide > MAX_ASPECT * high else (1, 2) if high > MAX_ASPECT * wide else (2, 2)
        fy, fx = factors
        short = np.hypot((fx - 1) * t[:, None], (fy - 1) * t) > MIN_FITTED_WAVE
        weight = np.where(short, 1.0, 1e-3) / values
        system = (weight[..., None, None] * shapes).reshape(t.size**2, -1)
        stencil, *_ = np.linalg.lstsq(system, (weight * fitted).reshape(-1), rcond=None)
        near.append(StencilLevel(stencil.reshape(REACH + 1, REACH + 1), factors))
    return tuple(near)


def near_field_correction(grid, levels, kernel=UNIT):
    """Return the near-field correction of influence coefficients.

    Multilevel A has stencils on the `levels` finest grids. On the next coarser grid it uses the influence coefficients
    plus this correction. The correction vanishes at large distances, where only the load of a cell matters, not its
    shape. The result has the shape (offsets in y, offsets in x). The correction is for compliance 1, and for cells of
    the finest grid whose longer side is 1.
    """
    side = max(grid.dx, grid.dy)
    return _near_field_correction(grid.dx / side, grid.dy / side, levels, kernel.in_units(side))


@lru_cache(maxsize=32)
def _near_field_correction(dx, dy, levels, kernel):
    t, near = _WAVES, _stencils("love", dx, dy, 1, kernel)[:levels]
    cy, cx = coarsening_factors(near)
    rest = coarsen_symbol(_powers("love", dx, dy, t / cx, t / cy, 1, kernel), near, t / cx, t / cy)
    side = max(cx * dx, cy * dy)  # of the coarse cells, which have mean pressures
    coarse = _powers("love", cx * dx / side, cy * dy / side, t, t, 1, kernel.in_units(side))
    rest -= side / (cx * cy) * coarse
    cosines = _cosines(t, SAMPLED_WAVES // 4)
    return (cosines.T @ rest @ cosines).T / t.size**2


def _powers(kind, dx, dy, x, y, power, kernel):
    """Return A's eigenvalues (`power` 1) or their reciprocals (-1).

    The compliance of the kernel is 1. In the inverse, aliased waves have the compliance of the wave itself.
    """
    values = 2 * np.pi * _eigenvalues(kind, dx, dy, x, y)
    if power == 1:
        values = kernel.scale_sampled(values, Grid(2, 2, dx, dy, periodic=kind), x, y)
    else:
        values = kernel.scale(values, np.pi * x[:, None] / dx, np.pi * y / dy)
    return values**power


def coarsen_symbol(values, near, x, y):
    """Return what is left of eigenvalues after subtracting those of the stencils.

    `values`, shape (x.size, y.size), are the eigenvalues at the wave numbers x and y, in units of the highest wave
    numbers of the finest grid. `near` are the StencilLevels, in the unit of `values`. The result has the eigenvalues
    for the next coarser grid, g_l in the module docstring.
    """
    for stencil, (fy, fx) in near:
        stencil_values = _cosines(x, len(stencil)) @ stencil @ _cosines(y, len(stencil)).T
        in_x, in_y = (
            2 * np.cos(np.pi / 2 * t) ** 6 if factor == 2 else np.ones(t.size)
            for t, factor in ((x, fx), (y, fy))
        )
        values = (values - stencil_values) / (in_x[:, None] * in_y)
        x, y = fx * x, fy * y
    return values


def _cosines(t, count):
    return np.cos(np.pi * t[:, None] * np.arange(count))
