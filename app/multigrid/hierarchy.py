"""The grids of a problem, with operators and transfers.

Operators are rediscretised on every grid (no Galerkin products). A grid with its operator is a *level*; level 0 is the
coarsest. All ranks share the target grid, the finest. Small grids are on fewer ranks
(`app.parallel.rank_groups.RankGroups`). A coarsest grid that is solved directly is on one rank.
"""

from functools import cached_property
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from app.base.errors import InputError, call_collectively
from app.base.memory import (
    HARDNESS,
    LISTS,
    PERIODIC_LISTS,
    WHOLE_SHAPE,
    check_host_memory,
    doubles_in_strips,
    doubles_per_cell,
)
from app.base.mpi import MPI
from app.base.petsc import collect_garbage
from app.halfspace.grid import plan_grids
from app.halfspace.operator import InfluenceOperator, petsc_comm
from app.multigrid.transfer import Transfer
from app.parallel.rank_groups import RankGroups
from app.problems.arrays import check_hardness
from app.problems.problem import evaluate_shape

_COMPARED_ROWS = 0.08, 0.37, 0.79  # positions of the rows that ranks compare, over the number of rows
MAX_DIRECT_CELLS = 1024  # largest number of cells of a grid whose matrix is stored and factorised
_MIN_WINDOWED_CELLS = 64 * 64  # number of cells of a grid up to which windows save no time


def check_memory(comm, problem, grid, settings, lists=False):
    """Raise if a host lacks memory for a problem's target grid. Collective.

    Parameters
    ----------
    lists : bool
        Whether grids may be solved on lists of cells. If these fit, only their memory is checked.

    Returns
    -------
    lists : bool
        Whether they fit.
    more : float
        Number of doubles that this rank needs in addition for solves on all cells.
    """
    ranks = RankGroups(comm, settings.cells_per_rank)
    grids = plan_grids(grid, settings.coarsest)
    # The memory per target cell includes that of coarser grids which all ranks share.
    coarse = [ranks.slabs(g).local * g.nx for g in grids[1:] if ranks.count_for(g) < comm.size]
    cells = ranks.slabs(grid, comm.size).local * grid.nx + sum(coarse)
    parts = problem.hardness is not None, not problem.material.is_half_space, problem.compliance is not None
    per_cell = doubles_per_cell(settings, grid.doubly_periodic, *parts)
    doubles = cells * per_cell + doubles_in_strips(grid)
    if lists:
        own = LISTS + WHOLE_SHAPE * (not problem.by_rows) + HARDNESS * (problem.hardness is not None)
        on_each = PERIODIC_LISTS * bool(grid.periodic)  # each rank has all influence coefficients
        first = cells * own + on_each * grid.n
        try:
            check_host_memory(ranks.comm, grid, first)
            return True, max(doubles - first, 0.0)
        except InputError:
            if own + on_each * comm.size < per_cell:
                raise
    check_host_memory(ranks.comm, grid, doubles)
    return False, 0.0


def _check_equal_on_ranks(comm, problem):
    """Raise InputError if the problem differs between ranks. Collective.

    Random numbers without a seed make a problem differ, for example. The ranks compare weighted sums of some rows, up
    to rounding. Each cell has another weight, so that mirrored or shifted rows differ.
    """
    if comm.size == 1:
        return
    weights = np.random.default_rng(0).uniform(0.5, 1.5, problem.grid.nx)
    rows = sorted({int(share * problem.grid.ny) for share in _COMPARED_ROWS})

    def sums(row):
        values = evaluate_shape(problem, problem.grid, slice(row, row + 1))[0]
        admissible = ~np.isnan(values)
        values, weight = values[admissible], weights[admissible]
        slack = 1e-6 * np.ptp(values) + 1e-12 * np.abs(values).max() if values.size else 0.0
        return weight.sum(), weight @ values, values.size * slack

    by_rank = comm.allgather(call_collectively(comm, lambda: [sums(row) for row in rows]))
    for row, row_sums in zip(rows, zip(*by_rank, strict=True), strict=True):
        cells, total, slack = row_sums[0]
        if any(other != cells or abs(value - total) > slack for other, value, _ in row_sums):
            advice = "arrays must be whole on every rank, and random numbers must have a seed"
            where = f"undeformed distances in row {row} are not the same on all ranks"
            raise InputError(f"problem {problem.name}: {where}; {advice}")


def _make_coarser(target, grids, sizes, ranks):
    """Make coarser operators on `grids`, finest first, shared by `sizes` ranks. Collective."""
    dtype, finest = target.dtype, target.target
    target.coarser_levels = tuple(
        InfluenceOperator(grid, target.kernel, *ranks.distribute(grid, size), dtype, target=finest)
        for grid, size in zip(grids, sizes, strict=True)
    )
    for number, operator in enumerate(target.coarser_levels):
        operator.mask[...] = False
        operator.coarser_levels = target.coarser_levels[number + 1 :]


def get_coarser_levels(operator):
    """Return the operators of coarser grids, finest first. Collective.

    If `operator` has no hierarchy, new operators are made and stored in it. The new operators are on all ranks of
    `operator`, or on one rank if their grid is small.
    """
    if operator.coarser_levels is None:
        grids, size = plan_grids(operator.grid)[1:], operator.slabs.size
        ranks = RankGroups(MPI.COMM_SELF if operator.comm is None else operator.comm, 1)
        _make_coarser(operator, grids, [1 if grid.n <= MAX_DIRECT_CELLS else size for grid in grids], ranks)
    return operator.coarser_levels


def make_transfers(operators, comm):
    """Return, for each level, the `Transfer` from the next coarser level.

    The entry of the coarsest level is None. `comm` has all ranks with rows of the finest grid; `comm` is None if only
    one rank has rows.
    """
    transfers = [None]
    for coarse, fine in pairwise(operators):
        factors = tuple(1 + (n > m) for n, m in zip(fine.grid.shape, coarse.grid.shape, strict=True))
        transfers.append(Transfer(fine, coarse, factors, comm))
    return transfers


class Hierarchy:
    """Operators of all levels, and transfers between them.

    ``transfers[l]`` is between levels l and l - 1.

    Parameters
    ----------
    grid : Grid
        Target grid.
    kernel : Kernel
        Kernel of the bodies, ``Problem.kernel``.
    comm : mpi4py communicator
        All ranks of the solver.
    coarsest : int
        A direction with at most this many cells is not coarsened.
    cells_per_rank : int
        Smallest number of cells per rank on a coarser grid or window that several ranks share.
    target_only : bool
        Make no coarser grids.
    dtype : numpy real type
        Precision of the products. With float32 the target grid also has a double precision product.
    margin : float
        Margin of the windows (parts of large grids around the contact), divided by the extent of the contact; 0: no
        windows. On grids with windows, products on all cells are prepared only when first used.
    prefix : str
        Prefix of the solvers' options in PETSc's database.
    lists : bool
        True if the target grid may need no product on all its cells: then it is created when first used.
    compliance : ndarray, shape (ny, nx), optional
        `InfluenceOperator.compliance` of the target grid; coarser grids average it.
    more_doubles : float
        Number of doubles of this rank for solves on all cells, which are checked before.
    """

    def __init__(
        self, grid, kernel, comm, coarsest=4, cells_per_rank=8192, target_only=False, dtype=float,
        margin=0.0, prefix="", lists=False, compliance=None, more_doubles=0.0,
    ):  # fmt: skip
        self._more_doubles = more_doubles
        self.ranks, self.prefix, self.lists = RankGroups(comm, cells_per_rank), prefix, lists
        self.comm, self.kernel, self.dtype, self.margin = self.ranks.comm, kernel, dtype, margin
        # products in windows, and those of each operator counted so far
        self._in_windows, self._counted = 0.0, WeakKeyDictionary()
        _, *grids = plan_grids(grid, coarsest, target_only)
        sizes = [*map(self.ranks.count_for, grids)]
        if grids and grids[-1].n <= MAX_DIRECT_CELLS:
            sizes[-1] = 1
        target = InfluenceOperator(grid, kernel, *self.ranks.distribute(grid, self.ranks.size), dtype)
        target.mask[...] = False
        _make_coarser(target, grids, sizes, self.ranks)
        self.levels = [*target.coarser_levels[::-1], target]
        self.transfers = make_transfers(self.levels, self.comm)
        self.slabs = self.levels[-1].slabs
        if compliance is not None:
            self.target.compliance = np.array(compliance[self.slabs.rows], order="C")
            for coarse, fine, transfer in zip(
                self.levels[-2::-1], self.levels[::-1], self.transfers[:0:-1], strict=False
            ):
                coarse.compliance = transfer.restrict_shape(fine.compliance)
        if not lists:
            self.prepare_target()
        for level in self.levels:
            if not (self.may_be_windowed(level) or (lists and level.grid.doubly_periodic)):
                level.prepare("product")

    @property
    def petsc_comm(self):
        """PETSc communicator of all ranks of the hierarchy."""
        return petsc_comm(self.comm)

    def gains_ranks(self, operator, number):
        """Return whether level `number` has more ranks than `operator`."""
        level = self.levels[number]
        return operator.slabs.size < (self.comm.size if self.may_be_windowed(level) else level.slabs.size)

    @property
    def target(self):
        """Operator of the target grid."""
        return self.levels[-1]

    def prepare_target(self):
        """Make the product on all cells of the target grid; InputError if memory lacks. Collective."""
        if self._more_doubles:
            check_host_memory(
                self.comm, self.target.grid, self._more_doubles, "more for contact of many cells "
            )
        self._more_doubles = 0.0
        self.target.prepare("exact_product")

    def may_be_windowed(self, operator):
        """Return whether the level of `operator` may be solved in a window."""
        return self.margin > 0 and not operator.grid.doubly_periodic and operator.grid.n > _MIN_WINDOWED_CELLS

    def share(self, operator):
        """Return an operator's number of cells, divided by the target grid's."""
        return operator.grid.n / self.target.grid.n

    def shapes(self, problem):
        """Return each level's undeformed distance, coarsest first. Collective.

        A gap that is a function is evaluated on every grid. A gap that is an array is averaged over the cells of
        coarser grids. Raises InputError if the undeformed distance has invalid values, or differs between ranks.
        """
        levels = self.levels[-1:] if problem.sampled else self.levels
        grids = [(level.grid, level.slabs.rows) for level in levels]
        shapes = call_collectively(self.comm, lambda: [evaluate_shape(problem, *grid) for grid in grids])
        _check_equal_on_ranks(self.comm, problem)
        for transfer in self.transfers[:0:-1] if problem.sampled else ():
            shapes.insert(0, transfer.restrict_shape(shapes[0]))
        return shapes

    def hardness(self, hardness):
        """Return a hardness on all levels, coarsest first, or None. Collective.

        Arrays are averaged, so that a cell is elastic if one of its children is.
        """
        hardness = check_hardness(hardness, self.target.grid)
        if hardness is None:
            return None
        if np.ndim(hardness) == 0:
            return [np.full(level.local_shape, float(hardness)) for level in self.levels]
        fields = [np.array(hardness[self.slabs.rows], order="C")]
        for transfer in self.transfers[:0:-1]:
            elastic = np.isinf(fields[0])  # apart, because children may have no weight
            mean = transfer.restrict_shape(np.where(elastic, 0.0, fields[0]))
            fields.insert(0, np.where(transfer.restrict_shape(elastic.astype(float)) > 0, np.inf, mean))
        return fields

    @cached_property
    def finest_unwindowed(self):
        """Number of the finest level that is never solved in a window."""
        whole = [number for number, level in enumerate(self.levels) if not self.may_be_windowed(level)]
        return max(whole, default=0)

    def coarse_minimum(self, shapes):
        """Return the minimum distance in each cell of a coarse grid. Collective.

        The coarse grid is the finest grid that is solved without a window. Each of its cells gets the minimum of the
        undeformed distance over the cells of the target grid in it, NaN if contact is impossible in all of them. Return
        None if the target grid is not solved in windows.
        """
        if not self.may_be_windowed(self.target):
            return None
        lowest = shapes[-1]
        for transfer in self.transfers[: self.finest_unwindowed : -1]:
            lowest = transfer.restrict_minimum(lowest)
        return lowest

    def operator_applications(self):
        """Return the work on all grids, in products on the target grid."""
        return self._in_windows + sum(self.share(level) * level.equivalent_products for level in self.levels)

    def count_products(self, level, number):
        """Count work on a level, in products on all its cells."""
        self._in_windows += self.share(level) * number

    def count_window(self, operator):
        """Count products of a window and its coarser levels, each once."""
        for level in (operator, *(operator.coarser_levels or ())):
            products = level.equivalent_products
            self._in_windows += self.share(level) * (products - self._counted.get(level, 0.0))
            self._counted[level] = products

    def collect_garbage(self):
        """Free PETSc objects of an interrupted solve. Collective."""
        for comm in [self.petsc_comm, *(level.petsc_comm for level in self.levels if level.active)]:
            collect_garbage(comm)

    def destroy(self):
        """Free the levels' products and the communicators. Collective."""
        for level in self.levels:
            level.free()
        self.ranks.destroy()
