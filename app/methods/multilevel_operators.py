"""Multilevel products with A and its periodic inverse B.

A multilevel product applies stencils on several grids, and an FFT on the coarsest grid. Small grids have no stencils,
because an FFT is fast there.

On a free patch multilevel B is used as preconditioner; the number of CG iterations is the same as with B by FFT. The
coarse grid is wider than the patch, so that opposite edges of the patch do not touch in the periodic continuation.

Multilevel A has an error of about 1% for short waves, and less for long waves. It takes a quarter to a third of the
time of a product by FFT in single precision. The accuracy is enough for corrections of the pressure, because the next
product by FFT replaces the displacement by the corrections (defect correction [1]_).

On a periodic patch only B has a multilevel product. For short waves its error is up to 0.5% with the ``love`` symbol,
and up to 9% with the ``spectral`` symbol, which has a kink there.

References
----------
.. [1] K. Boehmer, P.W. Hemker, H.J. Stetter, The defect correction approach, Computing Suppl. 5 (1984) 1-32.
"""

from functools import partial

import numpy as np
from scipy.fft import next_fast_len

from app.halfspace.fft.lengths import fast_length
from app.halfspace.fft.multiplier import SERIAL, EvenMultiplier
from app.halfspace.grid import Grid
from app.halfspace.influence import quadrant_rows
from app.halfspace.product import Convolution, half_lengths
from app.methods.multilevel_product import MultilevelOperator, coarse_shape
from app.methods.symbol import (
    centre,
    coarsen_symbol,
    coarsening_factors,
    eigenvalues,
    fit_stencils,
    near_field_correction,
)

MIN_CELLS = 128  # in the longer direction: on smaller grids an FFT is faster
MIN_CELLS_PERIODIC = 512  # the same on periodic grids, whose FFT is exact without padding
# Bounds of the compliance of 8-cell waves over that of 2-cell waves, within which 5 x 5 stencils approximate B well.
COMPLIANCE_RATIOS = 0.4, 5.0


def create_circulant_inverse(grid, kernel, layout=SERIAL, apart=False):
    """Create B, the inverse of A after periodic continuation of the patch.

    Collective over the ranks of the layout.

    Parameters
    ----------
    grid : Grid
        Grid of the patch.
    kernel : Kernel
        Kernel of the bodies.
    layout : Layout
        Distribution and precision of the fields.
    apart : bool
        True: a gap separates the patch from its copies, and B is multilevel except on small grids; CG uses this. False:
        there is no gap, and B is a plain FFT. `lift` uses this, because the displacement would jump across a gap.

    Returns
    -------
    EvenMultiplier or MultilevelOperator
        B by FFT, or multilevel.
    """
    near = _stencils(grid, -1, kernel) if apart else []
    (cy, cx), periods = coarsening_factors(near), _coarsest_shape(grid, near)
    if apart:  # coarse cells cover more than the patch; without them a cell is added
        widen = partial(next_fast_len, real=True) if near else lambda n: fast_length(n + 1)
        periods = tuple(n if r else widen(n) for n, r in zip(periods, grid.repeats, strict=True))
    mean = kernel.middle_displacement((cy * periods[0] * grid.dy, cx * periods[1] * grid.dx))
    return _create_inverse(grid, kernel, layout, near, periods, mean)


def create_multilevel_inverse(grid, kernel, layout=SERIAL):
    """Create the multilevel inverse B of a periodic patch, or return None.

    Collective over the ranks of the layout. The result is None if the grid is too small, or has an odd number of cells.
    The parameters are as in `create_circulant_inverse`.
    """
    near = _stencils(grid, -1, kernel)
    return _create_inverse(grid, kernel, layout, near, _coarsest_shape(grid, near), np.inf) if near else None


def _create_inverse(grid, kernel, layout, near, periods, mean):
    """Create the inverse B of A: multilevel, or by FFT alone.

    `near` lists the StencilLevels, none for an FFT alone. `periods` are the periods of the FFT on the coarsest grid;
    `mean` is the eigenvalue of A for constants.
    """
    cy, cx = coarsening_factors(near)

    def symbol(columns, rows):
        x, y = columns * 2 / (cx * periods[1]), rows * 2 / (cy * periods[0])
        values = kernel.scale(eigenvalues(grid, 1.0, x, y), np.pi * x[:, None] / grid.dx, np.pi * y / grid.dy)
        values[(x[:, None] == 0) & (y == 0)] = mean
        return coarsen_symbol(1 / values, near, x, y)

    def coarsest(shape, layout):
        inverse = EvenMultiplier(shape, periods, layout)
        inverse.load_or_make(len(near), partial(inverse.set_spectrum, symbol))
        return inverse

    if near:
        return MultilevelOperator(grid.shape, near, coarsest, layout, periodic=grid.periodic)
    return coarsest(grid.shape, layout)


def create_multilevel_influence(grid, kernel, layout=SERIAL, other=None):
    """Create the multilevel product with A of a free patch, or None.

    Collective over the ranks of the layout. The result is None if the grid is small. `other` is another multilevel
    product, with which coarse fields are shared. The other parameters are as in `create_circulant_inverse`.
    """
    near = _stencils(grid, 1, kernel)
    if not near:
        return None
    (cy, cx), (ny, nx) = coarsening_factors(near), _coarsest_shape(grid, near)
    coarse = Grid(nx, ny, cx * grid.dx, cy * grid.dy, periodic=grid.one_way)
    coefficients = quadrant_rows(coarse, kernel)
    correction = kernel.compliance * max(grid.dx, grid.dy) * near_field_correction(grid, len(near), kernel)

    def corrected(rows):
        values, offsets = coefficients(rows) / (cx * cy), np.arange(ny)[rows]
        added = correction[offsets[offsets < len(correction)], :nx]
        values[: len(added), : added.shape[1]] += added
        return values

    def coarsest(shape, layout):
        product = EvenMultiplier(shape, Convolution.lengths(shape, grid.repeats), layout)
        halves = half_lengths(shape, product.periods)
        product.load_or_make(
            ("influence", len(near), halves), partial(product.set_kernel, corrected, *halves)
        )
        return product

    return MultilevelOperator(grid.shape, near, coarsest, layout, other, grid.periodic)


def multilevel_influence(operator):
    """Return an operator's multilevel product with A. Collective.

    The product is created on first use. None on periodic patches and small grids.
    """
    if operator.grid.doubly_periodic:
        return None
    inverse = operator.multipliers.get("apart")
    other = inverse if isinstance(inverse, MultilevelOperator) else None
    return get_or_create(operator, "influence", create_multilevel_influence, other=other)


def multilevel_inverse(operator):
    """Return the multilevel product with B = A^-1. Collective.

    The product is created on first use. None on small grids, and for odd numbers of cells.
    """
    return get_or_create(operator, "inverse", create_multilevel_inverse)


def get_or_create(operator, name, create, **options):
    """Return an operator's product with a given name, created on first use.

    The function ``create`` creates the product; it is collective. The result is None on ranks without rows.
    """
    multipliers = operator.multipliers
    if name not in multipliers and operator.active:
        multipliers[name] = create(operator.grid, operator.kernel, operator.layout(), **options)
    return multipliers.get(name)


def prepare(grid, kernel):
    """Precompute stencils for a free grid and its windows."""
    centre(grid)
    _stencils(grid, -1, kernel)
    for levels in range(1, len(_stencils(grid, 1, kernel)) + 1):
        near_field_correction(grid, levels, kernel)


def _stencils(grid, power, kernel):
    """Return the StencilLevels of A (`power` 1) or its inverse (-1).

    The result has no stencils for levels so small that an FFT is faster. Periodic patches stop at the first level
    outside COMPLIANCE_RATIOS.
    """
    smallest = MIN_CELLS_PERIODIC if grid.doubly_periodic else MIN_CELLS
    periods = grid.shape if grid.doubly_periodic else kernel.period_cells(grid)
    if max(grid.shape) < smallest or min(grid.shape) < smallest // 2:
        return []
    dy, dx, levels, (ny, nx) = grid.dy, grid.dx, [], grid.shape
    unit = kernel.compliance * max(dy, dx)
    for level in fit_stencils(grid, power, kernel):
        if grid.doubly_periodic and not _has_accurate_stencils(kernel, max(dy, dx)):
            break
        fy, fx = level.factors
        dy, dx = fy * dy, fx * dx
        divisible = all(n % f == 0 for n, f in zip(periods, level.factors, strict=True))
        periods = tuple(n // f for n, f in zip(periods, level.factors, strict=True))
        ny, nx = ny // fy, nx // fx
        if min(ny, nx) < MIN_CELLS // 2 or not divisible:
            break
        levels.append(level._replace(stencil=(unit if power == 1 else 1 / unit) * level.stencil))
    return levels


def _has_accurate_stencils(kernel, side):
    """Return whether stencils of cells with this longer `side` approximate B well."""
    lowest, highest = COMPLIANCE_RATIOS
    return lowest <= kernel.compliance_at(8 * side) / kernel.compliance_at(2 * side) <= highest


def _coarsest_shape(grid, near):
    shape = grid.shape
    for level in near:
        shape = coarse_shape(shape, level.factors, grid.periodic)
    return shape
