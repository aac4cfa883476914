"""Discretisation errors, estimated from the last grids.

Let one grid be twice as fine as another. If a number converges with order k, its values on the two grids differ by 2^k
- 1 times the error on the finer grid. An area counted in cells converges with order 1, with much scatter. Loads,
approaches and maximum pressures of smooth bodies, or of rough ones whose shortest waves are resolved, converge with
orders of 1.5 to 2. The error on the finest grid is taken as the largest of

- the last difference, and half the difference before it, because two grids may agree by chance. For the area, which
  scatters, also a quarter of the difference before that. If there are fewer grids, these are multiplied by 1.5;
- the sum of the geometric series that begins with the last two differences (three for the area), if they have one sign.
  The sum is at most ten times the last difference, also if the differences do not decrease, as for the maximum pressure
  at a sharp edge. For the area, differences below the scatter of cells on the edge of a round contact do not count.

docs/load-paths.md says how often this holds. Coarser grids are solved to -lcp_coarse_rtol only, so smaller errors are
less certain.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from app.base.quantities import ESTIMATED
from app.contact import kernels
from app.contact.measures import PER_FACE
from app.parallel.reductions import sum_over, sums_and_minima


class GridNumbers(NamedTuple):
    """Numbers of a solution on one grid."""

    load: float  # [N]
    depth: float  # approach from the reference of the undeformed distance [mm]
    max_pressure: float  # [N/mm2]
    contact_area: float  # area of cells with pressure [mm2]; captured cells without it may leave again
    cell_area: float = 0.0  # [mm2]


class GridErrors(NamedTuple):
    """Estimated relative errors due to the cell size; NaN if unknown."""

    load_error: float = float("nan")  # 0 for a prescribed load
    approach_error: float = float("nan")  # error of the approach beyond first touch; 0 if prescribed
    max_pressure_error: float = float("nan")
    contact_area_error: float = float("nan")

    def with_contact_edge(self, solution):
        """Return these errors; increase the error of the area if too small.

        The error of the area is at least the relative difference of ``contact_fraction`` and
        ``contact_fraction_corrected``. The areas of two grids may agree by chance, because numbers of cells scatter.
        """
        if not solution.contact_fraction or np.isnan(self.contact_area_error):
            return self
        edge = 1 - solution.contact_fraction_corrected / solution.contact_fraction
        return self._replace(contact_area_error=max(self.contact_area_error, edge))

    @property
    def largest(self):
        """The largest known error; NaN if none is known."""
        return self.largest_of(ESTIMATED)

    def largest_of(self, names):
        """Return the largest known error of some `ESTIMATED` quantities."""
        errors = (getattr(self, f"{name}_error") for name in names)
        return max((error for error in errors if error == error), default=float("nan"))


UNKNOWN = GridErrors()
_MAX_PAIRS = 3  # pairs of grids that are compared
_FEW_GRIDS_FACTOR = 1.5  # factor on the differences, if there are fewer grids
_MAX_RATIO = 10 / 11  # largest ratio of differences in a series, whose sum is ten times the last one then


def compute_grid_numbers(state, comm, load=None, depth=None):
    """Return the `GridNumbers` of a `ContactState`.

    Collective over `comm`, which has all ranks that need the numbers. `load` and `depth` replace the state's.
    """
    grid = state.operator.grid
    total, highest, cells = kernels.sum_pressure(state.p, state.in_contact())
    (total, cells), (lowest,) = sums_and_minima(comm, [total, cells], [-highest])
    load = grid.cell_area * float(total) if load is None else load
    depth = state.depth if depth is None else depth
    return GridNumbers(load, depth, -float(lowest), float(cells) * grid.cell_area, grid.cell_area)


def estimate_errors(grids, touching, prescribed):
    """Return the GridErrors of the finest grid.

    Parameters
    ----------
    grids : sequence of GridNumbers
        Numbers from coarse to fine; each grid is twice as fine as the grid before. With fewer than two grids the errors
        are unknown.
    touching : float
        Depth of first touch on the finest grid [mm]. If `grids` have approaches instead of depths, the approach of
        first touch.
    prescribed : str
        Name of the prescribed number in `LOADINGS`. With "mean_gap", load and approach both have errors.
    """
    if len(grids) < 2:
        return UNKNOWN
    fine_to_coarse = grids[: -_MAX_PAIRS - 2 : -1]
    load, depth, pressure, area, cell = zip(*fine_to_coarse, strict=True)
    edge = PER_FACE * 8 * np.sqrt(area[0] * cell[0] / np.pi)  # of a round contact, the shortest one
    return GridErrors(
        load_error=0.0 if prescribed in ("load", "mean_pressure") else _error(load, 2),
        approach_error=0.0 if prescribed == "approach" else _error([d - touching for d in depth], 2),
        max_pressure_error=_error(pressure, 2),
        contact_area_error=_error(area, _MAX_PAIRS, 2 * edge),
    )


def _error(values, pairs, scatter=0.0):
    """Return the estimated relative error of the first value, at most 1.

    `values` has the value on each grid, from fine to coarse. The values are extrapolated by the first `pairs`
    differences between neighbouring grids, unless the finest two differ by at most `scatter`.
    """
    if not values[0]:
        return float("nan")
    steps = [coarse - fine for fine, coarse in pairwise(values)]
    sizes = [abs(step) for step in steps]
    doubt = 1.0 if len(sizes) >= pairs else _FEW_GRIDS_FACTOR
    error = doubt * max(size * 0.5**k for k, size in enumerate(sizes[:pairs]))
    if len(sizes) >= pairs and sizes[0] > scatter and (min(steps) > 0 or max(steps) < 0):
        ratio = min((sizes[0] / sizes[-1]) ** (1 / (len(sizes) - 1)), _MAX_RATIO)
        error = max(error, ratio / (1 - ratio) * sizes[0])
    return min(1.0, error / abs(values[0]))


def pressure_difference(comm, transfer, coarse, state):
    """Return the relative pressure difference between two grids. Collective.

    `coarse` is the pressure on the coarser grid. The pressure of `state` is restricted to this grid. The norm of the
    difference is divided by the larger of both norms. NaN if the pressures are equal.
    """
    fine = transfer.restrict_defect(state.p)
    squares = [np.vdot(p, p) for p in (fine, coarse)]
    fine -= coarse
    *squares, difference = sum_over(comm, [*squares, np.vdot(fine, fine)])
    return float(np.sqrt(difference / max(squares))) if difference > 0 else float("nan")
