"""The undeformed distance h of one grid, as the right-hand side -h of (2.11), and what is to be known of it."""

from __future__ import annotations

from math import sqrt, ulp
from typing import NamedTuple

import numpy as np

from app.contact import kernels
from app.halfspace.operator import vec_of
from app.halfspace.reductions import sum_over, sums_and_minima
from app.halfspace.window import box_here, box_of

_FEW = 4  # units in the last place


class Statistics(NamedTuple):
    """What ||h|| needs to know at any approach."""

    cells: int  # admissible
    mean: float  # of the undeformed distance at no depth over them [mm]
    squares_about_mean: float  # of its differences from the mean, summed [mm2]


class UndeformedDistance:
    """h = shape - approach on all cells of one grid, kept as the right-hand side -h of (2.11). Collective.

    Lengths are counted from a reference, so that distances with a large constant lose no digits: the approach is the
    reference and the *depth* beyond it.

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
    rhs : Vec
        -h; anything in inadmissible cells.
    b : ndarray, shape (local rows, nx), [mm]
        The same, to read.
    touching : float or None
        Depth at which the first cells touch [mm]; None of a window: nobody knows.
    lowest : float
        The same, of a window that of the whole grid; before it no load is carried [mm].
    least_mean_pressure : float
        That full contact of a periodic patch needs [N/mm2]; -inf as long as nobody knows.
    admissible : ndarray of bool, shape (local rows, nx)
    possible : Window or None
        Around all admissible cells.
    """

    _norm = None  # at this depth, when somebody has asked

    def __init__(self, operator, shape, reference=0.0, measured=True):
        b = np.negative(shape, order="C")
        self.admissible = ~np.isnan(b)
        np.copyto(b, 0.0, where=~self.admissible)
        self._hold(b, operator)
        self.depth, self.deepest, self.reference = 0.0, 0.0, reference
        self.least_mean_pressure = -np.inf
        self._slabs = operator.slabs
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
        part.admissible, b = scatter.forward(whole.admissible), scatter.forward(whole.b)
        part._hold(b, operator)
        part.statistics, part.touching, part.lowest = whole.statistics, None, whole.lowest
        part.depth, part.deepest, part.reference = whole.depth, 0.0, whole.reference
        return part

    def _hold(self, b, operator):
        """Keep -h in memory that stays when the Vec is gone: solutions refer to it."""
        self.b = b.view()
        self.b.flags.writeable = False
        self.rhs = vec_of(b, operator)

    def h_at(self, depth):
        """Return h at a depth, shape (rows, nx) [mm]; NaN in inadmissible cells. Not collective."""
        return np.where(self.admissible, (self.depth - depth) - self.b, np.nan)

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

    def move_to(self, depth):
        """Change the depth. Not collective."""
        if depth != self.depth:
            with self.rhs as values:
                values += depth - self.depth
            self.depth, self.deepest, self._norm = float(depth), max(self.deepest, abs(depth)), None

    def reach(self, loading, operator):
        """Depth of a loading, or the most that a load may come to: where a single cell bears all of it [mm].

        Collective when first asked for on a periodic grid.
        """
        if loading.prescribes_load:
            return operator.diagonal * loading.load / operator.grid.cell_area
        return loading.depth_on(self)

    def digits_lost(self, depth=np.inf):
        """Whether approaches far beyond the shape, or a depth, have cost it digits. Not collective."""
        shape = self.deviation or np.inf  # a flat one has none to lose
        return self.deepest > 1e3 * min(shape, abs(depth))

    @property
    def rounding(self):
        """What approaches far beyond the shape may have left in a cell [mm]; else nothing. Not collective."""
        return ulp(self.deepest) if self.digits_lost() or not self.deviation else 0.0

    @staticmethod
    def kept(distances):
        """Return a function that takes distances back to what they are now, at depth 0. Not collective."""
        fields = [distance.b.copy() for distance in distances]

        def take_back():
            for distance, b in zip(distances, fields, strict=True):
                with distance.rhs as values:
                    values[...] = b.reshape(-1)
                distance.depth, distance.deepest, distance._norm = 0.0, 0.0, None

        return take_back

    def norm(self):
        """||h||_2 over the admissible cells [mm], (5.1); 1 where it is zero, to be divided by. Not collective."""
        if self._norm is None:
            cells, mean, squares = self.statistics
            self._norm = sqrt(squares + cells * (mean - self.depth) ** 2) or 1.0
        return self._norm

    def destroy(self):
        """Free the vector. Collective."""
        self.rhs.destroy()


def _measure(levels, comm):
    """Find what is to be known of some distances at no depth. Collective over `comm`."""
    sums = [[np.count_nonzero(d.admissible), -np.sum(d.b, where=d.admissible)] for d in levels]
    lowest = [
        [*box_here(d.admissible, d._slabs), -d.b.max(initial=-np.inf, where=d.admissible)] for d in levels
    ]
    sums, lowest = sums_and_minima(comm, np.ravel(sums), np.ravel(lowest))
    means = [float(total / cells) if cells else 0.0 for cells, total in sums.reshape(-1, 2)]
    squares = [kernels.sum_squares(d.b, -mean, d.admissible) for d, mean in zip(levels, means, strict=True)]
    found = zip(levels, sums[::2], means, sum_over(comm, squares), lowest.reshape(-1, 5), strict=True)
    for distance, cells, mean, about_mean, (*box, touching) in found:
        distance.statistics = Statistics(int(cells), mean, float(about_mean))
        distance.possible, distance.touching = box_of(box), float(touching)
        distance.lowest = distance.touching if np.isfinite(touching) else -np.inf
