"""Numbers of a solution and its surface: load, mean gap, perimeter, roughness.

A *face* lies between two neighbouring cells. In a direction in which the patch repeats, the first and the last cell are
neighbours. Outside a free patch nothing is in contact.
"""

from typing import NamedTuple

import numpy as np

from app.base.numba_cache import as_writable, njit
from app.contact import loops
from app.halfspace.periodic_symbol import wave_numbers
from app.halfspace.product import PeriodicProduct
from app.parallel.halo import fetch_row_before
from app.parallel.reductions import add_tuples, minimum_over, njit_reassoc, sum_over, sums_and_minima

# Share of a cell by which the contact area is too large for each face on the contact edge, on average over directions
# (Yastrebov, Anciaux, Molinari, Tribol. Int. 114 (2017) 161).
PER_FACE = (np.pi - 1 + np.log(2)) / 24
PLASTIC_NUMBERS = "plastic_area", "plastic_fraction", "plastic_volume", "mean_plastic_depth"


class ContactMeasures(NamedTuple):
    """Load, gap and area of a solution; the same on all ranks."""

    load: float  # [N]
    max_pressure: float  # [N/mm2]
    mean_pressure: float  # load over the area of the patch [N/mm2]
    mean_gap: float  # mean of max(e, 0), with e = h + u, over the admissible cells [mm]
    contact_cells: int
    contact_area: float  # [mm2]
    mean_contact_pressure: float  # load over the contact area [N/mm2]; 0 without contact
    perimeter: float  # length of the faces between contact and no contact [mm]
    contact_fraction: float  # contact cells over admissible cells
    contact_fraction_corrected: float  # the same minus `PER_FACE` of a cell for each face of the perimeter
    plastic_area: float  # area of the cells at the hardness [mm2]
    plastic_fraction: float  # these cells over admissible cells
    plastic_volume: float  # volume of the plastic indentation [mm3]
    mean_plastic_depth: float  # mean of max(-e, 0) over the admissible cells [mm]

    def add_indentation(self, before, state):
        """Return the measures with an earlier `Indentation` `before` added.

        `state` is the `Pressed` under the load.
        """
        if before.depth is None:
            return self
        volume = self.plastic_volume + state.grid.cell_area * before.total
        depth = self.mean_plastic_depth + before.total / state.distance.statistics.cells
        return self._replace(plastic_volume=volume, mean_plastic_depth=depth)


class Indentation(NamedTuple):
    """Permanent indentation by earlier loads."""

    depth: np.ndarray | None = None  # in the local rows [mm]
    total: float = 0.0  # sum over all cells [mm]
    approach: float = 0.0  # from the first touch of the bodies before to that of the indented ones [mm]

    def remove_from(self, distance):
        """Return the undeformed distance in local rows without the indentation [mm]."""
        return distance if self.depth is None else distance - self.depth


class ShapeRoughness(NamedTuple):
    """Roughness of the undeformed distance."""

    rms_height: float  # standard deviation of the height over the admissible cells [mm]
    rms_slope: float  # rms length of the gradient; NaN if no two admissible cells are neighbours
    steps_at_sides: tuple  # rms steps between cells across the sides, if periodic, and next to them [mm]


def measure_contact(state):
    """Return the ContactMeasures of a `Pressed`. Collective.

    For the corrected contact fraction, each face on the contact edge counts as the same share of a cell, whether the
    face is long or short.
    """
    grid, distance, slabs = state.grid, state.distance, state.operator.slabs
    total = state.total_gap()
    contact = state.in_contact()
    force, highest, _ = loops.sum_pressure(state.p, contact)
    # Includes cells without pressure, like the perimeter.
    cells = np.count_nonzero(contact)
    repeats_y, repeats_x = grid.repeats
    before = fetch_row_before(contact, repeats_y, slabs, state.comm, False)
    in_x, in_y = loops.count_faces(contact, before, repeats_x)
    if slabs.local and slabs.rows.stop == grid.ny and not repeats_y:
        in_y += np.count_nonzero(contact[-1])
    sums = total, cells, in_x, in_y, force, *_plastic_sums(state)
    sums, (lowest,) = sums_and_minima(state.comm, sums, [-highest])
    total, cells, in_x, in_y, force, plastic_cells, depths = sums
    load, area = grid.cell_area * float(force), cells * grid.cell_area
    admissible, mean, *_ = distance.statistics
    # The displacement of a periodic patch has no mean, which gives that of e without rounding.
    gap = mean - state.depth if distance.is_singular and admissible == grid.n else total / admissible
    plastic_depth = float(depths / admissible)
    if plastic_depth:
        gap = max(gap + plastic_depth, 0.0)  # rounding may leave less
    return ContactMeasures(
        load=load,
        max_pressure=-float(lowest),
        mean_pressure=load / grid.area,
        mean_gap=float(gap),
        contact_cells=int(cells),
        contact_area=float(area),
        mean_contact_pressure=float(load / area) if cells else 0.0,
        perimeter=float(in_x * grid.dy + in_y * grid.dx),
        contact_fraction=float(cells / admissible),
        contact_fraction_corrected=float((cells - PER_FACE * (in_x + in_y)) / admissible),
        plastic_area=float(plastic_cells) * grid.cell_area,
        plastic_fraction=float(plastic_cells / admissible),
        plastic_volume=float(depths) * grid.cell_area,
        mean_plastic_depth=plastic_depth,
    )


def _plastic_sums(state):
    """Return number and total depth of plastic cells [mm]."""
    if (plastic := state.bounds.plastic(state.p)) is None:
        return 0, 0.0
    return np.count_nonzero(plastic), state.total_overlap(plastic)


def contact_width(state, contact, enough):
    """Return the longest runs of contact cells in x and y. Collective.

    The unit is a cell. Runs longer than `enough` count as `enough`. `contact` are the ContactMeasures of `state`.
    """
    grid, slabs, (repeats_y, repeats_x) = state.grid, state.operator.slabs, state.grid.repeats
    excess = contact.contact_fraction - contact.contact_fraction_corrected
    # The mean run in a direction is at least twice the number of cells over that of all faces.
    if 2 * PER_FACE * contact.contact_fraction >= enough * excess:
        return enough, enough

    contact = state.in_contact()
    runs, buffer = np.zeros(contact.shape[1:], np.uint8), np.empty(grid.nx + enough, bool)
    passes = 1
    if state.comm or repeats_y:  # runs continue on this rank, from one or more ranks before
        first, end = slabs.bounds(state.comm.size if state.comm else 1)
        passes += -(-(enough - 1) // int((end - first)[end > first].min()))
    for k in range(passes):
        if k:
            last = np.zeros(contact.shape, np.uint8)
            last[-1:] = runs
            runs[...] = fetch_row_before(last, repeats_y, slabs, state.comm, 0)
        widths = loops.longest_runs(contact, repeats_x, enough, runs, buffer)
    in_x, in_y = np.negative(state.minimum(np.negative(widths))).astype(int).tolist()
    return min(in_x, grid.nx), min(in_y, grid.ny)


def measure_indentation(depth, shape, slabs, comm):
    """Return the `Indentation` of a shape. Collective.

    `depth` has all cells, or is None. `shape`, (local rows, nx), includes the indentation; it is NaN in inadmissible
    cells [mm].
    """
    if depth is None:
        return Indentation()
    local = depth[slabs.rows]
    lowest = [np.nanmin(values, initial=np.inf) for values in (shape, shape - local)]
    after, before = minimum_over(comm, lowest)
    return Indentation(local, float(depth.sum()), float(after - before))


def measure_roughness(operator, distance):
    """Return the ShapeRoughness of an undeformed distance. Collective.

    On a periodic patch without holes the slope is computed from the Fourier interpolant, which costs one product. On
    other patches the slope is computed from differences across the faces between admissible cells.
    """
    grid, whole = operator.grid, distance.statistics.cells == operator.grid.n
    shape = (
        distance.b if whole else np.where(distance.admissible, distance.b, np.nan)
    )  # the sign does not matter
    waves = grid.doubly_periodic and whole
    compute = _wave_slope if waves else _difference_slope
    square = compute(operator, shape)
    steps = _steps_at_sides(operator, shape) if grid.periodic else (0.0, 0.0)
    return ShapeRoughness(distance.deviation, float(np.sqrt(square)), steps)


def _steps_at_sides(operator, shape):
    """Return rms height steps across a patch's sides, and inside. Collective.

    A step is the height difference of neighbouring cells. If the patch repeats, the first number is for steps between
    its opposite sides. The second number, for comparison, is for the first steps inside these sides.
    """
    slabs, (ny, nx), (repeats_y, repeats_x) = operator.slabs, operator.grid.shape, operator.grid.repeats
    below = fetch_row_before(shape, True, slabs, operator.comm, np.nan)

    def steps(columns, faces):
        columns = columns if repeats_x else ()
        rows = [j - slabs.rows.start for j in faces if repeats_y and j in range(ny)[slabs.rows]]
        in_y = [shape[j] - (shape[j - 1] if j else below) for j in rows]
        return np.concatenate([np.zeros(0), *(shape[:, i] - shape[:, i - 1] for i in columns), *in_y])

    both = steps([0], [0]), steps({1, nx - 1} - {0, nx}, {1, ny - 1} - {0, ny})
    squares = [np.nansum(np.square(some)) for some in both]
    counts = [np.count_nonzero(np.isfinite(some)) for some in both]
    sums = sum_over(operator.comm, [*squares, *counts])
    return tuple(map(float, np.sqrt(np.divide(sums[:2], np.maximum(sums[2:], 1)))))


def _wave_slope(operator, shape):
    """Return the Fourier interpolant's mean square slope. Collective."""
    grid = operator.grid

    def square(columns, rows):
        qx, qy = wave_numbers(grid, columns, rows)
        return qx[:, None] ** 2 + qy**2

    laplacian = PeriodicProduct(square, grid.shape, operator.layout(float))
    curvature = np.empty_like(shape)
    laplacian.apply(shape, curvature)
    total = sum_over(operator.comm, [np.einsum("ji,ji", shape, curvature)])[0]
    return max(total, 0.0) / grid.n


def _difference_slope(operator, shape):
    """Return the mean square slope by face differences. Collective."""
    grid, (repeats_y, repeats_x) = operator.grid, operator.grid.repeats
    before = fetch_row_before(shape, repeats_y, operator.slabs, operator.comm, np.nan)
    fields = as_writable(shape), as_writable(before)
    in_x, faces_x, in_y, faces_y = sum_over(operator.comm, _squared_differences(*fields, repeats_x))
    if not faces_x + faces_y:
        return np.nan
    return in_x / max(faces_x, 1) / grid.dx**2 + in_y / max(faces_y, 1) / grid.dy**2


@njit_reassoc
def _squares_row(row, other):
    total, count = 0.0, 0
    for i in range(row.size):
        step = row[i] - other[i]
        is_number = step == step
        total += step * step if is_number else 0.0
        count += is_number
    return total, count


@njit()
def _squared_differences(shape, before, periodic):
    """Return sums of squared differences across faces, and numbers of faces.

    Return sum and number for faces in x, then for faces in y. Faces next to NaN are left out. `before` is the row
    before the first row.
    """
    in_x, in_y = (0.0, 0), (0.0, 0)
    for j in range(shape.shape[0]):
        row = shape[j]
        in_x = add_tuples(in_x, _squares_row(row[1:], row[:-1]))
        if periodic:
            in_x = add_tuples(in_x, _squares_row(row[:1], row[-1:]))
        in_y = add_tuples(in_y, _squares_row(row, shape[j - 1] if j else before))
    return in_x + in_y
