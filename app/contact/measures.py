"""Numbers that describe a solution and its surface: load, mean gap, perimeter of the contact, roughness.

A *face* lies between two cells side by side; on a periodic patch also between its first and last cells. Beyond the rim
of a free patch nothing is in contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.base.numba_cache import njit
from app.contact import kernels
from app.halfspace.periodic_symbol import wave_numbers
from app.halfspace.product import PeriodicProduct
from app.parallel.halo import fetch_row_before
from app.parallel.reductions import add_tuples, njit_reassoc, sum_over, sums_and_minima

# Cells that a boundary crosses count as contact too often: by so much of a cell for each face on it, on average over
# directions (Yastrebov, Anciaux, Molinari, Tribol. Int. 114 (2017) 161).
PER_FACE = (np.pi - 1 + np.log(2)) / 24


class ContactMeasures(NamedTuple):
    """Of a solution; the same on all ranks."""

    load: float  # [N]
    max_pressure: float  # [N/mm2]
    mean_pressure: float  # load over the area of the patch [N/mm2]
    mean_gap: float  # of e = h + u over the admissible cells [mm]
    contact_cells: int
    contact_area: float  # their area [mm2]
    mean_contact_pressure: float  # load over it [N/mm2]; 0 without contact
    perimeter: float  # length of the faces between contact and no contact [mm]
    contact_fraction: float  # of the admissible cells
    contact_fraction_corrected: float  # less `PER_FACE` of a cell for each of these faces


class ShapeRoughness(NamedTuple):
    """Of the undeformed distance on the target grid; the same on all ranks."""

    rms_height: float  # about the mean, over the admissible cells [mm]
    rms_slope: float  # of the gradient's length; NaN where no two admissible cells lie side by side
    steps_at_sides: tuple  # rms, from cell to cell across the sides of a periodic patch, and beside [mm]


def measure_contact(state):
    """Measure a `ContactState` of all cells of a grid.

    Collective. Faces of different lengths are corrected alike: each moves the boundary by a part of the cell across it,
    so what counts is their number times the area of a cell.

    Returns
    -------
    ContactMeasures
    """
    grid, distance, slabs = state.grid, state.distance, state.operator.slabs
    _, total, _ = kernels.sum_gaps(distance.b, state.depth, state.u, state.admissible, state.admissible)
    force, highest, _ = kernels.sum_pressure(state.p, state.contact)
    # Cells that touch without pressure count, too, as in perimeter and patches.
    cells = np.count_nonzero(state.contact)
    in_x, in_y = kernels.count_faces(
        state.contact,
        fetch_row_before(state.contact, bool(grid.periodic), slabs, state.comm, False),
        bool(grid.periodic),
    )
    if slabs.local and slabs.rows.stop == grid.ny and not grid.periodic:
        in_y += np.count_nonzero(state.contact[-1])
    sums = total, cells, in_x, in_y, force
    (total, cells, in_x, in_y, force), (lowest,) = sums_and_minima(state.comm, sums, [-highest])
    load = grid.cell_area * float(force)
    admissible, mean, *_ = distance.statistics
    # Displacements of a periodic patch have no mean: that of e is known without their rounding.
    gap = mean - state.depth if grid.periodic and admissible == grid.n else total / admissible
    return ContactMeasures(
        load=load,
        max_pressure=-float(lowest),
        mean_pressure=load / grid.area,
        mean_gap=float(gap),
        contact_cells=int(cells),
        contact_area=float(cells * grid.cell_area),
        mean_contact_pressure=float(load / (cells * grid.cell_area)) if cells else 0.0,
        perimeter=float(in_x * grid.dy + in_y * grid.dx),
        contact_fraction=float(cells / admissible),
        contact_fraction_corrected=float((cells - PER_FACE * (in_x + in_y)) / admissible),
    )


def contact_width(state, contact, enough):
    """Count the cells of the longest run of contact in x, and in y. Collective.

    Parameters
    ----------
    state : ContactState
    contact : ContactMeasures
        Of it.
    enough : int
        Longer runs are not told apart.

    Returns
    -------
    tuple of int
        `enough` at most.
    """
    grid, slabs, periodic = state.grid, state.operator.slabs, bool(state.grid.periodic)
    excess = contact.contact_fraction - contact.contact_fraction_corrected
    # In each direction the mean run is at least twice the number of cells over that of all faces.
    if 2 * PER_FACE * contact.contact_fraction >= enough * excess:
        return enough, enough

    def longest(before):
        run, width = state.contact, 0
        while width < enough and state.sum([run.any()])[0]:
            run, width = run & before(run), width + 1
        return width

    def left(run):
        other = np.roll(run, 1, axis=1)
        other[:, :1] &= periodic
        return other

    def below(run):
        return np.concatenate([fetch_row_before(run, periodic, slabs, state.comm, False)[None], run])[:-1]

    return min(longest(left), grid.nx), min(longest(below), grid.ny)


def measure_roughness(operator, distance, shape):
    """Measure the undeformed distance of a problem on a grid.

    Collective. On a periodic patch without holes the slope is that of the waves the values stand for, by one product;
    else it is by differences across the faces between admissible cells.

    Parameters
    ----------
    operator : InfluenceOperator
        Of the grid.
    distance : UndeformedDistance
        On it.
    shape : ndarray, shape (local rows, nx), [mm]
        The same, NaN in inadmissible cells.

    Returns
    -------
    ShapeRoughness
    """
    grid = operator.grid
    waves = grid.periodic and distance.statistics.cells == grid.n
    square = _of_waves(operator, shape) if waves else _of_differences(operator, shape)
    steps = _steps_at_sides(operator, shape) if grid.periodic else (0.0, 0.0)
    return ShapeRoughness(distance.deviation, float(np.sqrt(square)), steps)


def _steps_at_sides(operator, shape):
    """See `ShapeRoughness`. Collective."""
    slabs, (ny, nx) = operator.slabs, operator.grid.shape
    below = fetch_row_before(shape, True, slabs, operator.comm, np.nan)

    def steps(columns, faces):
        here = [j - slabs.rows.start for j in faces if j in range(ny)[slabs.rows]]
        in_y = [shape[j] - (shape[j - 1] if j else below) for j in here]
        return np.concatenate([np.zeros(0), *(shape[:, i] - shape[:, i - 1] for i in columns), *in_y])

    found = steps([0], [0]), steps({1, nx - 1} - {0, nx}, {1, ny - 1} - {0, ny})
    squares = [np.nansum(np.square(those)) for those in found]
    counts = [np.count_nonzero(np.isfinite(those)) for those in found]
    *squares, across, beside = sum_over(operator.comm, [*squares, *counts])
    return tuple(map(float, np.sqrt(np.divide(squares, np.maximum([across, beside], 1)))))


def _of_waves(operator, shape):
    """Mean square of the gradient: of q^2 |h_q|^2, by Parseval's theorem."""
    grid = operator.grid

    def square(columns, rows):
        qx, qy = wave_numbers(grid, columns, rows)
        return qx[:, None] ** 2 + qy**2

    laplacian = PeriodicProduct(square, grid.shape, operator.layout(float))
    curvature = np.empty_like(shape)
    laplacian.apply(shape, curvature)
    total = sum_over(operator.comm, [np.einsum("ji,ji", shape, curvature)])[0]
    return max(total, 0.0) / grid.n


def _of_differences(operator, shape):
    """Mean squares of the differences across faces in x and in y, over the squares of the widths."""
    grid = operator.grid
    before = fetch_row_before(shape, bool(grid.periodic), operator.slabs, operator.comm, np.nan)
    in_x, faces_x, in_y, faces_y = sum_over(
        operator.comm, _squared_differences(shape, before, bool(grid.periodic))
    )
    if not faces_x + faces_y:
        return np.nan
    return in_x / max(faces_x, 1) / grid.dx**2 + in_y / max(faces_y, 1) / grid.dy**2


@njit_reassoc
def _squares_row(row, other):
    total, count = 0.0, 0
    for i in range(row.size):
        step = row[i] - other[i]
        known = step == step
        total += step * step if known else 0.0
        count += known
    return total, count


@njit()
def _squared_differences(shape, before, periodic):
    """Sum of squares of the differences across faces in x and their number, the same in y; NaN left out."""
    in_x, in_y = (0.0, 0), (0.0, 0)
    for j in range(shape.shape[0]):
        row = shape[j]
        in_x = add_tuples(in_x, _squares_row(row[1:], row[:-1]))
        if periodic:
            in_x = add_tuples(in_x, _squares_row(row[:1], row[-1:]))
        in_y = add_tuples(in_y, _squares_row(row, shape[j - 1] if j else before))
    return in_x + in_y
