"""Estimate the discretisation errors of the numbers of a solution from its last grids.

A number that converges with order k differs on two grids, one twice as fine as the other, by 2^k - 1 times the error of
the finer one. An area counted in cells converges with order 1 and much scatter; loads, approaches and maximum pressures
of smooth bodies, or of rough ones whose shortest waves are resolved, with orders of 1.5 to 2. So the error on the
finest grid is taken to be the largest of

- the difference from the grid before, and half the difference of that from the one before it: two grids may agree by
  chance. Of the area, which scatters, a quarter of the next difference counts, too. Half as much again, where there are
  not so many grids;
- the sum of the geometric series that the last two or three differences begin, where they have one sign. It is at most
  ten times the last difference, as where the differences do not fall: the maximum pressure at a sharp edge does not
  converge, and at a rounded one it does only when cells are smaller than the rounding. From 10% on that is all of the
  number. But an area may differ as the cells on the rim of a round one scatter.

docs/load-paths.md has how often this holds. Coarser grids are solved to -lcp_coarse_rtol only: what is below that is
less certain.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from app.contact import kernels
from app.contact.measures import PER_FACE
from app.parallel.reductions import sum_over, sums_and_minima


class GridNumbers(NamedTuple):
    """Of a solution on one grid; the same on all ranks that took part."""

    load: float  # [N]
    depth: float  # approach from the reference of the undeformed distance [mm]
    max_pressure: float  # [N/mm2]
    contact_area: float  # of cells under pressure: of those just captured, most may leave again [mm2]
    cell_area: float = 0.0  # [mm2]


class GridErrors(NamedTuple):
    """Estimated relative errors of the numbers on the finer grid; NaN where nothing is known."""

    load_error: float = float("nan")  # of a prescribed load: 0
    approach_error: float = float("nan")  # of the approach beyond first touch; of a prescribed one: 0
    max_pressure_error: float = float("nan")
    contact_area_error: float = float("nan")

    def with_contact_edge(self, solution):
        """Let the area be no more certain than the cells on its rim are: see ``contact_fraction_corrected``.

        Not collective. Counts of cells scatter: on two grids they may agree by chance.
        """
        if not solution.contact_fraction or np.isnan(self.contact_area_error):
            return self
        rim = 1 - solution.contact_fraction_corrected / solution.contact_fraction
        return self._replace(contact_area_error=max(self.contact_area_error, rim))

    @property
    def largest(self):
        """The largest of them that is known; NaN if none is. Not collective."""
        known = [error for error in self if error == error]
        return max(known, default=float("nan"))


UNKNOWN = GridErrors()
_MOST_PAIRS = 3  # of grids that are looked at
_FEWER_PAIRS = 1.5  # times the differences, where there are not so many grids as should tell
_SLOWEST = (
    10 / 11
)  # largest ratio of neighbouring differences in a series; it adds up to ten times the last one


def compute_grid_numbers(state, comm, load=None, depth=None):
    """Numbers of a ContactState; with a better load and depth, if known.

    Collective over `comm`, all ranks that want to know.
    """
    grid = state.operator.grid
    total, highest, cells = kernels.sum_pressure(state.p, state.contact)
    (total, cells), (lowest,) = sums_and_minima(comm, [total, cells], [-highest])
    load = grid.cell_area * float(total) if load is None else load
    depth = state.depth if depth is None else depth
    return GridNumbers(load, depth, -float(lowest), float(cells) * grid.cell_area, grid.cell_area)


def estimate_errors(grids, touching, prescribed):
    """Estimate the errors of the finest grid.

    Not collective.

    Parameters
    ----------
    grids : sequence of GridNumbers
        From coarse to fine, each twice as fine as the one before; of fewer than two nothing is known.
    touching : float
        Depth of first touch on the finest; or its approach, if those are what the grids have [mm].
    prescribed : str
        Of `LOADINGS`; by "mean_gap" neither load nor approach is known.

    Returns
    -------
    GridErrors
    """
    if len(grids) < 2:
        return UNKNOWN
    load, depth, pressure, area, cell = zip(
        *grids[: -_MOST_PAIRS - 2 : -1], strict=True
    )  # from fine to coarse
    rim = PER_FACE * 8 * np.sqrt(area[0] * cell[0] / np.pi)  # of a round contact, which has the shortest
    return GridErrors(
        load_error=0.0 if prescribed in ("load", "mean_pressure") else _error(load, 2),
        approach_error=0.0 if prescribed == "approach" else _error([d - touching for d in depth], 2),
        max_pressure_error=_error(pressure, 2),
        contact_area_error=_error(area, _MOST_PAIRS, 2 * rim),
    )


def _error(values, pairs, scatter=0.0):
    """Relative error of the first of some values, on grids from fine to coarse; on the second they may scatter.

    1, all of it, is the most that is said.
    """
    if not values[0]:
        return float("nan")
    steps = [coarse - fine for fine, coarse in pairwise(values)]
    sizes = [abs(step) for step in steps]
    doubt = 1.0 if len(sizes) >= pairs else _FEWER_PAIRS
    error = doubt * max(size * 0.5**k for k, size in enumerate(sizes[:pairs]))
    if len(sizes) >= pairs and sizes[0] > scatter and (min(steps) > 0 or max(steps) < 0):
        ratio = min((sizes[0] / sizes[-1]) ** (1 / (len(sizes) - 1)), _SLOWEST)
        error = max(error, ratio / (1 - ratio) * sizes[0])
    return min(1.0, error / abs(values[0]))


def pressure_difference(comm, transfer, coarse, state):
    """Return the rms difference of the pressures on two grids over that of the larger; NaN if none. Collective."""
    fine = transfer.restrict_defect(state.p)
    squares = [np.vdot(p, p) for p in (fine, coarse)]
    fine -= coarse
    *squares, difference = sum_over(comm, [*squares, np.vdot(fine, fine)])
    return float(np.sqrt(difference / max(squares))) if difference > 0 else float("nan")
