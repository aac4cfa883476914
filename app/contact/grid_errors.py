"""How far the numbers of a solution are off because cells have a size, from its last two grids.

A number that converges with order k differs on two grids, one twice as fine as the other, by 2^k - 1 times the error of
the finer one. An area counted in cells converges with order 1 and much scatter; loads, approaches and maximum pressures
of smooth bodies, or of rough ones whose shortest waves are resolved, with orders of 1.5 to 2. The difference itself is
taken for the error: rather too much. Measured on Hertz's contact and on self-affine surfaces it is 1 to 20 times the
error, seldom less. The coarser grid was solved to -lcp_coarse_rtol only: what is below that is less certain.
A maximum pressure that is singular, at the rim of a punch, is found not to converge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.halfspace.reductions import minimum_over, sum_over


class GridNumbers(NamedTuple):
    """Of a solution on one grid; the same on all ranks that took part."""

    load: float  # [N]
    depth: float  # approach from the reference of the undeformed distance [mm]
    max_pressure: float  # [N/mm2]
    contact_area: float  # [mm2]


class GridErrors(NamedTuple):
    """Estimated relative errors of the numbers on the finer grid; NaN where nothing is known."""

    load_error: float = float("nan")  # of a prescribed load: 0
    approach_error: float = float("nan")  # of the approach beyond first touch; of a prescribed one: 0
    max_pressure_error: float = float("nan")
    contact_area_error: float = float("nan")

    def with_rim(self, solution):
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


def numbers_on(state, comm, load=None, depth=None):
    """Numbers of a ContactState, or CoarseSolution; with a better load and depth, if known.

    Collective over `comm`, all ranks that want to know.
    """
    grid = state.operator.grid
    total, cells = sum_over(comm, [state.p.sum(), np.count_nonzero(state.contact)])
    highest = -minimum_over(comm, [-state.p.max(initial=0.0)])[0]
    load = grid.cell_area * float(total) if load is None else load
    return GridNumbers(
        load, state.depth if depth is None else depth, float(highest), float(cells) * grid.cell_area
    )


def errors_from(coarse, fine, touching, prescribes_load):
    """Estimate the errors of the finer grid.

    Not collective.

    Parameters
    ----------
    coarse, fine : GridNumbers
    touching : float
        Depth of first touch [mm].
    prescribes_load : bool

    Returns
    -------
    GridErrors
    """

    def error(one, other):
        return abs(one - other) / abs(other) if other else float("nan")

    depth = error(coarse.depth - touching, fine.depth - touching)
    return GridErrors(
        load_error=0.0 if prescribes_load else error(coarse.load, fine.load),
        approach_error=depth if prescribes_load else 0.0,
        max_pressure_error=error(coarse.max_pressure, fine.max_pressure),
        contact_area_error=error(coarse.contact_area, fine.contact_area),
    )
