"""Working in a window: around the contact area of the coarser grid there is a frame, beyond it no cell is looked at.

A window is chosen for every grid but the small ones. Pressure vanishes outside, so nothing is neglected there but the
question whether the bodies penetrate, and that is asked in the end, on all cells of the target grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

from app.contact.active_set import ContactGrid, gap_statistics
from app.halfspace.grid import Slabs
from app.halfspace.operator import InfluenceOperator
from app.halfspace.window import Passage, Window, bounding_box, whole
from app.multigrid.hierarchy import worth_a_window
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
            self.u = np.zeros(self._target.local_shape)
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
    number : int
        Level.
    shape : ndarray
        Undeformed distance at zero approach on all of the level.
    below : ContactGrid or None
        State of the coarser grid.
    margin : float
        Share of the extent of the contact area to be added all around; 0: all cells.

    Attributes
    ----------
    state : ContactGrid
    below : Below
        With ``transfer`` to it.
    """

    def __init__(self, hierarchy, number, shape, below, margin):
        level, self._hierarchy = hierarchy.levels[number], hierarchy
        self._target = number == len(hierarchy.levels) - 1
        self.windowed, self._shape = False, shape
        coarse_window = None
        factors = below and (hierarchy.transfers[number].fy, hierarchy.transfers[number].fx)
        if below is not None and margin and worth_a_window(level.grid):
            possible = bounding_box(~np.isnan(shape), level.slabs, level.comm)
            possible = possible and possible.coarsen(factors)
            coarse_window = _choose(below, hierarchy.levels[number - 1].grid, margin, possible)
        if coarse_window is None:
            self.state = ContactGrid(level, shape, level.comm)
            if below is not None:
                self.transfer = hierarchy.transfers[number]
                self.below = Below(
                    below.operator, below.u, below.p, below.contact, below.approach, below.load
                )
            return
        self.windowed = True
        window = coarse_window.refine(factors, level.grid)
        slabs = None
        if level.comm is not None:
            slabs = Slabs(window.y1 - window.y0, level.comm.size, level.comm.rank, factors[0])
        passage = Passage(window, level.slabs, slabs or Slabs(window.y1 - window.y0), level.comm)
        self._passage = passage
        self._last_word = LastWord(level, passage) if self._target else None
        common = hierarchy.compliance, slabs, level.comm, hierarchy.dtype
        operator = InfluenceOperator(window.grid(level.grid), *common, self._last_word, hierarchy.target)
        coarse_slabs = slabs and slabs.coarsen(factors[0])
        coarse_grid = coarse_window.grid(hierarchy.levels[number - 1].grid)
        common = hierarchy.compliance, coarse_slabs, level.comm, hierarchy.dtype
        coarse = InfluenceOperator(coarse_grid, *common, partner=hierarchy.target)
        inner = Passage(
            coarse_window.within(below.window), below.operator.slabs, coarse.slabs, below.operator.comm
        )
        self.below = Below(
            coarse,
            inner.enter(below.u),
            inner.enter(below.p),
            inner.enter(below.contact),
            below.approach,
            below.load,
        )
        operator.prepare("product")  # first, so that other transforms can use its storage
        self.transfer = Transfer(operator, coarse, factors)
        statistics = gap_statistics(shape, ~np.isnan(shape), level.comm)
        self.state = ContactGrid(operator, passage.enter(shape), level.comm, window, statistics)

    def close(self):
        """Free what is of no use to a finer grid. Collective."""
        if self.windowed:
            for operator in (self.state.operator, self.below.operator):
                self._hierarchy.spent(operator)
                operator.free()
                operator.free_solvers()

    def everything(self, converged):
        """Return the state on all cells of the target grid, that in the window being final. Collective.

        Returns
        -------
        state : ContactGrid
        complete : bool
            The bodies penetrate nowhere outside the window, as far as that is of interest.
        """
        inside, level = self.state, self._hierarchy.target
        if self._last_word.u is None or not converged:
            self._last_word.apply(inside.p, inside.u)
        state = ContactGrid(level, self._shape, level.comm)
        state.u, state.approach = self._last_word.u, inside.approach
        with state.pressure as values:
            self._passage.leave(inside.p, values.reshape(state.u.shape))
        self._passage.leave(inside.contact, state.contact)
        inside.destroy()
        return state, not converged or state.admit().added == 0


def _choose(below, grid, margin, possible):
    """Window of the coarser grid around its contact; None if leaving cells out does not pay.

    Collective.

    Parameters
    ----------
    below : ContactGrid
        State of the coarser grid, or of a window of it.
    grid : Grid
        All of it.
    margin : float
    possible : Window or None
        Around all cells where contact is possible.
    """
    contact, outer = bounding_box(below.contact, below.operator.slabs, below.comm), below.window
    window = None
    if contact is not None and possible is not None:
        rows = _widen(contact.y0 + outer.y0, contact.y1 + outer.y0, margin, possible.y0, possible.y1)
        columns = _widen(contact.x0 + outer.x0, contact.x1 + outer.x0, margin, possible.x0, possible.x1)
        window = Window(*_fill(*rows, outer.y0, outer.y1), *_fill(*columns, outer.x0, outer.x1))
    if outer == whole(grid):
        return window if window is not None and 0 < window.n <= _MOST * grid.n else None
    return window if window is not None and window.n > 0 else outer


def _widen(first, last, margin, lowest, highest):
    """Add the margin on both sides, as far as contact is possible there."""
    by = max(_LEAST, int(np.ceil(margin * (last - first))))
    return max(first - by, lowest), min(last + by, highest)


def _fill(first, last, lowest, highest):
    """Grow until the FFTs like the length, between `lowest` and `highest`; nothing stays nothing."""
    first, last = max(first, lowest), min(last, highest)
    if first >= last:
        return lowest, lowest
    length = min(next_fast_len(last - first, real=True), highest - lowest)
    first = max(lowest, min(first - (length - (last - first)) // 2, highest - length))
    return first, first + length
