"""Windows: rectangles around the coarser grid's contact area.

A grid is solved in a window; outside the window the pressure is zero. The verification product on all cells of the
target grid shows whether the bodies penetrate outside the window. If they do, the iteration continues on all cells,
which is expensive. Therefore each window also contains predicted contact: cells in which asperities may touch that are
too small for the finest grid solved without a window. They are found from the distance on the target grid
(`Hierarchy.coarse_minimum`).

The option ``-lcp_window`` is the margin on each side, divided by the extent of contact (0: no windows). For the gain
see `app.methods.free`.
"""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.fft import next_fast_len

from app.contact.distance import UndeformedDistance
from app.contact.state import ContactState, Displacement
from app.halfspace.operator import InfluenceOperator
from app.halfspace.window import Scatter, Window, bounding_boxes, whole_window
from app.methods.free.verification_product import VerificationProduct
from app.multigrid.transfer import Transfer

MIN_MARGIN = 4  # smallest margin around contact, in cells of the coarser grid
SIZE_STEP = 16  # sizes of small windows are multiples of this number of cells, and at least two steps
MIN_WHOLE_PERIOD = 0.8  # share of a period from which a window with the whole period is faster
MAX_WINDOW_FRACTION = (
    0.85  # largest share of the cells: a larger window costs more for its spectra than it saves
)


class CoarseSolution(NamedTuple):
    """Solution of the coarser grid, restricted to the cells around the window."""

    operator: InfluenceOperator
    u: np.ndarray
    p: np.ndarray
    contact: np.ndarray


class WindowState(ContactState):
    """Contact state of a window.

    `scaled` is the factor by which p and u were multiplied since the last product in double precision.
    """

    scaled = 1.0

    def compute_displacement(self, exact=False):
        """Compute the displacement u = A p. Collective.

        An `exact` product sets `scaled` to 1; see `ContactState.compute_displacement`.
        """
        super().compute_displacement(exact)
        self.scaled = 1.0 if self.displacement_status is Displacement.EXACT else self.scaled

    def scale(self, factor):
        """Multiply p and u by a factor, and record it in `scaled`."""
        super().scale(factor)
        self.scaled *= factor

    def destroy(self):
        """Free the state and its undeformed distance."""
        super().destroy()
        if self.distance is not None:
            self.distance.destroy()


class Boxes(NamedTuple):
    """Rectangles that the next window must contain, in cells."""

    outer: Window  # the window of this grid
    contact: Window | None  # bounding box of contact, in cells from the corner of `outer`; None: no contact
    predicted: Window | None  # bounding box of contact of small asperities of the target grid, see the module


class WindowedLevel:
    """Level of a nested iteration, in a window if possible. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    cache : WindowCache
    number : int
        Number of the level.
    distance : UndeformedDistance
        Undeformed distance on all cells of the level.
    coarse : ContactState or None
        Solution of the coarser grid. Without it (None) there is no window.
    boxes : Boxes or None
        Result of `boxes_for_next` of the coarser level.

    Attributes
    ----------
    state : ContactState
        State of the window, or of all cells.
    coarse : ContactState or CoarseSolution
        Coarse solution on the cells of `state`. Set it to None when its arrays may be freed.
    transfer : Transfer
        Transfer between the grids of `coarse` and `state`.
    windowed : bool
        True if `state` covers only a window.
    verification : VerificationProduct or None
        Product on all cells, for a window of the target grid.
    """

    def __init__(self, hierarchy, cache, number, distance, coarse, boxes=None):
        self._hierarchy, self._cache, self._number, self._distance = hierarchy, cache, number, distance
        self._predicted = boxes and boxes.predicted
        self.coarse, self.transfer = coarse, hierarchy.transfers[number]
        self._level = level = hierarchy.levels[number]
        self.verification, self._window, coarse_window = None, whole_window(level.grid), None
        if coarse is not None and hierarchy.may_be_windowed(level):
            possible = distance.possible.coarsen(self.transfer.factors)
            coarse_window = _choose_window(boxes, coarse.distance.patch, hierarchy.margin, possible)
        self.windowed = coarse_window is not None
        if self.windowed:
            self._make_window(coarse_window, boxes.outer)
        else:
            self.state = ContactState(level, distance)

    @PETSc.Log.EventDecorator("ContactWindow")
    def _make_window(self, coarse_window, outer):
        """Make the operators, transfer and state of a window."""
        hierarchy, level = self._hierarchy, self._level
        coarse, factors, comm = self.coarse, self.transfer.factors, hierarchy.comm
        self._window = window = coarse_window.refine(factors, level.grid)
        grid, below_grid = window.grid(level.grid), coarse_window.grid(coarse.distance.patch)
        slabs, few = hierarchy.ranks.distribute(grid)
        self._scatter = Scatter(window, level.slabs, slabs, comm)
        if level is hierarchy.target:
            self.verification = VerificationProduct(level, self._scatter, slabs, hierarchy.ranks)
        fine = self._cache.window((self._number, "fine"), grid, slabs, few, self.verification)
        if level.compliance is not None:
            fine.compliance = self._scatter.forward(level.compliance)
        below = self._cache.window((self._number, "below"), below_grid, slabs.coarsen(factors[0]), few)
        self._operators = fine, below
        cut = Scatter(coarse_window.relative_to(outer), coarse.operator.slabs, below.slabs, comm).forward
        self.coarse = CoarseSolution(below, cut(coarse.u), cut(coarse.p), cut(coarse.contact))
        self.transfer = Transfer(fine, below, factors, comm)
        part = UndeformedDistance.part_of(self._distance, fine, self._scatter)
        self.state = WindowState(fine, part)

    def loaded_cells(self):
        """Return the numbers of this rank's cells in contact in the grid, and their pressures."""
        rows, columns = np.nonzero(self.state.in_contact())
        rows_of_grid = rows + self._window.y0 + self.state.operator.slabs.rows.start
        cells = rows_of_grid * self._level.grid.nx + columns + self._window.x0
        return cells, self.state.p[rows, columns]

    def boxes_for_next(self, coarse_minimum, depth):
        """Return the Boxes from which the next finer window is chosen.

        Collective over the ranks of the state. The result is None on grids coarser than the finest grid without a
        window. On that grid, contact is predicted from `coarse_minimum` and `depth`. `coarse_minimum` is the least
        undeformed distance of the target cells in each cell, `depth` the predicted depth on the next finer grid [mm].
        """
        state, finest_unwindowed = self.state, self._hierarchy.finest_unwindowed
        if self._number < finest_unwindowed:
            return None
        masks, predicted = [state.in_contact()], None
        if self._predicted:
            predicted = self._predicted.refine(self.transfer.factors, self._level.grid)
        elif coarse_minimum is not None and self._number == finest_unwindowed:
            with np.errstate(invalid="ignore"):
                masks.append(coarse_minimum - state.distance.rise() - depth + state.u <= 0)
        contact, *others = bounding_boxes(masks, state.operator.slabs, state.comm)
        return Boxes(self._window, contact, others[0] if others else predicted)

    def close(self):
        """Return the operators of a window to the cache."""
        if self.windowed:
            for operator in self._operators:
                self._cache.close(operator)

    def expand_to_grid(self, depth, converged):
        """Return the state on all cells at a depth, and whether it is final.

        The result is not final if the window has `converged` but the bodies penetrate outside the window. The state of
        the window is freed.
        """
        inside, scatter = self.state, self._scatter
        u = self.verification.displacement(inside, converged)
        inside.distance.destroy()
        inside.distance = inside.u = None  # room for the state of all cells
        self.state = state = ContactState(
            self._level, self._distance, u=u, displacement_status=Displacement.EXACT
        )
        state.depth = depth
        scatter.reverse(inside.p, state.values)
        scatter.reverse(inside.contact, state.contact)
        inside.destroy()
        return state, not converged or not state.activate_penetrating().added


def _choose_window(boxes, patch, margin, possible):
    """Return the next finer grid's window, or None.

    The window is counted in cells of the coarser grid. The window contains the contact of the coarser grid, widened by
    `margin`, and predicted contact. If a smaller window saves no time, return the window of the coarser grid, or None
    if there was none. `possible` is the window around all cells where contact is possible.
    """
    outer, contact = boxes.outer, boxes.contact
    fallback, most = (None, MAX_WINDOW_FRACTION) if outer == whole_window(patch) else (outer, 1.0)
    if contact is None:
        return fallback
    rows = _widen(contact.y0 + outer.y0, contact.y1 + outer.y0, margin, possible.y0, possible.y1)
    columns = _widen(contact.x0 + outer.x0, contact.x1 + outer.x0, margin, possible.x0, possible.x1)
    box = Window(*rows, *columns)
    box = box.join(boxes.predicted) if boxes.predicted else box
    (ny, nx), (in_y, in_x) = patch.shape, patch.repeats
    rows = _round_up_size(box.y0, box.y1, outer.y0, outer.y1, in_y and ny)
    window = Window(*rows, *_round_up_size(box.x0, box.x1, outer.x0, outer.x1, in_x and nx))
    return window if 0 < window.n <= most * outer.n else fallback


def _widen(first, last, margin, lowest, highest):
    """Widen a cell interval on both sides, within bounds.

    `margin` is the width added on each side, divided by the length of the interval.
    """
    by = max(MIN_MARGIN, int(np.ceil(margin * (last - first))))
    return max(first - by, lowest), min(last + by, highest)


def _round_up_size(first, last, lowest, highest, period=0):
    """Round up an interval to a cached size or fast FFT length.

    The interval stays within `lowest` and `highest`; an empty interval stays empty. If the patch repeats after `period`
    cells, an interval of at least `MIN_WHOLE_PERIOD` of the period becomes the whole period, which needs no padding.
    """
    first, last = max(first, lowest), min(last, highest)
    if first >= last:
        return lowest, lowest
    length = max(-(-(last - first) // SIZE_STEP), 2) * SIZE_STEP
    if length > 4 * SIZE_STEP:
        length = next_fast_len(last - first, real=True)
    whole = highest - lowest == period and length >= MIN_WHOLE_PERIOD * period
    length = highest - lowest if whole else min(length, highest - lowest)
    first = max(lowest, min(first - (length - (last - first)) // 2, highest - length))
    return first, first + length
