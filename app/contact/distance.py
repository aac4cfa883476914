"""The problem on one grid: the undeformed distance h, as shape and depth, and the bounds of the pressure."""

from __future__ import annotations

from fractions import Fraction
from math import sqrt, ulp
from typing import NamedTuple

import numpy as np

from app.contact import kernels
from app.contact.bounds import PressureBounds
from app.halfspace.operator import wrap_vec
from app.halfspace.window import local_bounds, window_from_bounds
from app.parallel.reductions import sum_over, sums_and_minima

_FEW = 4  # units in the last place


class Statistics(NamedTuple):
    """What ||h|| needs to know at any approach."""

    cells: int  # admissible
    mean: float  # of the undeformed distance at no depth over them [mm]
    squares_about_mean: float  # of its differences from the mean, summed [mm2]
    mean_rest: float  # what the mean loses by rounding [mm]


class UndeformedDistance:
    """h = shape - approach on all cells of one grid. Collective.

    Lengths are counted from a reference, so that distances with a large constant lose no digits: the approach is the
    reference and the *depth* beyond it. The shape never changes: to move the bodies is to set the depth, and no move
    costs digits. The right-hand side of (2.11) is ``-h = b + depth``.

    Parameters
    ----------
    operator : InfluenceOperator
        Of that grid.
    shape : ndarray, shape (local rows, nx), [mm]
        Undeformed distance at the reference; NaN in inadmissible cells. Left as it is.
    reference : float
        An approach, the same on all grids of a problem [mm].
    measured : bool
        Find norm, first touch and so on now; else `on_levels` does, for all levels at once.

    Attributes
    ----------
    b : ndarray, shape (local rows, nx), [mm]
        -h at no depth, to read; 0 in inadmissible cells.
    rhs : Vec
        The same.
    depth : float
        The approach beyond the reference [mm].
    neglected_gap : float
        Mean gap that is taken as zero, because it differs from full contact by rounding only [mm].
    touching : float or None
        Depth at which the first cells touch [mm]; None of a window: nobody knows.
    lowest : float
        The same, of a window that of the whole grid; before it no load is carried [mm].
    full_contact_pressures : (float, float)
        Least and largest mean pressure of full contact of a periodic patch; infinite until known [N/mm2].
    admissible : ndarray of bool, shape (local rows, nx)
    bounds : PressureBounds
    patch : Grid
        Whole grid, which the statistics are of.
    possible : Window or None
        Around all admissible cells.
    """

    neglected_gap = 0.0
    _norm = None  # at this depth, when somebody has asked

    def __init__(self, operator, shape, reference=0.0, measured=True):
        b = np.negative(shape, order="C")
        admissible = ~np.isnan(b)
        np.copyto(b, 0.0, where=~admissible)
        self._hold(b, operator, PressureBounds(admissible))
        self.depth, self.reference = 0.0, reference
        self.full_contact_pressures = -np.inf, np.inf
        self._slabs, self.patch = operator.slabs, operator.grid
        if measured:
            _measure([self], operator.comm)

    @classmethod
    def on_levels(cls, operators, shapes, reference, comm):
        """Return those of all levels of a hierarchy, in two reductions.

        Collective over `comm`, all ranks that want to know the norms; see the class.
        """
        levels = [cls(*of, reference, measured=False) for of in zip(operators, shapes, strict=True)]
        _measure(levels, comm)
        return levels

    @classmethod
    def part_of(cls, whole, operator, scatter):
        """Return the same h in a window of the grid, with the norm that it has on all of it. Collective."""
        part = cls.__new__(cls)
        part._hold(scatter.forward(whole.b), operator, whole.bounds.part(scatter.forward))
        part.patch, part.statistics = whole.patch, whole.statistics
        part.touching, part.lowest = None, whole.lowest
        part.depth, part.reference = whole.depth, whole.reference
        return part

    def _hold(self, b, operator, bounds):
        """Keep b in memory that stays when the Vec is gone: solutions refer to it."""
        self.bounds, self.admissible = bounds, bounds.admissible
        self.b = b.view()
        self.b.flags.writeable = False
        self.rhs = wrap_vec(b, operator)

    def h_at(self, depth):
        """Return h at a depth, shape (rows, nx) [mm]; NaN in inadmissible cells. Not collective."""
        return np.where(self.admissible, -(self.b + depth), np.nan)

    @property
    def approach(self):
        """delta [mm]. Not collective."""
        return self.approach_at(self.depth)

    def approach_at(self, depth):
        """Return the approach at a depth, 0 where the two parts cancel but for their rounding [mm]. Not collective."""
        approach = float(self.reference + depth)
        return approach if abs(approach) > _FEW * ulp(max(abs(self.reference), abs(depth))) else 0.0

    @property
    def deviation(self):
        """Standard deviation of h over the admissible cells [mm]. Not collective."""
        return float(np.sqrt(self.statistics.squares_about_mean / max(self.statistics.cells, 1)))

    @property
    def is_flat(self):
        """Whether it varies by no more than numbers of the size of the reference are rounded by. Not collective."""
        return self.deviation <= _FEW * ulp(self.reference)

    def move_to(self, depth, neglected_gap=0.0):
        """Change the depth. Not collective."""
        self.depth, self.neglected_gap, self._norm = float(depth), neglected_gap, None

    def norm(self):
        """||h||_2 over the admissible cells [mm], (5.1); 1 where it is zero, to be divided by. Not collective."""
        if self._norm is None:
            cells, mean, squares, _ = self.statistics
            self._norm = sqrt(squares + cells * (mean - self.depth) ** 2) or 1.0
        return self._norm

    def destroy(self):
        """Free the vector. Collective."""
        self.rhs.destroy()


def _measure(levels, comm):
    """Find what is to be known of some distances at no depth. Collective over `comm`."""
    size, rank = (comm.size, comm.rank) if comm else (1, 0)
    counts, parts = [np.count_nonzero(d.admissible) for d in levels], np.zeros((size, 2 * len(levels)))
    # Each rank adds zeros to the others' sums, so that none is rounded.
    parts[rank] = np.ravel([kernels.compensated_sum(d.b, d.admissible) for d in levels])
    lowest = [
        [*local_bounds(d.admissible, d._slabs), -d.b.max(initial=-np.inf, where=d.admissible)] for d in levels
    ]
    sums, lowest = sums_and_minima(comm, [*counts, *parts.ravel()], np.ravel(lowest))
    counts, parts = sums[: len(levels)], sums[len(levels) :].reshape(size, len(levels), 2)
    means = [_mean(part, cells) for part, cells in zip(np.moveaxis(-parts, 1, 0), counts, strict=True)]
    squares = [
        kernels.sum_squares(d.b, -mean, d.admissible) for d, (mean, _) in zip(levels, means, strict=True)
    ]
    found = zip(levels, counts, means, sum_over(comm, squares), lowest.reshape(-1, 5), strict=True)
    for distance, cells, (mean, rest), about_mean, (*box, touching) in found:
        distance.statistics = Statistics(int(cells), mean, float(about_mean), rest)
        distance.possible, distance.touching = window_from_bounds(box), float(touching)
        distance.lowest = distance.touching if np.isfinite(touching) else -np.inf


def _mean(parts, cells):
    """Mean of some cells from the parts of their sum, and what it loses by rounding. Not collective."""
    if not cells:
        return 0.0, 0.0
    exact = sum(map(Fraction, parts.ravel().tolist())) / int(cells)
    return float(exact), float(exact - Fraction(float(exact)))
