"""The grids of one problem, from the coarsest to the target, with their operators and transfers.

Operators are rediscretised on every grid (no Galerkin products). All ranks share the target grid. Small grids are on
fewer ranks (`app.parallel.rank_groups.RankGroups`), and one that can be solved directly is on one.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from app.base.errors import InputError, call_collectively
from app.base.memory import check_host_memory, doubles_in_strips, doubles_per_cell
from app.base.mpi import MPI
from app.base.petsc import collect_garbage
from app.halfspace.grid import plan_grids
from app.halfspace.operator import InfluenceOperator, petsc_comm
from app.multigrid.transfer import Transfer
from app.parallel.rank_groups import RankGroups
from app.problems.problem import evaluate_shape

_TELLING = 0.08, 0.37, 0.79  # of the rows: those by which ranks compare their problems
MAX_DIRECT_CELLS = 1024  # cells of a grid whose matrix may be stored and factorised
_SMALLEST_WINDOWED = 64 * 64  # cells; on smaller grids it does not pay to leave any out


def check_room(comm, grid, settings):
    """Refuse a target grid for which some host has not the memory; nothing is allocated. Collective.

    Parameters
    ----------
    comm : mpi4py communicator
    grid : Grid
    settings : app.options.method.Settings

    Raises
    ------
    InputError
    """
    ranks = RankGroups(comm, settings.cells_per_rank)
    grids = plan_grids(grid, settings.coarsest)
    # What grids that all ranks share take is counted with the target's cells.
    few = [ranks.slabs(g).local * g.nx for g in grids[1:] if ranks.count_for(g) < comm.size]
    cells = ranks.slabs(grid, comm.size).local * grid.nx + sum(few)
    doubles = cells * doubles_per_cell(settings, grid.periodic) + doubles_in_strips(grid)
    check_host_memory(ranks.comm, grid, doubles)


def _check_same_on_all(comm, problem):
    """Refuse a problem that is another one on every rank, as with random numbers without a seed. Collective.

    The answer would be that of a patchwork. Some rows tell, none of them in the middle, each cell by a weight of its
    own, lest turned or shifted rows sum to the same; processors may round differently.
    """
    if comm.size == 1:
        return
    weights = np.random.default_rng(0).uniform(0.5, 1.5, problem.grid.nx)
    rows = sorted({int(share * problem.grid.ny) for share in _TELLING})

    def sums(row):
        values = evaluate_shape(problem, problem.grid, slice(row, row + 1))[0]
        known = ~np.isnan(values)
        values, of_known = values[known], weights[known]
        slack = 1e-6 * np.ptp(values) + 1e-12 * np.abs(values).max() if values.size else 0.0
        return of_known.sum(), of_known @ values, values.size * slack

    of_ranks = comm.allgather(call_collectively(comm, lambda: [sums(row) for row in rows]))
    for row, told in zip(rows, zip(*of_ranks, strict=True), strict=True):
        if any(where != told[0][0] or abs(total - told[0][1]) > told[0][2] for where, total, _ in told):
            raise InputError(
                f"problem {problem.name}: undeformed distances in row {row} are not the same on all ranks; needed: all "
                "of an array on every rank, random numbers with a seed"
            )


def _make_coarser(target, grids, sizes, ranks):
    """Make the operators of coarser grids, the finest first, each on so many ranks. Collective."""
    dtype, finest = target.dtype, target.target
    target.coarser_levels = tuple(
        InfluenceOperator(grid, target.compliance, *ranks.distribute(grid, size), dtype, target=finest)
        for grid, size in zip(grids, sizes, strict=True)
    )
    for number, operator in enumerate(target.coarser_levels):
        operator.mask[...] = False  # nothing is in contact yet
        operator.coarser_levels = target.coarser_levels[number + 1 :]


def coarser_levels(operator):
    """Return the operators of all coarser grids, the finest first. Collective when they are made.

    An operator that belongs to no hierarchy keeps those that are made here, on all of its ranks, or on one if small.
    """
    if operator.coarser_levels is None:
        grids, size = plan_grids(operator.grid)[1:], operator.slabs.size
        ranks = RankGroups(MPI.COMM_SELF if operator.comm is None else operator.comm, 1)
        _make_coarser(operator, grids, [1 if grid.n <= MAX_DIRECT_CELLS else size for grid in grids], ranks)
    return operator.coarser_levels


def transfers_between(operators, comm):
    """Make the transfers between levels, coarsest first: the first is None. Not collective.

    Parameters
    ----------
    operators : list of InfluenceOperator
        Coarsest first.
    comm : mpi4py communicator or None
        Of all ranks that have rows of the finest grid; None: one rank has all.
    """
    transfers = [None]
    for coarse, fine in pairwise(operators):
        factors = tuple(1 + (n > m) for n, m in zip(fine.grid.shape, coarse.grid.shape, strict=True))
        transfers.append(Transfer(fine, coarse, factors, comm))
    return transfers


class Hierarchy:
    """Operators ``levels[0]`` (coarsest) to ``levels[-1]`` (target), ``transfers[l]`` from level l to l-1.

    Parameters
    ----------
    grid : Grid
        Target grid.
    compliance : float
        (1 - nu) / (pi G) [mm2/N].
    comm : mpi4py communicator
    coarsest : int
        Directions of at most this many cells are not halved.
    cells_per_rank : int
        Least number of cells of a rank that shares a coarser grid or a window.
    target_only : bool
        Only the target grid is needed.
    dtype : numpy real type
        Precision of the products; float32 has a double precision one beside it on the target grid.
    margin : float
        Larger grids will be worked on in windows around contact, which this share of its extent is added to on all
        sides: products on all of their cells are only made when somebody asks. 0: no windows.
    prefix : str
        Of the options in PETSc's database that its solvers read.
    """

    def __init__(
        self,
        grid,
        compliance,
        comm,
        coarsest=4,
        cells_per_rank=8192,
        target_only=False,
        dtype=float,
        margin=0.0,
        prefix="",
    ):
        self.ranks, self.prefix = RankGroups(comm, cells_per_rank), prefix
        self.comm, self.compliance, self.dtype, self.margin = self.ranks.comm, compliance, dtype, margin
        self._in_windows, self._counted = 0.0, WeakKeyDictionary()  # products; those of each operator so far
        _, *grids = plan_grids(grid, coarsest, target_only)
        sizes = [*map(self.ranks.count_for, grids)]
        if grids and grids[-1].n <= MAX_DIRECT_CELLS:
            sizes[-1] = 1
        target = InfluenceOperator(grid, compliance, *self.ranks.distribute(grid, self.ranks.size), dtype)
        target.mask[...] = False
        _make_coarser(target, grids, sizes, self.ranks)
        self.levels = [*target.coarser_levels[::-1], target]
        self.transfers = transfers_between(self.levels, self.comm)
        self.slabs = self.levels[-1].slabs
        self.target.prepare("exact_product")
        for level in self.levels:
            if not self.may_be_windowed(level):
                level.prepare("product")

    @property
    def petsc_comm(self):
        """PETSc communicator of all ranks. Not collective."""
        return petsc_comm(self.comm)

    def gains_ranks(self, operator, number):
        """Whether ranks without a part in an operator have one in a level, as all have if it may be windowed.

        Not collective.
        """
        level = self.levels[number]
        return operator.slabs.size < (self.comm.size if self.may_be_windowed(level) else level.slabs.size)

    @property
    def target(self):
        """Operator of the target grid."""
        return self.levels[-1]

    def may_be_windowed(self, operator):
        """Whether a level is worked on in a window, if that leaves enough cells out. Not collective."""
        return self.margin > 0 and not operator.grid.periodic and operator.grid.n > _SMALLEST_WINDOWED

    def share(self, operator):
        """Cells of a level as a share of the target grid's. Not collective."""
        return operator.grid.n / self.target.grid.n

    def shapes(self, problem):
        """Undeformed distance of the problem on every level, coarsest first. Collective.

        A function is evaluated afresh on every grid; samples are averaged.

        Raises
        ------
        InputError
            If it is no such thing.
        """
        asked = self.levels[-1:] if problem.sampled else self.levels
        shapes = call_collectively(
            self.comm, lambda: [evaluate_shape(problem, level.grid, level.slabs.rows) for level in asked]
        )
        _check_same_on_all(self.comm, problem)
        for transfer in self.transfers[:0:-1] if problem.sampled else ():
            shapes.insert(0, transfer.restrict_shape(shapes[0]))
        return shapes

    @cached_property
    def finest_unwindowed(self):
        """Number of the largest level that is always worked on as a whole."""
        whole = [number for number, level in enumerate(self.levels) if not self.may_be_windowed(level)]
        return max(whole, default=0)

    def coarse_minimum(self, shapes):
        """Least undeformed distance of the target grid in each cell of the finest whole grid. Collective.

        Returns
        -------
        ndarray or None
            NaN where contact is impossible in all of a cell; None if the target grid has no window.
        """
        if not self.may_be_windowed(self.target):
            return None
        lowest = shapes[-1]
        for transfer in self.transfers[: self.finest_unwindowed : -1]:
            lowest = transfer.restrict_minimum(lowest)
        return lowest

    def operator_applications(self):
        """Honest count: products and sweeps on all grids, as products on the target grid. Not collective."""
        return self._in_windows + sum(self.share(level) * level.equivalent_products for level in self.levels)

    def count_window(self, operator):
        """Add what was computed in a window, and below it, since this was last called for it. Not collective."""
        for level in (operator, *(operator.coarser_levels or ())):
            products = level.equivalent_products
            self._in_windows += self.share(level) * (products - self._counted.get(level, 0.0))
            self._counted[level] = products

    def collect_garbage(self):
        """Free what an interrupted solve has left on the grids. Collective."""
        for comm in [self.petsc_comm, *(level.petsc_comm for level in self.levels if level.active)]:
            collect_garbage(comm)

    def destroy(self):
        """Free its products, and the communicators made for it. Collective."""
        for level in self.levels:
            level.free()
        self.ranks.destroy()
