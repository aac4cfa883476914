"""State of the periodic method with a hardness H, the largest pressure.

In the contact set C, the gap is closed and 0 < p < H. A cell outside C is open (p = 0) or *plastic* (p = H); in both
cases w is unknown. So plastic cells are free cells, too. The state and ``solver.carried`` store p - H instead of p in
plastic cells. Then the stored pressure must vanish on all free cells, and CG and its preconditioner are the same as
without a hardness.
"""

import zlib

import numpy as np

from app.contact import bounds_loops, full_plasticity, prescribed_load
from app.contact.loading import PrescribedApproach
from app.methods.periodic.state import PrimalState
from app.parallel.reductions import sums_and_minima


def primal_state(operator, distance, inverse, loading):
    """Make the `PrimalState` of a grid, with or without a hardness.

    The parameters are as in `PrimalState`.
    """
    kind = CappedPrimalState if distance.bounds.capped else PrimalState
    return kind(operator, distance, inverse, loading)


class CappedPrimalState(PrimalState):
    """A `PrimalState` whose pressure has an upper bound.

    Attributes
    ----------
    plastic : ndarray of bool, shape (local rows, nx)
        Plastic cells.
    """

    def __init__(self, operator, distance, inverse, loading):
        super().__init__(operator, distance, inverse, _feasible(loading, distance))
        self.plastic = np.zeros(self.w.shape, bool)
        self._left, self._sets = set(), None  # checksums of earlier sets, and of the present ones

    def reset_for_safeguard(self):
        """Set contact in all admissible cells; see `PrimalState.reset_for_safeguard`."""
        self._add_hardness(self.values)  # a verified p has it already; `verify` clips what is above
        self.plastic[...] = False
        super().reset_for_safeguard()

    def refresh(self, exact=False):
        """Recompute pressure from displacement; see `PrimalState.refresh`."""
        super().refresh(exact)
        self._subtract_hardness(self.values)

    def interpolate_from(self, coarse, transfer):
        """Start from the coarser grid's displacement, pressure and plastic cells.

        w and p are interpolated, plastic cells are copied.
        """
        mean, bounds, copied = self.mean_pressure, self.bounds, np.empty(self.w.shape)
        super().interpolate_from(coarse, transfer)
        before = coarse.bounds.plastic(coarse.p) & ~coarse.contact
        transfer.copy(before.astype(float), copied)
        self.plastic = bounds.admissible & (copied > 0) & np.isfinite(bounds.upper)
        if not self.keeps_mean and coarse.loading is not self.loading:  # the load was reduced
            self.add_mean_pressure(mean - self.mean_pressure)

    def start(self, solver):
        """Put plastic cells with gaps into contact; see `PrimalState.start`."""
        opened = self.plastic & (self.w > self.distance.b)
        self.plastic &= ~opened
        self.contact |= opened
        if self._has_pressure:
            self._subtract_hardness(self.values)
        super().start(solver)

    def _start_fields(self):
        return *super()._start_fields(), self.plastic

    def continue_from(self, solution):
        """Start from a Solution on this grid; see `PrimalState.continue_from`."""
        if solution.plastic is not None:
            bounds = self.bounds
            np.logical_and(solution.plastic, bounds.admissible & np.isfinite(bounds.upper), out=self.plastic)
        super().continue_from(solution)

    def _touchable(self):
        return self.admissible & ~self.plastic

    def _guess_sources(self, scale, force, lowest):
        self._add_hardness(self.values)
        super()._guess_sources(scale, force, lowest)
        return (self.bounds.upper * scale).astype(np.float32)

    def _apply_guess(self, x, lowest):
        np.less(x, lowest, out=self.plastic)
        super()._apply_guess(x, lowest)
        # Plastic cells overlap.
        np.subtract(x, lowest, out=x)
        np.add(self.w, x, out=self.w, where=self.plastic)
        self.contact &= ~self.plastic

    def _touch(self):
        self._fill_up(self.w)

    def _fill_up(self, w, excess=None):
        """Make the lowest cells plastic until they carry the load.

        `w` is the displacement minus the approach [mm]. Cells become plastic in the order of their gaps (w plus the
        shape), and for equal gaps of their `excess`, the part of p beyond its bounds [N/mm2]. The next cells become
        contact cells, and a constant added to w closes their gap.
        """
        upper = self.bounds.upper
        gap, total = np.where(self.admissible, w - self.distance.b, np.inf), self.mean_pressure * self.cells
        level, total = _fill(gap, upper, total, self.comm)
        np.less(gap, level, out=self.plastic)
        np.equal(gap, level, out=self.contact)
        if excess is not None:
            order = np.where(self.contact, -excess, np.inf)
            last, _ = _fill(order, upper, total, self.comm)
            self.plastic |= order < last
            np.equal(order, last, out=self.contact)
        self.w -= level  # a constant has no pressure

    def exchange(self, solver, *limits):
        """Exchange cells of C with open and plastic ones; see `PrimalState.exchange`."""
        checksums = [zlib.crc32(cells) for cells in (self.contact, self.plastic)]
        self._sets = tuple(self.sum(checksums))
        update = super().exchange(solver, *limits)
        if update.changed:
            self._left.add(self._sets)
        return update

    def _exchange_cells(self, solver, *limits):
        """Release and capture this rank's cells; return the counts.

        If the same contact sets occurred before, only the cell that violates the conditions most is exchanged.
        """
        if self._sets in self._left:
            return self._exchange_worst(solver, *limits)
        fields = solver.carried, self.values, self.w, solver.change, self.distance.b, self.contact
        return self.bounds.exchange(*fields, self.plastic, *limits)

    def _exchange_worst(self, solver, slack, least_gap, compliance, far, captured):
        """Exchange only the cell that violates the conditions most.

        This ends a cycle of contact sets.
        """
        upper, contact, plastic = self.bounds.upper, self.contact, self.plastic
        p, new_w = solver.carried.astype(float), self.w + solver.change
        e = new_w - self.distance.b
        outside = np.where(self.admissible, np.where(plastic, e, -e), 0.0)
        violation = np.where(contact, compliance * abs(self.bounds.excess(p)), outside)
        violation[violation <= np.where(contact, compliance * slack, -least_gap)] = 0.0
        worst = -self.minimum([-violation.max(initial=0.0)])[0]
        swapped = (violation == worst) & (worst > 0)
        captured[...] = swapped & ~contact
        hardens, softens = swapped & contact & (p > upper), captured & plastic
        for field in (solver.carried, self.values):
            field[hardens] -= upper[hardens]
            field[softens] += upper[softens]
        plastic ^= hardens | softens
        contact ^= swapped
        removed = np.count_nonzero(swapped & ~contact)
        moves = worst**2 * np.count_nonzero(swapped) if worst <= far else np.inf
        return np.count_nonzero(contact), np.count_nonzero(captured), removed, new_w.sum(), moves

    def _keep_contact(self, solver, released):
        fields = solver.carried, self.values
        contact = self.admissible & ~self.inverse.mask  # before the exchange, which captured no cells
        plastic = self.plastic & ~contact
        for field in fields:
            self._add_hardness(field)
        self._fill_up(self.w + solver.change, self.bounds.excess(solver.carried))
        for field in fields:
            self._subtract_hardness(field)
        captured, kept = self.contact & ~contact, self.contact & contact
        other = np.count_nonzero(captured), np.count_nonzero(kept), np.count_nonzero(plastic != self.plastic)
        added, left, changed = map(int, self.sum(other))
        np.copyto(self._captured, captured)
        return added + left, added, released - left, np.inf if changed or added else 0.0

    def _open_least(self, solver):
        if self.prescribed_depth <= self.distance.full_depth:
            return super()._open_least(solver)
        room = self.bounds.upper - solver.carried
        least = float(self.minimum([room.min(initial=np.inf)])[0])
        capped = room <= least
        self.add_mean_pressure(least, solver.carried)
        self.contact[capped] = False
        self.plastic[capped] = True
        for field in (solver.carried, self.values):
            field[capped] -= self.bounds.upper[capped]
        return int(self.sum([np.count_nonzero(capped)])[0])

    def finish(self, solver):
        """Also set p = H in plastic cells; see `PrimalState.finish`."""
        super().finish(solver)
        np.copyto(self.values, self.bounds.upper, where=self.plastic)

    def project(self, before):
        """Project p onto its bounds; see `PrimalState.project`.

        Outside C, p is set to a bound.
        """
        p, upper = self.values, self.bounds.upper
        before[...] = p
        # The lower bound first: without plastic cells the sum is that without a hardness, to the last bit.
        total = bounds_loops.project(before, None, self.contact, p)
        limited = self.plastic | (p > upper)
        if limited.any():
            np.copyto(p, upper, where=limited)
            total = p.sum()
        return float(self.sum([total])[0])

    def meet_load(self, total):
        """Bring p to the load by a constant on C; see `PrimalState.meet_load`.

        If there are no plastic cells, p is multiplied by a factor instead.
        """
        load = self.loading.load
        if load is None:
            return True
        wanted = load / self.grid.cell_area
        factor = wanted / total if total > 0 else 1.0
        beyond = np.count_nonzero(self.plastic) or np.count_nonzero(self.p * factor > self.bounds.upper)
        if not self.sum([beyond])[0]:
            return super().meet_load(total)
        missing = self.reach_sum(wanted)
        return abs(missing) <= prescribed_load.LOAD_ROUNDING * wanted

    def spread_load(self):
        """Set a uniform pressure in all admissible cells."""
        self.plastic[...] = False
        np.copyto(self.contact, self.admissible)
        super().spread_load()

    def _pressure_of(self, carried):
        return np.where(self.plastic, self.bounds.upper, carried)

    def _add_hardness(self, p):
        np.add(p, self.bounds.upper, out=p, where=self.plastic, casting="same_kind")

    def _subtract_hardness(self, p):
        np.subtract(p, self.bounds.upper, out=p, where=self.plastic, casting="same_kind")


def _feasible(loading, distance):
    """Return a loading that a coarse grid can carry.

    The loading is reduced if the largest load is smaller on the coarse grid.
    """
    largest = distance.bounds.largest_load
    if loading.load is not None:
        possible = loading.load < (1 - full_plasticity.LOAD_ROUNDING) * largest
        return loading if possible else prescribed_load.PrescribedLoad((1 - 0.5 / distance.patch.n) * largest)
    if loading.depth_on(distance) <= distance.max_depth:
        return loading
    return PrescribedApproach(distance.approach_at(distance.max_depth), distance.max_depth)


def _fill(gap, upper, total, comm):
    """Return the gap up to which cells must be plastic for a load.

    Cells become plastic in the order of their gaps, until they carry more than `total`. Return the gap g of the last
    one (the largest gap if all cells carry less), and `total` minus the pressures of the cells with gaps below g. `gap`
    [mm] is infinite in cells that cannot carry pressure, `upper` is the hardness, `total` the sum of pressures [N/mm2].
    Collective over `comm`.
    """
    inside = gap < np.inf
    gap, upper, carried = gap[inside], upper[inside], 0.0
    _, (low, high) = sums_and_minima(comm, [], [gap.min(initial=np.inf), -gap.max(initial=-np.inf)])
    high = -high
    while low < high:
        middle = min(low + (high - low) / 2, np.nextafter(high, -np.inf))
        below = gap <= middle
        nearest = gap[~below].min(initial=np.inf), -gap[below].max(initial=-np.inf)
        (more,), (above, last) = sums_and_minima(comm, [upper[below].sum()], nearest)
        if carried + more > total:
            high = -last
        else:
            carried, low, below = carried + more, above, ~below
        gap, upper = gap[below], upper[below]
    return float(low), total - carried
