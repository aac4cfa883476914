"""Discretisation errors, estimated from the last grids.

Let one grid be twice as fine as another. If a number converges with order k, its values on the two grids differ by 2^k
- 1 times the error on the finer grid. The order is that of the last two differences, between a lowest and a highest
order. The maximum pressure converges with order 2 where the pressure is smooth, and with lower orders while a peak is
not resolved. Loads and approaches converge like the energy, with orders 1 (sharp edges) to 2. The lowest order is taken
if two differences have different signs, and 1 if there is one difference.

Differences between coarse grids may be small by chance. Three other numbers show how much a grid resolves:

- The difference before the last one, extrapolated with `USUAL_ORDER`.
- The rms change of the pressure. It converges with order 1, because the pressure has an edge; a maximum that converges
  with order 2 has an error like its square. A change above `MAX_PRESSURE_CHANGE` means that the grid does not resolve
  the pressure, and that the maximum pressure is no better than the pressure.
- The share of the contact area that lies on the contact edge (`GridErrors.add_contact_edge`), which grows if few cells
  span the contact or its spots.

Areas are counted in cells, so they have a scatter and no order.

docs/load-paths.md says how often this holds. Coarser grids are solved to -lcp_coarse_rtol only, so smaller errors are
less certain.
"""

from typing import NamedTuple

import numpy as np

from app.base.quantities import ESTIMATED
from app.contact import loops
from app.parallel.reductions import sum_over, sums_and_minima

HIGHEST_ORDER, USUAL_ORDER = 2.0, 1.5
LOWEST_ORDER_OF_PRESSURE, LOWEST_ORDER_OF_LOAD = 0.6, 1.0
MAX_PRESSURE_CHANGE = 0.1  # relative rms change; above it the maximum pressure is no better than the pressure
SQUARE_FACTOR = 4.0  # error of the maximum pressure over the square of a smaller rms change
SCATTER_FACTOR = 2.0  # of the contact area: positions of the cell faces on its edge, for symmetric contacts
MIN_DIVERGENT_STEP = 0.08  # last relative difference of a maximum pressure that does not converge
MIN_DIVERGENT_RATIO = 0.8  # of such a difference to the one before
MAX_ERROR = 0.99  # of a number that converges; 1 means that it does not


class GridNumbers(NamedTuple):
    """Numbers of a solution on one grid."""

    load: float  # [N]
    depth: float  # approach from the reference of the undeformed distance [mm]
    max_pressure: float  # [N/mm2]
    contact_area: float  # area of cells with pressure [mm2]; captured cells without it may leave again


class GridErrors(NamedTuple):
    """Estimated relative errors due to the cell size; NaN if unknown."""

    load_error: float = float("nan")  # 0 for a prescribed load
    approach_error: float = float("nan")  # error of the approach beyond first touch; 0 if prescribed
    max_pressure_error: float = float("nan")  # 0 if prescribed
    contact_area_error: float = float("nan")

    def add_contact_edge(self, measured, pressure_change, problem):
        """Return these errors, increased by what the contact edge shows.

        The corrected contact area leaves out a share of the cells on the edge. This share is the mean error of the
        area. The scatter is added; it is larger if the edge is parallel to the cells, as in a line contact. Numbers
        that converge with order 2 have at least the square of this share as error. If the pressure is not resolved at
        the edge, load and approach have its error on that share. A maximum pressure that equals the largest hardness
        has no error.

        Parameters
        ----------
        measured : ContactMeasures
        pressure_change : float
            `pressure_difference` of the two finest grids; NaN if unknown.
        problem : Problem
        """
        if not measured.contact_fraction or np.isnan(self.contact_area_error):
            return self
        edge = max(1 - measured.contact_fraction_corrected / measured.contact_fraction, 0.0)
        least = edge**2, edge * _unresolved(pressure_change)
        load, approach = (error and max(error, *least) for error in self[:2])
        pressure = self.max_pressure_error and max(self.max_pressure_error, edge**2)
        is_limited = measured.plastic_area > 0 and measured.max_pressure == np.max(problem.hardness)
        pressure = 0.0 if is_limited else pressure
        is_line = problem.grid.one_way or min(problem.grid.shape) == 1
        scatter = SCATTER_FACTOR * (edge if is_line else np.sqrt(edge / measured.contact_cells))
        return GridErrors(load, approach, pressure, _limit(self.contact_area_error + edge + scatter))

    @property
    def largest(self) -> float:
        """The largest known error; NaN if none is known."""
        return self.largest_of(ESTIMATED)

    def largest_of(self, names):
        """Return the largest known error of some `ESTIMATED` quantities."""
        errors = (getattr(self, f"{name}_error") for name in names)
        return max((error for error in errors if error == error), default=float("nan"))


UNKNOWN = GridErrors()


def compute_grid_numbers(state, comm):
    """Return the `GridNumbers` of a `Pressed`.

    Collective over `comm`, which has all ranks that need the numbers.
    """
    grid = state.operator.grid
    total, highest, cells = loops.sum_pressure(state.p, state.in_contact())
    (total, cells), (lowest,) = sums_and_minima(comm, [total, cells], [-highest])
    load, area = grid.cell_area * float(total), grid.cell_area * float(cells)
    return GridNumbers(load, state.depth, -float(lowest), area)


def estimate_errors(grids, touching, exact, pressure_change=0.0):
    """Return the GridErrors of the finest grid, without those of the contact edge.

    Parameters
    ----------
    grids : sequence of GridNumbers
        Numbers from coarse to fine; each grid is twice as fine as the grid before. With fewer than two grids the errors
        are unknown.
    touching : float
        Depth of first touch on the finest grid [mm]. If `grids` have approaches instead of depths, the approach of
        first touch.
    exact : sequence of str
        Quantities that the loading fixes, see `Loading.exact`. They have no error.
    pressure_change : float
        `pressure_difference` of the two finest grids; NaN if unknown.
    """
    if len(grids) < 2:
        return UNKNOWN
    load, depth, pressure, area = map(np.array, zip(*grids[::-1], strict=True))
    errors = GridErrors(
        load_error=_error(load, LOWEST_ORDER_OF_LOAD),
        approach_error=_error(depth - touching, LOWEST_ORDER_OF_LOAD),
        max_pressure_error=_pressure_error(pressure, pressure_change),
        contact_area_error=_area_error(area),
    )
    return errors._replace(**{f"{name}_error": 0.0 for name in exact})


def _steps(values):
    """Return the differences of `values`, from fine to coarse, over the finest value."""
    return -np.diff(values) / values[0] if values[0] else np.full(len(values) - 1, np.nan)


def _error(values, lowest):
    """Return the relative error of the first value by the last differences.

    `values` has the value on each grid, from fine to coarse. The order of convergence is at least `lowest`.
    """
    steps = _steps(values)[:2]
    last, before = np.abs(steps[0]), np.abs(steps[-1])
    order = lowest if len(steps) == 2 else 1.0
    if len(steps) == 2 and steps[0] * steps[1] > 0:
        order = min(max(np.log2(before / last), lowest), HIGHEST_ORDER)
    error = last / (2**order - 1)
    if len(steps) == 2:
        error = max(error, before / 2**USUAL_ORDER / (2**USUAL_ORDER - 1))
    return _limit(error)


def _pressure_error(values, change):
    """Return the relative error of the maximum pressure; 1 if it does not converge.

    `change` is the rms change of the pressure.
    """
    last = _steps(values)[:3]
    grows = len(last) == 3 and (min(last) > 0 or max(last) < 0) and abs(last[0]) > MIN_DIVERGENT_STEP
    if grows and (last[:-1] / last[1:] > MIN_DIVERGENT_RATIO).all():
        return 1.0
    return _limit(max(_error(values, LOWEST_ORDER_OF_PRESSURE), _unresolved(change)))


def _unresolved(change):
    """Return the relative error of local pressures, given their rms change."""
    if not change > 0:
        return 0.0
    return change if change > MAX_PRESSURE_CHANGE else SQUARE_FACTOR * change**2


def _area_error(values):
    """Return the relative error of the contact area by its last differences."""
    return _limit(np.max(np.abs(_steps(values)[:2]) * (0.25, 0.125)[: len(values) - 1]))


def _limit(error):
    """Return a relative error, at most `MAX_ERROR`; NaN if unknown."""
    return float(min(error, MAX_ERROR)) if error == error else float("nan")


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
