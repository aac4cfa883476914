"""Dilute contact: fine grids are solved on lists of cells.

If few cells are in contact, the work can follow these cells instead of the grid. Coarse grids are solved as always. On
each finer grid the unknowns are a list: the children of cells in contact and of their neighbours, and all other cells
that penetrate, without inadmissible ones. The steps of `app.methods.free.iteration` work on the list as on a grid of
one row, with these parts:

- *Product.* `app.halfspace.list_product` computes u in the listed cells, with a proved bound of its error, which the
  certificate includes; on periodic patches `app.halfspace.periodic_list_product`.
- *Preconditioner.* The inverse of A continued periodically, cut off at some cells (`app.methods.free.list_solver`).
- *Exclusion.* `app.contact.exclusion` proves that most cells outside the list cannot penetrate. In the others u is
  computed. Cells that penetrate join the list, and the grid is solved again; on the target grid until there are none.

Nothing else has the size of the grid. The displacement of all cells is computed from the list when it is first used. If
the list is too long, or the iteration fails, the grids are solved as without lists.

*Start.* The target grid alone is solved if there is a solution to start from: its contact is the first list.

*Ranks.* Rank 0 solves on lists, as on any small grid. All ranks look for cells that penetrate, each in its rows. All of
them get the pressures, so each can compute its displacements alone.
"""

import copy
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from app.base.petsc import synchronized
from app.contact.certificate import Certificate, adopt, estimate
from app.contact.exclusion import BLOCK, BlockBounds
from app.contact.grid_errors import GridNumbers, compute_grid_numbers
from app.contact.history import Outcome
from app.contact.state import ContactState
from app.halfspace.cell_list import CellList
from app.halfspace.kernel import HalfSpaceKernel
from app.halfspace.layered_kernel import LayeredKernel
from app.halfspace.list_product import MAX_SLOWER, uniform_displacement
from app.halfspace.periodic_list_product import PeriodicListProduct, displacement_on_rows
from app.methods.free.iteration import inexact_active_set
from app.methods.free.list_solver import CountedProduct, ListOperator, ListSolver, ListState
from app.methods.progress import NeedsSafeguard
from app.parallel.communicator import propagate_errors
from app.parallel.reductions import sum_over
from app.parallel.slabs import none_if_single

MIN_CELLS = 1 << 20  # number of cells from which grids may be solved on lists
MAX_COST = 0.2  # largest cost of a product from contact to contact, over that of a product on all cells
MAX_COST_PERIODIC = (
    0.1  # the same on patches periodic in x and y, whose product on all cells needs no padding
)
MAX_GROWN_COST = 0.4  # the same if all penetrating cells come into contact
MAX_CHECK_COST = 1.0  # the same of the product that shows which cells penetrate
MAX_SHARE = 0.02  # largest share of cells for which costs are estimated
MAX_SEARCH = 10.0  # depths beyond first touch up to which a number is searched, over the first depth
MAX_ROUNDS = 5  # solves of the target grid, after each of which penetrating cells join the list


class ListsFail(Exception):
    """Raised if a list is too long, or the iteration on it fails."""


class ListSolution(NamedTuple):
    """Solution on a list of cells, on all ranks."""

    cells: np.ndarray  # sorted indices of the cells
    p: np.ndarray  # [N/mm2]
    u: np.ndarray  # [mm]
    contact: np.ndarray  # cells in C
    in_contact: np.ndarray  # cells in C, and plastic cells
    depth: float  # [mm]
    numbers: GridNumbers
    certificate: Certificate
    outcome: Outcome

    @property
    def loaded(self):
        """Indices of the cells in contact, and their pressures [N/mm2]."""
        return self.cells[self.in_contact], self.p[self.in_contact]


class ExpandedState(ContactState):
    """Contact state on all cells of a grid, from a ListSolution.

    The displacement `u` is computed when it is first used, by this rank alone. `product` is the CountedProduct of the
    grid.
    """

    def __init__(self, level, distance, solution, product):
        super().__init__(level, distance)
        own = _own_cells(solution.cells, level)
        self._cells = solution.cells[own] - level.slabs.rows.start * level.grid.nx
        self._listed_u, self._product = solution.u[own], product
        self.values.reshape(-1)[self._cells] = solution.p[own]
        self.contact.reshape(-1)[self._cells] = solution.contact[own]
        self.depth = solution.depth
        del self.u
        rows = level.slabs.rows
        self._displacement = partial(displacement_on_rows, level.grid, level.kernel, *solution.loaded, rows)
        adopt(self, solution.certificate)

    @cached_property
    def u(self):
        """Displacement A p of the local cells [mm], by a product between lists."""
        return self._displacement()

    def deformation(self):
        """Return a function that computes u; see `ContactState.deformation`."""
        return synchronized(lambda: self.u)

    def total_gap(self):
        """Return this rank's part of the sum of the gap over all admissible cells [mm], without their displacement.

        By symmetry, the sum of A p is that of p times the displacement by unit pressure on these cells. The part of
        holes is a product between lists, if that is cheaper than one on all cells.
        """
        grid, statistics = self.grid, self.distance.statistics
        whole = statistics.cells == grid.n
        if grid.one_way or (not whole and (self.comm or grid.doubly_periodic)):
            return super().total_gap()  # a rank does not know the others' holes
        of_this_rank = self.comm is None or self.comm.rank == 0
        undeformed = statistics.cells * (statistics.mean - self.depth) if of_this_rank else 0.0
        if grid.doubly_periodic:  # A p has no mean
            return undeformed
        listed = CellList(grid, self._cells + self.operator.slabs.rows.start * grid.nx)
        uniform = uniform_displacement(self.operator.kernel, listed)
        if not whole:
            holes = CellList(grid, ~self.admissible)
            if self._product.cost(holes, listed) > 1:
                return super().total_gap()
            uniform -= self._product.apply(holes, np.ones(len(holes)), listed)
        return undeformed + uniform @ self.p.reshape(-1)[self._cells]

    def total_overlap(self, cells):
        """Return the sum of max(-e, 0) over some cells in contact, without the displacement of all."""
        gap = self._listed_u - (self.distance.b.reshape(-1)[self._cells] + self.depth)
        return float(np.maximum(-gap, 0.0).sum(where=cells.reshape(-1)[self._cells]))


class DiluteContact:
    """Solver of fine grids on lists of cells; it caches what depends on the grids. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    """

    def __init__(self, hierarchy):
        self._hierarchy, self._comm = hierarchy, hierarchy.comm
        self._products, self._blocks = {}, {}

    @staticmethod
    def suits(grid, kernel):
        """Return whether lists are possible on a grid: for half-spaces and layered bodies."""
        if grid.n < MIN_CELLS:
            return False
        usual = type(kernel.base if grid.periodic else kernel) in (HalfSpaceKernel, LayeredKernel)
        if not (usual and grid.periodic):
            return usual
        sides = zip(grid.shape, grid.repeats, strict=True)
        whole_blocks = all(n % BLOCK == 0 for n, repeats in sides if repeats)
        return whole_blocks and PeriodicListProduct.suits(grid, kernel)

    def use_distances(self, distances):
        """Set the undeformed distances of all levels."""
        self._distances = distances
        self._blocks.clear()

    def suit(self, number, loading):
        """Return whether lists are possible from level `number` on.

        They are unless the loading finds a tilt.
        """
        if loading.tilts:
            return False
        distance, kernel = self._distances[number], self._hierarchy.kernel
        capped = distance.bounds.capped and distance.patch.doubly_periodic
        return not capped and self.suits(distance.patch, kernel)

    def solve(self, first, coarse, loading, stop, history, grids):
        """Solve level `first` and all finer ones.

        Parameters
        ----------
        coarse : (ndarray, ndarray)
            This rank's cells in contact of the next coarser grid, and their pressures [N/mm2].
        loading, stop, history, grids
            See `app.methods.free.nested.nested_iteration`; `grids` is the GridSequence.

        Returns
        -------
        ContactState, float, GridNumbers
            State on the target grid, difference of the pressures of the last two grids, and numbers of the state. None
            if lists are more expensive than all cells, or if they fail.
        """
        coarse = [self._join(values) for values in coarse]
        if not self._are_cheaper(first, coarse[0]):
            return None
        grids.share(self._comm)
        depth, loading, numbers = grids.depth, copy.deepcopy(loading), []  # as before, if lists fail
        last = len(self._hierarchy.levels) - 1
        for number in range(first, last + 1):
            test = stop if number == last else stop.for_coarse_grid()
            try:
                cells = _refine(*coarse, self._hierarchy.levels[number].grid)
                found = self._solve_level(number, cells, loading.predict(depth), loading, test, history)
            except ListsFail:
                self._products.clear()
                return None
            before, coarse, depth = coarse, found.loaded, found.depth
            loading.record(depth)
            numbers.append(found.numbers)
        target, distance = self._hierarchy.target, self._distances[-1]
        state = ExpandedState(target, distance, found, self._products[last])
        grids.grid_numbers += numbers[:-1]
        grids.record(found.outcome, depth, distance.tilt)
        fine, before = _restrict(*coarse, before, target.grid)
        largest = max(np.linalg.norm(fine), np.linalg.norm(before))
        difference = (
            float(np.linalg.norm(fine - before) / largest) if (fine != before).any() else float("nan")
        )
        return state, difference, numbers[-1]

    def loaded_cells(self, start):
        """Return contact cells and pressures of a checked Solution `start`, on all ranks; None if lists do not pay.

        There are no cells if the start has no contact.
        """
        own = np.flatnonzero(start.contact)
        cells = self._join(own + start.slabs.rows.start * start.grid.nx)
        parents = np.unique(_parents(cells, start.grid))
        if cells.size and not self._are_cheaper(len(self._hierarchy.levels) - 1, parents):
            return None
        return cells, self._join(start.pressure.reshape(-1)[own])

    def resume(self, cells, p, load, loading, stop, history):
        """Solve the target grid from the cells and pressures of a solution with a `load`.

        Returns
        -------
        ContactState, Outcome
            State, and how the solve ended. None if it failed.
        """
        number, loading = len(self._hierarchy.levels) - 1, copy.deepcopy(loading)
        level, distance = self._hierarchy.target, self._distances[-1]
        cells, p = self._leave_holes_out(number, *_insert(cells, p, _widen(cells, level.grid)))
        listed, depth = self._listed(number, cells), None
        with propagate_errors(self._comm if self._comm.size > 1 else None):
            if self._comm.rank == 0:
                p, depth = self._predict(number, cells, listed, p, loading, load)
        try:
            p, depth = self._comm.bcast_or_raise((p, depth))
            found = self._solve_level(number, (cells, p), depth, loading, stop, history, copied=False)
        except ListsFail:
            self._products.clear()
            return None
        return ExpandedState(level, distance, found, self._products[number]), found.outcome

    def _predict(self, number, cells, listed, p, loading, load):
        """Return pressures and depth of a loading, from those of a solution with a `load`.

        The pressures are scaled as if the load grew with the power 3/2 of the depth beyond first touch.
        """
        level, distance = self._hierarchy.levels[number], self._distances[number]
        operator = ListOperator(level, self._products[number], cells)
        state = ListState(operator, distance, *listed, p, distance.touching)
        state.compute_displacement()
        before = state.on_contact().mean
        loading.resume(state, load)
        beyond, depth = state.depth - distance.touching, state.depth
        state.destroy()
        return state.p[0] * ((beyond / before) ** 1.5 if min(beyond, before) > 0 else 1.0), depth

    def _are_cheaper(self, number, cells):
        """Return whether lists are cheaper than all cells, given the coarser grid's contact `cells`.

        The cost of a product decides. The work on all cells is shared by all ranks, that on lists is not.
        """
        level, product = self._hierarchy.levels[number], self._products.get(number)
        grid, least = level.grid, np.inf
        most = (MAX_COST_PERIODIC if grid.doubly_periodic else MAX_COST) / self._comm.size
        if cells.size <= MAX_SHARE * grid.n:
            children = CellList(grid, _children(cells, grid))
            least = CountedProduct.least_cost(level, children)
        if least >= most:
            self._products.clear()  # the memory is for all cells
            return False
        if product and product.cost(children, children) > MAX_SLOWER * least:
            self._products.clear()  # of a much larger or smaller load
        return self._product(number, children).cost(children, children) < most

    def _product(self, number, cells):
        if number not in self._products:
            self._products[number] = CountedProduct(self._hierarchy, number, cells)
        return self._products[number]

    def _solve_level(self, number, listed, depth, loading, stop, history, copied=True):
        """Return the `ListSolution` of a level; ListsFail if there is none.

        `listed` are cells and their pressures, `copied` from a coarser grid or not.
        """
        level, distance, comm = self._hierarchy.levels[number], self._distances[number], self._comm
        cells, p = self._leave_holes_out(number, *listed)
        new, iterations = self._penetrating(number, cells, p, depth), 0
        for _ in range(MAX_ROUNDS if stop.final else 1):
            if not cells.size + new.size:  # no contact: the cell of first touch
                nearest = distance.admissible & (distance.b == -distance.touching)
                new = self._join(np.flatnonzero(nearest) + level.slabs.rows.start * level.grid.nx)
            may_touch = CellList(level.grid, np.union1d(cells[p != 0], new))
            if self._products[number].cost(may_touch, may_touch) > MAX_GROWN_COST:
                raise ListsFail
            cells, p = self._leave_holes_out(number, *_insert(cells, p, _widen(new, level.grid)))
            listed, found = self._listed(number, cells), None
            with propagate_errors(comm if comm.size > 1 else None):
                if comm.rank == 0:
                    copied &= not iterations
                    start = p, depth, iterations
                    found = self._solve_list(number, cells, listed, start, copied, loading, stop, history)
            found = comm.bcast_or_raise(found)
            if found is None:
                break
            p, depth, iterations = found.p, found.depth, iterations + found.outcome.iterations
            if not stop.final or not (new := self._penetrating(number, cells, p, depth)).size:
                return found._replace(outcome=found.outcome._replace(iterations=iterations))
        raise ListsFail

    def _leave_holes_out(self, number, cells, p):
        """Return a list of cells without inadmissible ones, and its pressures."""
        distance = self._distances[number]
        if distance.statistics.cells == distance.patch.n:
            return cells, p
        admissible = self._gather(self._hierarchy.levels[number], distance.admissible, cells)
        return cells[admissible], p[admissible]

    def _listed(self, number, cells):
        """Return -h at depth 0 [mm] and hardness [N/mm2], or None, in some cells, on all ranks."""
        level, distance = self._hierarchy.levels[number], self._distances[number]
        return [self._gather(level, field, cells) for field in (distance.b, distance.bounds.upper)]

    def _gather(self, level, field, cells):
        """Return the values of a field, (local rows, nx), in cells of all ranks; None without a field."""
        if field is None:
            return None
        own = cells[_own_cells(cells, level)] - level.slabs.rows.start * level.grid.nx
        return self._join(field.reshape(-1)[own])

    def _solve_list(self, number, cells, listed, start, copied, loading, stop, history):
        """Solve on a list, from pressure, depth and number of iterations at the `start`; None if this fails.

        `listed` has -h at depth 0 [mm], and the hardness [N/mm2] or None. If `copied`, the pressures are copies from a
        coarser grid.
        """
        level, product = self._hierarchy.levels[number], self._products[number]
        state = ListState(ListOperator(level, product, cells), self._distances[number], *listed, *start)
        solver = ListSolver(self._hierarchy, number, state.operator)
        try:
            if copied:
                state.lift()
            if loading.searches:  # on a short list a number may have a limit
                distance = state.distance
                beyond = max(state.depth - distance.touching, distance.deviation)
                distance.max_depth = distance.touching + MAX_SEARCH * beyond
            solve = partial(inexact_active_set, state, solver, stop=stop, history=history)
            outcome = loading.next_solve(state, solve)
            if not (outcome.converged or (loading.searches and not stop.final)):
                return None
            certificate = estimate(state, stop.settings.error_bound) if stop.final else None
            numbers = compute_grid_numbers(state, None)
            fields = state.p[0], state.u[0], state.contact[0], state.in_contact()[0]
            return ListSolution(cells, *fields, state.depth, numbers, certificate, outcome)
        except NeedsSafeguard:
            return None
        finally:
            solver.destroy()
            state.destroy()

    def _penetrating(self, number, cells, p, depth):
        """Return the cells outside a list that penetrate, or may do so by the error of a product."""
        level, distance, loaded = self._hierarchy.levels[number], self._distances[number], p != 0
        sources, p = CellList(level.grid, cells[loaded]), p[loaded]
        product, key = self._product(number, sources), (number, distance.tilt)
        if key not in self._blocks:
            self._blocks = {(n, tilt): bounds for (n, tilt), bounds in self._blocks.items() if n != number}
            fields, first = (distance.b, distance.admissible), level.slabs.rows.start
            comm, quadrant = none_if_single(self._comm), product.quadrant
            self._blocks[key] = BlockBounds(level.grid, level.kernel, *fields, first, comm, quadrant)
        blocks = self._blocks[key]
        others = np.setdiff1d(blocks.undecided(sources.cells, p, depth), cells, assume_unique=True)
        targets = CellList(level.grid, others)
        self._hierarchy.count_products(level, blocks.points / level.product_points)
        count, cost = sum_over(self._comm, [others.size, product.cost(sources, targets)])
        if count > MAX_SHARE * level.grid.n or cost > MAX_CHECK_COST * self._comm.size:
            raise ListsFail
        u = product.apply(sources, p, targets) - product.error_bound * p.sum()
        own = others - level.slabs.rows.start * level.grid.nx
        return self._join(others[u < distance.b.reshape(-1)[own] + depth])

    def _join(self, values):
        """Return the values of all ranks, one rank after the other."""
        return np.concatenate(self._comm.allgather(values))


def _own_cells(cells, level):
    """Return the slice of sorted cells that are in this rank's rows."""
    rows, nx = level.slabs.rows, level.grid.nx
    return slice(*np.searchsorted(cells, [rows.start * nx, rows.stop * nx]))


def _children(cells, grid):
    """Return the cells of a grid in coarser `cells`."""
    rows, columns = np.divmod(cells, -(-grid.nx // 2))
    fine = [(2 * rows + j, 2 * columns + i) for j in (0, 1) for i in (0, 1)]
    return np.sort(np.concatenate([(y * grid.nx + x)[(y < grid.ny) & (x < grid.nx)] for y, x in fine]))


def _parents(cells, grid):
    """Return the coarser cells of a grid's cells."""
    rows, columns = np.divmod(cells, grid.nx)
    return rows // 2 * -(-grid.nx // 2) + columns // 2


def _widen(cells, grid):
    """Return cells and their neighbours on a grid, sorted."""
    rows, columns = (
        [places % n if repeats else np.clip(places, 0, n - 1) for places in (index - 1, index, index + 1)]
        for index, n, repeats in zip(np.divmod(cells, grid.nx), grid.shape, grid.repeats, strict=True)
    )
    return np.unique(np.concatenate([y * grid.nx + x for y in rows for x in columns]))


def _insert(cells, p, more):
    """Return a list with more cells, which have no pressure."""
    both = np.union1d(cells, more)
    pressures = np.zeros(both.size)
    pressures[np.searchsorted(both, cells)] = p
    return both, pressures


def _refine(cells, p, grid):
    """Return a grid's cells in coarser `cells` and their neighbours, and copied pressures."""
    wide, copied = _insert(cells, p, _widen(cells, grid.coarsen(1)))
    fine = _children(wide, grid)
    return fine, copied[np.searchsorted(wide, _parents(fine, grid))]


def _restrict(cells, p, coarse, grid):
    """Return the pressures of a grid's cells and of a coarser list, on the same coarse cells."""
    parents = _parents(cells, grid)
    both, whole = _insert(*coarse, np.unique(parents))
    return np.bincount(np.searchsorted(both, parents), p, both.size) / 4, whole
