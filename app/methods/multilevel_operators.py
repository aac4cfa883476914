"""A, and the inverse of A continued periodically, by stencils on several grids and transforms on the coarsest.

The inverse, B, differs from that by transforms by less than CG could notice. Contact at one edge of the patch is no
neighbour of that at the other: between them are some cells of the coarsest grid.

A by levels (`create_multilevel_influence`) is wrong by about 1% on short waves and less on long ones, in a quarter to
a third of the time of a product in single precision. That is enough for corrections of the pressure, whose displacement
the next product replaces (defect correction [1]_).

On a periodic patch it is the inverse that corrections are multiplied by (`create_multilevel_inverse`): wrong by up to
0.5% on short waves of ``love``'s cells, and by up to 9% on those of the ``spectral`` symbol, which has a kink there.

On small grids transforms are quick: there are no stencils.

References
----------
.. [1] K. Boehmer, P.W. Hemker, H.J. Stetter, The defect correction approach, Computing Suppl. 5 (1984) 1-32.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.fft import next_fast_len

from app.halfspace.fft.lengths import fast_length, transform_length
from app.halfspace.fft.multiplier import SERIAL, EvenMultiplier
from app.halfspace.grid import Grid
from app.halfspace.influence import middle_displacement, quadrant_rows
from app.methods.multilevel_product import MultilevelOperator, coarse_shape
from app.methods.symbol import coarsening_factors, coarser, eigenvalues, near_field_correction, stencils

# Cells in a direction to be coarsened from which on stencils take less time than transforms.
MIN_CELLS = 128
MIN_CELLS_PERIODIC = 512  # there transforms are not padded, and right


def create_circulant_inverse(grid, compliance, layout=SERIAL, apart=False):
    """The inverse of A on a free patch, continued periodically.

    Collective over the ranks of the layout.

    Parameters
    ----------
    grid, compliance
        See `InfluenceOperator`.
    layout : Layout
    apart : bool
        With free cells before the continuation, so that contact at one edge is no neighbour of that at the other, and
        by levels but for small grids: for CG. Else by transforms, and the continuation adjoins: a displacement, as
        `lift` has it, would jump to zero.

    Returns
    -------
    EvenMultiplier or MultilevelOperator
    """
    unit = 1 / (compliance * max(grid.dx, grid.dy))
    near = [level.times(unit) for level in (_stencils(grid, -1) if apart else ())]
    (cy, cx), shape = coarsening_factors(near), _coarsest_shape(grid, near)
    periods = shape
    if apart:  # coarse cells cover more than the patch already; without them a cell is added
        periods = tuple(next_fast_len(n, real=True) if near else fast_length(n + 1) for n in shape)
    constants = middle_displacement(compliance, (cy * periods[0] * grid.dy, cx * periods[1] * grid.dx))
    coarsest = _coarsest_inverse(grid, compliance, near, periods, constants)
    if near:
        return MultilevelOperator(grid.shape, near, coarsest, layout)
    return coarsest(shape, layout)


def _coarsest_inverse(grid, compliance, near, periods, constants):
    """Return a function that makes what is left of the inverse by transforms; `constants`: their eigenvalue of A."""
    cy, cx = coarsening_factors(near)

    def symbol(columns, rows):
        x, y = columns * 2 / (cx * periods[1]), rows * 2 / (cy * periods[0])
        found = eigenvalues(grid, compliance, x, y)
        found[(x[:, None] == 0) & (y == 0)] = constants
        return coarser(1 / found, near, x, y)

    def coarsest(shape, layout):
        inverse = EvenMultiplier(shape, periods, layout)
        inverse.use(layout.spectra, len(near), partial(inverse.set_spectrum, symbol))
        return inverse

    return coarsest


def create_multilevel_influence(grid, compliance, layout=SERIAL, other=None):
    """A on a free patch, nearly.

    Collective over the ranks of the layout.

    Parameters
    ----------
    grid, compliance, layout
        See `create_circulant_inverse`.
    other : MultilevelOperator, optional
        See there.

    Returns
    -------
    MultilevelOperator, or None
        If it has no stencils.
    """
    unit = compliance * max(grid.dx, grid.dy)
    near = [level.times(unit) for level in _stencils(grid, 1)]
    if not near:
        return None
    (cy, cx), (ny, nx) = coarsening_factors(near), _coarsest_shape(grid, near)
    far = quadrant_rows(Grid(nx, ny, cx * grid.dx, cy * grid.dy), compliance / (cx * cy))
    beside = unit * near_field_correction(grid, len(near))

    def kernel(rows):
        found, offsets = far(rows), np.arange(ny)[rows]
        close = beside[offsets[offsets < len(beside)], :nx]
        found[: len(close), : close.shape[1]] += close
        return found

    def coarsest(shape, layout):
        product = EvenMultiplier(shape, tuple(map(transform_length, shape)), layout)
        product.use(layout.spectra, ("influence", len(near)), partial(product.set_kernel, kernel, *shape))
        return product

    return MultilevelOperator(grid.shape, near, coarsest, layout, other)


def create_multilevel_inverse(grid, compliance, layout=SERIAL):
    """The inverse of A on a periodic patch, nearly.

    Collective over the ranks of the layout.

    Parameters
    ----------
    grid, compliance, layout
        See `create_circulant_inverse`.

    Returns
    -------
    MultilevelOperator, or None
        If it has no stencils: there are few cells, or an odd number.
    """
    unit = 1 / (compliance * max(grid.dx, grid.dy))
    near = [level.times(unit) for level in _stencils(grid, -1)]
    if not near:
        return None
    coarsest = _coarsest_inverse(grid, compliance, near, _coarsest_shape(grid, near), np.inf)
    return MultilevelOperator(grid.shape, near, coarsest, layout, periodic=True)


def multilevel_influence(operator):
    """A by levels on the grid of an `InfluenceOperator`, made when first asked for, or None. Collective."""
    if operator.grid.periodic:
        return None
    inverse = operator.multipliers.get("apart")
    other = inverse if isinstance(inverse, MultilevelOperator) else None
    return get_or_create(operator, "influence", create_multilevel_influence, other=other)


def multilevel_inverse(operator):
    """Its inverse by levels on the grid of an `InfluenceOperator` of a periodic patch, likewise. Collective."""
    return get_or_create(operator, "inverse", create_multilevel_inverse)


def get_or_create(operator, name, make, **more):
    """What an `InfluenceOperator` has by a name, made if there is none; None on ranks without rows. Collective then."""
    made = operator.multipliers
    if name not in made and operator.active:
        made[name] = make(operator.grid, operator.compliance, operator.layout(), **more)
    return made.get(name)


def _stencils(grid, power):
    least = MIN_CELLS_PERIODIC if grid.periodic else MIN_CELLS
    if max(grid.shape) < least or min(grid.shape) < least // 2:
        return ()
    found, (ny, nx) = stencils(grid, power), grid.shape
    for number, (_, (fy, fx)) in enumerate(found):
        halved = not grid.periodic or ny % fy == nx % fx == 0
        ny, nx = ny // fy, nx // fx
        if min(ny, nx) < MIN_CELLS // 2 or not halved:
            return found[:number]
    return found


def _coarsest_shape(grid, near):
    shape = grid.shape
    for level in near:
        shape = coarse_shape(shape, level.factors, bool(grid.periodic))
    return shape


def prepare(grid):
    """Prepare what products on a free grid, and in windows of it, need. Not collective."""
    _stencils(grid, -1)
    for levels in range(1, len(_stencils(grid, 1)) + 1):
        near_field_correction(grid, levels)
