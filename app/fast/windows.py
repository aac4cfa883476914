"""Windows: a grid is worked on in a rectangle around the contact area of the coarser grid.

Pressure vanishes outside, so nothing is neglected there but the question whether the bodies penetrate, and that is
asked in the end, of the verification product on all cells of the target grid. If they do, the iteration goes on there.
That is dear, so where asperities of the target grid stand out of the cells of the finest grid that is always worked on
as a whole (`Hierarchy.coarse_minimum`), a box around the contact they may make is in every window.

Switch: ``-lcp_window`` (share of the extent of contact that is added on every side, 0: none). Gain: see `app.fast`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.fft import next_fast_len

from app.contact.distance import UndeformedDistance
from app.contact.state import ContactState, Displacement
from app.halfspace.operator import InfluenceOperator
from app.halfspace.window import Scatter, Window, bounding_boxes, whole
from app.multigrid.transfer import Transfer

# What ranks that have no part in a window are told: take part in a product; there will be no more, and the last one is
# that of the answer; there will be no more, and the last one is out of date.
_PRODUCT, _DONE, _GONE = range(3)
_LEAST = 4  # cells of the coarser grid around contact
_STEP = 16  # small windows have multiples of so many of them, and twice as many at least: they are kept
_MOST = 0.85  # of the cells; a larger window is not worth its own spectra


@dataclass
class CoarseSolution:
    """What the coarser grid found, cut to the window of the finer one."""

    operator: InfluenceOperator
    u: np.ndarray
    p: np.ndarray
    contact: np.ndarray
    depth: float


class Boxes(NamedTuple):
    """What a coarser grid tells the next one to choose its window by: cells of the coarser grid, or None."""

    contact: Window | None
    predicted: Window | None  # where the target grid may have contact that this one cannot see


class VerificationProduct:
    """Double precision product for a window: on all cells of the target grid, by all ranks.

    Those that have no part in the window wait for it in `help`.

    Attributes
    ----------
    u : ndarray or None
        The last product, on all cells, if it is not forgotten.
    """

    count = flops = 0  # its products are those of the target grid's operator

    def __init__(self, target, scatter, inner):
        self._target, self._scatter, self._inner = target, scatter, inner
        self._alone = inner.size < target.slabs.size
        self.u = None

    def apply(self, p, u):
        """Compute u = A p in the window and everywhere else. Collective over the ranks of the window."""
        if self._alone:
            self._target.comm.bcast(_PRODUCT)
        self.by_all(p, u)

    def help(self, shape):
        """Take part in all products to come, or say that there are none. Collective over all ranks."""
        if not self._alone:
            return
        if self._inner.active:
            self._target.comm.bcast(_GONE if self.u is None else _DONE)
            return
        nothing = np.empty(shape)
        while (wanted := self._target.comm.bcast(None)) == _PRODUCT:
            self.by_all(nothing, nothing)
        if wanted == _GONE:
            self.forget()

    def forget(self):
        """Free the last product: there will be another one. Not collective."""
        self.u = None

    def by_all(self, p, u):
        """As `apply`, for ranks that have no part in the window, too. Collective over all ranks."""
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._scatter.reverse(p, self.u, self._target.exact_product.working_storage)
        self._target.exact_displacement(self.u, self.u)
        self._scatter.forward(self.u, u)


class Stage:
    """A grid of a nested iteration, or a window of it, ready to start from what the coarser one found.

    Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
        Says which levels may have a window, and how large it is.
    kept : Kept
        Where operators of windows come from.
    number : int
        Level.
    distance : UndeformedDistance
        On all of the level.
    coarse : ContactState or None
        State of the coarser grid.
    boxes : Boxes, optional
        What was found on it.

    Attributes
    ----------
    state : ContactState
    coarse : ContactState or CoarseSolution
        As far as it is below `state`; until `keep_coarse_pressure`.
    coarse_pressure : ndarray
        Its pressure, from then on.
    transfer : Transfer
        Between these.
    """

    def __init__(self, hierarchy, kept, number, distance, coarse, boxes=None):
        self._hierarchy, self._kept, self._number, self._distance = hierarchy, kept, number, distance
        self._predicted = boxes and boxes.predicted
        self.coarse, self.transfer = coarse, hierarchy.transfers[number]
        level, window = hierarchy.levels[number], None
        self._level, self._verification = level, None
        if coarse is not None:
            distance.move_to(coarse.depth)
        if coarse is not None and hierarchy.windowed(level):
            possible = distance.possible.coarsen(self.transfer.factors)
            coarse_grid = hierarchy.levels[number - 1].grid
            window = _choose(boxes, coarse.window, coarse_grid, hierarchy.margin, possible)
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

        window, comm = coarse_window.refine(factors, level.grid), hierarchy.comm
        grid = window.grid(level.grid)
        slabs, few = hierarchy.ranks.deal(grid)

        self._scatter = Scatter(window, level.slabs, slabs, comm)
        if level is hierarchy.target:
            self._verification = VerificationProduct(level, self._scatter, slabs)
        fine = self._kept.window((self._number, "fine"), grid, slabs, few, self._verification)
        below = self._kept.window(
            (self._number, "below"), coarse_window.grid(coarse_grid), slabs.coarsen(factors[0]), few
        )
        cut = Scatter(coarse_window.within(coarse.window), coarse.operator.slabs, below.slabs, comm).forward
        self.coarse = CoarseSolution(below, cut(coarse.u), cut(coarse.p), cut(coarse.contact), coarse.depth)
        fine.prepare("product")  # first, so that other transforms can use its storage
        self.transfer = Transfer(fine, below, factors, comm)
        part = UndeformedDistance.part_of(self._distance, fine, self._scatter)
        self.state = ContactState(fine, part, window, patch=level.grid)

    def boxes_for_next(self, coarse_minimum, depth):
        """Boxes that the window of the next finer grid should hold.

        Collective over the ranks of the state. Asperities smaller than the cells of this grid are told of by the
        finest whole one, when it is solved, and known on the finer levels.

        Parameters
        ----------
        coarse_minimum : ndarray or None
            See `Hierarchy.coarse_minimum`.
        depth : float
            That is to be expected on the next finer grid [mm].

        Returns
        -------
        Boxes or None
            None if the next grid has no window.
        """
        state, level, hierarchy = self.state, self._level, self._hierarchy
        if self._number < hierarchy.finest_whole:
            return None
        masks, predicted = [state.contact], None
        if self._predicted:
            predicted = self._predicted.refine(self.transfer.factors, level.grid)
        elif coarse_minimum is not None and level is hierarchy.levels[hierarchy.finest_whole]:
            with np.errstate(invalid="ignore"):
                masks.append(coarse_minimum - depth + state.u <= 0)
        contact, *others = bounding_boxes(masks, state.operator.slabs, state.comm)
        return Boxes(contact, others[0] if others else predicted)

    def keep_coarse_pressure(self):
        """Forget the coarser grid but for what is asked for in the end: its pressure. Not collective."""
        self.coarse_pressure, self._below, self.coarse = self.coarse.p, self.coarse.operator, None

    def end_verification(self):
        """Let the ranks outside of the window go on, or help them until they may. Collective."""
        if self._verification:
            self._verification.help(self.state.u.shape)

    def close(self):
        """Free what is of no use to a finer grid. Not collective."""
        if self.windowed:
            for operator in (self.state.operator, self._below):
                self._kept.close(operator)

    def on_all_cells(self, outcome, by_load):
        """Return the state on all cells of the target grid, that in the window being final. Collective.

        Parameters
        ----------
        outcome : Outcome
            In the window.
        by_load : bool
            The load is prescribed.

        Returns
        -------
        state : ContactState
        complete : bool
            It is true for all cells: the bodies penetrate nowhere outside. Not asked if it is not converged.
        """
        inside, level, scatter = self.state, self._hierarchy.target, self._scatter
        if self._verification.u is None or not outcome.converged:
            self._verification.by_all(inside.p, inside.u)
            inside.scaled = 1.0
        if by_load:  # settled since the last product
            self._verification.u *= self._hierarchy.comm.bcast(inside.scaled)
        self._distance.move_to(inside.depth)
        inside.distance.destroy()
        inside.distance = inside.u = None  # room for the state of all cells
        self.state = state = ContactState(
            level, self._distance, u=self._verification.u, u_is=Displacement.EXACT
        )
        with state.pressure as values:
            scatter.reverse(inside.p, values.reshape(state.u.shape))
        scatter.reverse(inside.contact, state.contact)
        inside.destroy()
        if not outcome.converged:
            return state, True
        update = state.activate_penetrating()
        return state, not update.added


def _choose(boxes, outer, grid, margin, possible):
    """Window of the coarser grid around its contact; None if leaving cells out does not pay.

    Not collective.

    Parameters
    ----------
    boxes : Boxes
        Of the coarser grid, or the window of it that was worked on.
    outer : Window
        This.
    grid : Grid
        All of it.
    margin : float
    possible : Window
        Around all cells where contact is possible.
    """
    contact, window = boxes.contact, None
    if contact is not None:
        rows = _widen(contact.y0 + outer.y0, contact.y1 + outer.y0, margin, possible.y0, possible.y1)
        columns = _widen(contact.x0 + outer.x0, contact.x1 + outer.x0, margin, possible.x0, possible.x1)
        box = Window(*rows, *columns)
        box = box.join(boxes.predicted) if boxes.predicted else box
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
    """Grow to a length that many windows have, between `lowest` and `highest`; nothing stays nothing."""
    first, last = max(first, lowest), min(last, highest)
    if first >= last:
        return lowest, lowest
    length = max(-(-(last - first) // _STEP), 2) * _STEP
    if length > 4 * _STEP:
        length = next_fast_len(last - first, real=True)
    length = min(length, highest - lowest)
    first = max(lowest, min(first - (length - (last - first)) // 2, highest - length))
    return first, first + length
