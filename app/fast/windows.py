"""Windows: a grid is worked on in a rectangle around the contact area of the coarser grid.

Pressure vanishes outside, so nothing is neglected there but the question whether the bodies penetrate, and that is
asked in the end, of the verification product on all cells of the target grid. If they do, the iteration goes on there.
That is dear, so where asperities of the target grid stand out of the cells of the finest grid that is always worked on
as a whole (`Hierarchy.coarse_minimum`), a box around the contact they may make is in every window.

Switch: ``-lcp_window`` (share of the extent of contact that is added on every side, 0: none). Gain: see `app.fast`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.fft import next_fast_len

from app.contact.state import ContactState, UndeformedDistance
from app.halfspace.grid import Slabs
from app.halfspace.operator import InfluenceOperator
from app.halfspace.reductions import sum_over
from app.halfspace.window import Scatter, Window, bounding_box, whole
from app.multigrid.transfer import Transfer

_LEAST = 4  # cells of the coarser grid around contact
_MOST = 0.85  # of the cells; a larger window is not worth its own spectra


@dataclass
class CoarseSolution:
    """What the coarser grid found, cut to the window of the finer one."""

    operator: InfluenceOperator
    u: np.ndarray
    p: np.ndarray
    contact: np.ndarray
    depth: float
    load: float


class VerificationProduct:
    """Double precision product for a window: on all cells of the target grid.

    Attributes
    ----------
    u : ndarray or None
        The last product, on all cells.
    """

    count = 0  # its products are those of the target grid's operator

    def __init__(self, target, scatter):
        self._target, self._scatter = target, scatter
        self.u = None

    def apply(self, p, u):
        """Compute u = A p in the window and everywhere else. Collective."""
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._scatter.reverse(p, self.u)
        self._target.exact_displacement(self.u, self.u)
        u[...] = self._scatter.forward(self.u)

    def follow(self, u):
        """Scale the last product as the window's u has been scaled since, to meet a load. Collective."""
        before, after = sum_over(self._target.comm, [self._scatter.forward(self.u).sum(), u.sum()])
        if before and after != before:
            self.u *= after / before


class Stage:
    """A grid of a nested iteration, or a window of it, ready to start from what the coarser one found.

    Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
        Says which levels may have a window, and how large it is.
    number : int
        Level.
    distance : UndeformedDistance
        On all of the level.
    coarse : ContactState or None
        State of the coarser grid.
    predicted : Window, optional
        Predicted contact box: cells of the coarser grid that should not be left out.

    Attributes
    ----------
    state : ContactState
    coarse : ContactState or CoarseSolution
        As far as it is below `state`.
    transfer : Transfer
        Between these.
    """

    def __init__(self, hierarchy, number, distance, coarse, predicted=None):
        self._hierarchy, self._distance, self._predicted = hierarchy, distance, predicted
        self.coarse, self.transfer = coarse, hierarchy.transfers[number]
        level, window = hierarchy.levels[number], None
        self._level = level
        if coarse is not None:
            distance.move_to(coarse.depth)
        if coarse is not None and hierarchy.windowed(level):
            possible = bounding_box(distance.admissible, level.slabs, level.comm).coarsen(
                self.transfer.factors
            )
            coarse_grid = hierarchy.levels[number - 1].grid
            window = _choose(coarse, coarse_grid, hierarchy.margin, possible, predicted)
        self.windowed = window is not None
        if self.windowed:
            self._look_through(window, coarse_grid)
        else:
            self.state = ContactState(level, distance)

    @PETSc.Log.EventDecorator("ContactWindow")
    def _look_through(self, coarse_window, coarse_grid):
        """Make operators, transfer and state of a window, which is given by that of the coarser grid."""
        hierarchy, level = self._hierarchy, self._level
        coarse, factors = self.coarse, self.transfer.factors

        def operator(grid, slabs, verification=None):
            common = hierarchy.compliance, slabs, level.comm, hierarchy.dtype
            return InfluenceOperator(grid, *common, exact_product=verification, workspace=hierarchy.target)

        window = coarse_window.refine(factors, level.grid)
        slabs = Slabs.over(level.comm, window.y1 - window.y0, factors[0])
        self._scatter = Scatter(window, level.slabs, slabs, level.comm)
        self._verification = None
        if level is hierarchy.target:
            self._verification = VerificationProduct(level, self._scatter)
        fine = operator(window.grid(level.grid), slabs, self._verification)
        below = operator(coarse_window.grid(coarse_grid), slabs.coarsen(factors[0]))
        inner = coarse_window.within(coarse.window)
        cut = Scatter(inner, coarse.operator.slabs, below.slabs, coarse.comm).forward
        self.coarse = CoarseSolution(
            below, cut(coarse.u), cut(coarse.p), cut(coarse.contact), coarse.depth, coarse.load
        )
        fine.prepare("product")  # first, so that other transforms can use its storage
        self.transfer = Transfer(fine, below, factors)
        part = UndeformedDistance.part_of(self._distance, fine, self._scatter)
        self.state = ContactState(fine, part, window, patch=level.grid)

    def predicted_box(self, coarse_minimum, depth):
        """Where the target grid may have contact that this one cannot see: asperities smaller than its cells.

        Collective. Told by the finest whole grid, when it is solved; known on the finer levels.

        Parameters
        ----------
        coarse_minimum : ndarray or None
            See `Hierarchy.coarse_minimum`.
        depth : float
            That is to be expected on the next finer grid [mm].

        Returns
        -------
        Window or None
            Of this level.
        """
        state, level = self.state, self._level
        if self._predicted:
            return self._predicted.refine(self.transfer.factors, level.grid)
        if coarse_minimum is None or level is not self._hierarchy.levels[self._hierarchy.finest_whole]:
            return None
        with np.errstate(invalid="ignore"):
            return bounding_box(coarse_minimum - depth + state.u <= 0, level.slabs, level.comm)

    def close(self):
        """Free what is of no use to a finer grid. Not collective."""
        if self.windowed:
            for operator in (self.state.operator, self.coarse.operator):
                self._hierarchy.spent(operator)
                operator.free_solvers()

    def everything(self, outcome):
        """Return the state on all cells of the target grid, that in the window being final. Collective.

        Parameters
        ----------
        outcome : Outcome
            In the window.

        Returns
        -------
        state : ContactState
        complete : bool
            It is true for all cells: the bodies penetrate nowhere outside. Not asked if it is not converged.
        """
        inside, level, scatter = self.state, self._hierarchy.target, self._scatter
        if self._verification.u is None or not outcome.converged:
            self._verification.apply(inside.p, inside.u)
        self._verification.follow(inside.u)
        self._distance.move_to(inside.depth)
        state = ContactState(level, self._distance, u=self._verification.u)
        with state.pressure as values:
            scatter.reverse(inside.p, values.reshape(state.u.shape))
        scatter.reverse(inside.contact, state.contact)
        inside.destroy()
        inside.distance.destroy()
        if not outcome.converged:
            return state, True
        update = state.activate_penetrating()
        return state, not update.added


def _choose(coarse, grid, margin, possible, predicted):
    """Window of the coarser grid around its contact; None if leaving cells out does not pay.

    Collective.

    Parameters
    ----------
    coarse : ContactState
        State of the coarser grid, or of a window of it.
    grid : Grid
        All of it.
    margin : float
    possible : Window
        Around all cells where contact is possible.
    predicted : Window or None
        Around all cells where contact is to be expected for other reasons.
    """
    contact, outer = bounding_box(coarse.contact, coarse.operator.slabs, coarse.comm), coarse.window
    window = None
    if contact is not None:
        rows = _widen(contact.y0 + outer.y0, contact.y1 + outer.y0, margin, possible.y0, possible.y1)
        columns = _widen(contact.x0 + outer.x0, contact.x1 + outer.x0, margin, possible.x0, possible.x1)
        box = Window(*rows, *columns)
        box = box.join(predicted) if predicted else box
        window = Window(
            *_fill(box.y0, box.y1, outer.y0, outer.y1), *_fill(box.x0, box.x1, outer.x0, outer.x1)
        )
    if outer == whole(grid):
        return window if window is not None and 0 < window.n <= _MOST * grid.n else None
    return window if window is not None and window.n > 0 else outer


def _widen(first, last, margin, lowest, highest):
    """Add the margin on both sides, as far as contact is possible there."""
    by = max(_LEAST, int(np.ceil(margin * (last - first))))
    return max(first - by, lowest), min(last + by, highest)


def _fill(first, last, lowest, highest):
    """Grow to a length with small prime factors, between `lowest` and `highest`; nothing stays nothing."""
    first, last = max(first, lowest), min(last, highest)
    if first >= last:
        return lowest, lowest
    length = min(next_fast_len(last - first, real=True), highest - lowest)
    first = max(lowest, min(first - (length - (last - first)) // 2, highest - length))
    return first, first + length
