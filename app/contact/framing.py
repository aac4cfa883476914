"""Working in a window: around the contact area of the coarser grid there is a frame, beyond it no cell is looked at.

A window is chosen for every grid but the small ones, if it leaves enough out. Pressure vanishes outside, so nothing is
neglected there but the question whether the bodies penetrate, and that is asked in the end, on all cells of the target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from app.contact.active_set import ContactGrid, gap_statistics
from app.halfspace.grid import Slabs
from app.halfspace.operator import InfluenceOperator
from app.halfspace.window import Passage, Window, bounding_box, whole
from app.multigrid.transfer import Transfer

_LEAST = 4  # cells of the coarser grid around contact
_MOST = 0.85  # of the cells; a larger window is not worth its own spectra


@dataclass
class Below:
    """What the coarser grid found, cut to the window of the finer one."""

    operator: InfluenceOperator
    u: np.ndarray
    p: np.ndarray
    contact: np.ndarray
    approach: float
    load: float


class LastWord:
    """Exact product for a window: in double precision, on all cells of the target grid.

    Attributes
    ----------
    u : ndarray or None
        The last product, on all cells.
    """

    count = 0  # its products are those of the target grid's operator

    def __init__(self, target, passage):
        self._target, self._passage = target, passage
        self.u = None

    def apply(self, p, u):
        """Compute u = A p in the window and everywhere else. Collective."""
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._passage.leave(p, self.u)
        self._target.exact_displacement(self.u, self.u)
        u[...] = self._passage.enter(self.u)


class Frame:
    """A grid of a nested iteration, or a window of it, ready to start from what the coarser one found.

    Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
        Says how large windows are, and which levels may have one.
    number : int
        Level.
    shape : ndarray
        Undeformed distance at zero approach on all of the level.
    below : ContactGrid or None
        State of the coarser grid.
    outlook : Window, optional
        Cells of the coarser grid that should not be left out, as far as its own window goes.

    Attributes
    ----------
    state : ContactGrid
    below : ContactGrid or Below
        As far as it is below `state`.
    transfer : Transfer
        Between these.
    """

    def __init__(self, hierarchy, number, shape, below, outlook=None):
        self._hierarchy, self._shape, self._outlook = hierarchy, shape, outlook
        self.below, self.transfer = below, hierarchy.transfers[number]
        level, window = hierarchy.levels[number], None
        self._level = level
        if below is not None and hierarchy.windowed(level):
            admissible = ~np.isnan(shape)
            possible = bounding_box(admissible, level.slabs, level.comm).coarsen(self.transfer.factors)
            coarse_grid = hierarchy.levels[number - 1].grid
            window = _choose(below, coarse_grid, hierarchy.margin, possible, outlook)
        self.windowed = window is not None
        if not self.windowed:
            self.state = ContactGrid(level, shape)
            return
        statistics = gap_statistics(shape, admissible, level.comm)
        self._look_through(window, coarse_grid, statistics)

    def _look_through(self, coarse_window, coarse_grid, statistics):
        """Make operators, transfer and state of a window, which is given by that of the coarser grid."""
        hierarchy, level = self._hierarchy, self._level
        below, factors = self.below, self.transfer.factors

        def operator(grid, slabs, last_word=None):
            common = hierarchy.compliance, slabs, level.comm, hierarchy.dtype
            return InfluenceOperator(grid, *common, exact_product=last_word, partner=hierarchy.target)

        window = coarse_window.refine(factors, level.grid)
        slabs = Slabs.over(level.comm, window.y1 - window.y0, factors[0])
        self._passage = Passage(window, level.slabs, slabs, level.comm)
        self._last_word = LastWord(level, self._passage) if level is hierarchy.target else None
        fine = operator(window.grid(level.grid), slabs, self._last_word)
        coarse = operator(coarse_window.grid(coarse_grid), slabs.coarsen(factors[0]))
        inner = coarse_window.within(below.window)
        cut = Passage(inner, below.operator.slabs, coarse.slabs, below.comm).enter
        self.below = Below(coarse, cut(below.u), cut(below.p), cut(below.contact), below.approach, below.load)
        fine.prepare("product")  # first, so that other transforms can use its storage
        self.transfer = Transfer(fine, coarse, factors)
        self.state = ContactGrid(fine, self._passage.enter(self._shape), window, statistics)

    def outlook(self, lowest):
        """Where the target grid may have contact that this one cannot see: asperities smaller than its cells.

        Collective. Told by the lookout of the hierarchy, when it is solved; known on the finer levels.

        Parameters
        ----------
        lowest : ndarray or None
            See `Hierarchy.lowest`.

        Returns
        -------
        Window or None
            Of this level.
        """
        state, level = self.state, self._level
        if self._outlook:
            return self._outlook.refine(self.transfer.factors, level.grid)
        if lowest is None or level is not self._hierarchy.levels[self._hierarchy.lookout]:
            return None
        with np.errstate(invalid="ignore"):
            return bounding_box(lowest - state.approach + state.u <= 0, level.slabs, level.comm)

    def close(self):
        """Free what is of no use to a finer grid. Collective."""
        if self.windowed:
            for operator in (self.state.operator, self.below.operator):
                self._hierarchy.spent(operator)
                operator.free()
                operator.free_solvers()

    def everything(self, outcome):
        """Return the state on all cells of the target grid, that in the window being final. Collective.

        Parameters
        ----------
        outcome : Outcome
            In the window.

        Returns
        -------
        state : ContactGrid
        complete : bool
            It is true for all cells: the bodies penetrate nowhere outside. Not asked if it is not converged.
        """
        inside, level = self.state, self._hierarchy.target
        if self._last_word.u is None or not outcome.converged:
            self._last_word.apply(inside.p, inside.u)
        state = ContactGrid(level, self._shape, statistics=inside.statistics, u=self._last_word.u)
        state.approach = inside.approach
        with state.pressure as values:
            self._passage.leave(inside.p, values.reshape(state.u.shape))
        self._passage.leave(inside.contact, state.contact)
        inside.destroy()
        if not outcome.converged:
            return state, True
        change = state.admit()
        allowed = (1 + 1e-6) * outcome.residual * state.gap_norm()
        return state, change.added == 0 and change.residual <= allowed


def _choose(below, grid, margin, possible, outlook):
    """Window of the coarser grid around its contact; None if leaving cells out does not pay.

    Collective.

    Parameters
    ----------
    below : ContactGrid
        State of the coarser grid, or of a window of it.
    grid : Grid
        All of it.
    margin : float
    possible : Window
        Around all cells where contact is possible.
    outlook : Window or None
        Around all cells where contact is to be expected for other reasons.
    """
    contact, outer = bounding_box(below.contact, below.operator.slabs, below.comm), below.window
    window = None
    if contact is not None:
        rows = _widen(contact.y0 + outer.y0, contact.y1 + outer.y0, margin, possible.y0, possible.y1)
        columns = _widen(contact.x0 + outer.x0, contact.x1 + outer.x0, margin, possible.x0, possible.x1)
        box = Window(*rows, *columns)
        box = box.join(outlook) if outlook else box
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
