"""The undeformed distance h = shape - approach on one grid."""

from fractions import Fraction
from math import sqrt, ulp
from typing import NamedTuple

import numpy as np

from app.contact import loops
from app.contact.bounds import PressureBounds
from app.contact.tilt import NO_TILT
from app.halfspace.operator import wrap_vec
from app.halfspace.window import local_bounds, window_from_bounds
from app.parallel.reductions import sum_over, sums_and_minima

_ROUNDING_ULPS = 4  # rounding error of an approach, in units in the last place
_MEAN_GAP_ROUNDING = 1e-15  # least mean gap below full contact, over the mean distance
_MIN_SEARCHED_GAP = 1e-10  # least mean gap in the search for a load, over the mean distance


class Statistics(NamedTuple):
    """Sums over h, from which its norm at any approach follows."""

    cells: int  # number of admissible cells
    mean: float  # mean undeformed distance of these cells at depth 0 [mm]
    squares_about_mean: float  # sum of squared differences from the mean [mm2]
    mean_rest: float  # rounding error of the mean [mm]


class UndeformedDistance:
    """The undeformed distance h = shape - approach on one grid. Collective.

    The approach is a reference plus the *depth*, the approach beyond the reference. So large constants cost no digits.
    The depth belongs to the `ContactState`. To move the bodies, only the depth is changed, never the stored shape, so
    that no rounding errors add up. A tilt computes `b` from the stored shape again. On C the right-hand side is
    ``-h = b + depth``.

    Parameters
    ----------
    operator : InfluenceOperator
        Influence operator of that grid.
    shape : ndarray, shape (local rows, nx), [mm]
        Undeformed distance at the reference; NaN in inadmissible cells.
    reference : float
        Approach from which depths are counted, the same on all grids of a problem [mm].
    hardness : ndarray, shape (local rows, nx), [N/mm2], optional
        Largest possible pressure.
    measured : bool
        True to compute the statistics now, and to leave the array `shape` as it is. If false, `on_levels` computes the
        statistics for all levels at once, and `b` takes the place of the shape.

    Attributes
    ----------
    b : ndarray, shape (local rows, nx), [mm]
        -h at depth 0 and the present tilt, read-only; 0 in inadmissible cells.
    rhs : Vec
        The field `b` as a Vec.
    tilt : Tilt
        Present tilt of the bodies; the depth is that at its pivot.
    touching : float or None
        Depth at which the first cells touch [mm]; None in a window, or if the tilt changed in the iteration.
    full_depth : float
        Largest depth below full contact [mm]; infinite unless the patch is periodic without holes.
    max_depth : float
        Largest allowed depth [mm]: `full_depth`, or infinite if some pressures have an upper bound.
    plastic_depth : float
        Depth from which all cells are at the hardness [mm]. Known on periodic patches without holes with one hardness
        for all cells, whose displacement is then zero; else infinite.
    zero_load_depth : float
        Depth of first touch, below which there is no load [mm]. Also known in a window.
    full_contact_pressures : (float, float)
        Least and largest mean pressure of full contact on a periodic patch [N/mm2]; infinite until known.
    admissible : ndarray of bool, shape (local rows, nx)
        True in cells that may be in contact.
    bounds : PressureBounds
    is_singular : bool
        `InfluenceOperator.is_singular` of the grid.
    cells : (Grid, slice)
        Grid or window, and its rows on this rank.
    patch : Grid
        Whole grid, even if the distance is given in a window. The statistics are for the whole grid.
    possible : Window or None
        Window around all admissible cells; None if there are none.
    """

    max_depth = full_depth = plastic_depth = np.inf
    tilt, _untilted = NO_TILT, None  # `b` without tilt, once `tilt_levels` is called

    def __init__(self, operator, shape, reference=0.0, hardness=None, measured=True):
        b, admissible = np.empty(shape.shape) if measured else shape, np.empty(shape.shape, bool)
        loops.right_hand_side(shape, b, admissible)
        self._set(b, operator, PressureBounds(admissible, hardness))
        self.reference = reference
        self.full_contact_pressures = -np.inf, np.inf
        self._slabs, self.patch, self.is_singular = operator.slabs, operator.grid, operator.is_singular
        if measured:
            _measure([self], operator.comm)

    @classmethod
    def on_levels(cls, operators, shapes, reference, comm, hardness=None):
        """Make the distances of all levels of a hierarchy, with two reductions.

        Collective over `comm`, which has all ranks that need the statistics. `operators`, `shapes` and `hardness` have
        one item for each level. The arrays `shapes` are used for `b`.
        """
        given = zip(operators, shapes, [None] * len(shapes) if hardness is None else hardness, strict=True)
        levels = [cls(level, shape, reference, upper, measured=False) for level, shape, upper in given]
        _measure(levels, comm)
        return levels

    @classmethod
    def part_of(cls, whole, operator, scatter):
        """Return a window's distance with the grid's statistics, by a `Scatter`. Collective."""
        part = cls.__new__(cls)
        part._set(scatter.forward(whole.b), operator, whole.bounds.part(scatter.forward))
        part.patch, part.statistics, part.is_singular = whole.patch, whole.statistics, whole.is_singular
        part.tilt = whole.tilt
        if whole._untilted is not None:
            part._untilted = scatter.forward(whole._untilted)
        part.touching, part.zero_load_depth = None, whole.zero_load_depth
        part.reference = whole.reference
        return part

    def _set(self, b, operator, bounds):
        self.bounds, self.admissible = bounds, bounds.admissible
        self._values, self.cells = b, (operator.grid, operator.slabs.rows)
        self.b = b.view()  # outlives the Vec: solutions refer to it
        self.b.flags.writeable = False
        self.rhs = wrap_vec(b, operator)

    def h_at(self, depth, tilt=NO_TILT):
        """Return the undeformed distance at a depth and a tilt [mm]; NaN in inadmissible cells."""
        b = self.b if self._untilted is None else self._untilted + self.rise(tilt)
        h = b + depth
        np.negative(h, out=h)
        np.copyto(h, np.nan, where=~self.admissible)
        return h

    def rise(self, tilt=None):
        """Return what a tilt, by default the present one, adds to the depth of the local cells [mm]."""
        grid, rows = self.cells
        return (tilt or self.tilt).rise(grid.x(), grid.y(rows)[:, None])

    def tilt_to(self, tilt):
        """Turn the bodies to a `Tilt`; `tilt_levels` must have prepared the distance, unless nothing changes."""
        if tilt == self.tilt:
            return
        np.add(self._untilted, self.rise(tilt), out=self._values, where=self.admissible)
        self.rhs.stateIncrease()
        self.tilt, self.touching = tilt, None

    def approach_at(self, depth):
        """Return the approach at a depth [mm]; 0 if below rounding error."""
        approach = float(self.reference + depth + self.tilt.rise(0.0, 0.0))
        rounding = _ROUNDING_ULPS * ulp(max(abs(self.reference), abs(depth)))
        return approach if abs(approach) > rounding else 0.0

    def depth_rounding(self, depth):
        """Return the rounding error of a depth, as an approach minus the reference [mm].

        Shapes of this size have the same error. It is 0 if such differences are exact, by Sterbenz' lemma.
        """
        is_exact = not self.reference or 2 * abs(depth) <= abs(self.reference)
        return 0.0 if is_exact else ulp(depth)

    @property
    def max_searched_depth(self):
        """Largest depth [mm] tried when searching for a load."""
        depth = self.max_depth
        return depth - _MIN_SEARCHED_GAP * abs(depth) if depth < np.inf else depth

    @property
    def deviation(self):
        """Standard deviation of undeformed distance over admissible cells [mm]."""
        return float(np.sqrt(self.statistics.squares_about_mean / max(self.statistics.cells, 1)))

    def is_beyond_full_contact(self, depth):
        """Return whether cells must overlap at a depth, which a hardness allows."""
        return self.full_depth < depth <= self.max_depth

    @property
    def is_flat(self):
        """True if h is constant up to rounding."""
        return self.deviation <= _ROUNDING_ULPS * ulp(self.reference)

    def norm(self, depth):
        """Return ||h||_2 over admissible cells at a depth [mm]; 1 if zero.

        The slopes are those that the last call of `tilt_levels` prescribed.
        """
        cells, mean, squares, _ = self.statistics
        return sqrt(squares + cells * (mean - depth) ** 2) or 1.0

    def _local_minima(self):
        """Return the numbers of this rank whose minima over the ranks `_measure` uses."""
        b, box = self.b, local_bounds(self.admissible, self._slabs)
        touching = -b.max(initial=-np.inf, where=self.admissible)
        if not self.bounds.capped:
            return touching, 0.0, 0.0, 0.0, *box
        upper = self.bounds.upper
        return touching, b.min(initial=np.inf), upper.min(initial=np.inf), -upper.max(initial=0.0), *box

    def destroy(self):
        """Free the vector `rhs`. Collective."""
        self.rhs.destroy()


def tilt_levels(levels, tilt, comm):
    """Turn the bodies on all levels to a `Tilt`, and measure the distances again.

    Collective over `comm`, which has all ranks. Afterwards `UndeformedDistance.tilt_to` can turn them further. If the
    tilt is None, the bodies are not turned.
    """
    if levels[0]._untilted is None:
        if tilt is None:
            return
        for distance in levels:
            distance._untilted = distance.b.copy()
    for distance in levels:
        distance.tilt_to(tilt or NO_TILT)
    _measure(levels, comm)


def _measure(levels, comm):
    """Compute statistics and first touch of each `UndeformedDistance`. Collective."""
    size, rank = (comm.size, comm.rank) if comm else (1, 0)
    counts, parts = [np.count_nonzero(d.admissible) for d in levels], np.zeros((size, 2 * len(levels)))
    # Each rank adds zeros to the others' sums, so that none is rounded.
    parts[rank] = np.ravel([loops.compensated_sum(d.b, d.admissible) for d in levels])
    minima = [d._local_minima() for d in levels]
    sums, minima = sums_and_minima(comm, [*counts, *parts.ravel()], np.ravel(minima))
    counts, parts = sums[: len(levels)], sums[len(levels) :].reshape(size, len(levels), 2)
    means = [_mean(part, cells) for part, cells in zip(np.moveaxis(-parts, 1, 0), counts, strict=True)]
    pairs = zip(levels, means, strict=True)
    squares = [loops.sum_squares(d.b, -mean, d.admissible) for d, (mean, _) in pairs]
    carried = [d.bounds.carried for d in levels]
    limited = [d.bounds.limited_cells for d in levels]
    squares, carried, limited = np.split(np.asarray(sum_over(comm, squares + carried + limited)), 3)
    rows = zip(levels, counts, means, squares, carried, limited, minima.reshape(-1, 8), strict=True)
    for distance, cells, (mean, rest), about_mean, upper, finite, minimum in rows:
        touching, lowest_b, softest, minus_hardest, *box = minimum
        distance.bounds.largest_load = float(upper) * distance.patch.cell_area
        distance.statistics = Statistics(int(cells), mean, float(about_mean), rest)
        distance.possible, distance.touching = window_from_bounds(box), float(touching)
        distance.zero_load_depth = distance.touching if np.isfinite(touching) else -np.inf
        if distance.is_singular and cells == distance.patch.n:
            distance.full_depth = mean - _MEAN_GAP_ROUNDING * abs(mean)
            distance.max_depth = np.inf if finite else distance.full_depth  # plastic cells may overlap
            if finite and softest == -minus_hardest:
                distance.plastic_depth = float(-lowest_b)


def _mean(parts, cells):
    """Return the mean and rounding error, from partial sums."""
    if not cells:
        return 0.0, 0.0
    exact = sum(map(Fraction, parts.ravel().tolist())) / int(cells)
    return float(exact), float(exact - Fraction(float(exact)))
