"""Between a grid and the next coarser one (Sec. 4.2): defect, contact set, correction, displacement, shape.

A coarse cell joins 2 x 2 fine ones (2 x 1 or 1 x 2 where the other direction is short already). Each grid has slabs and
ranks of its own: a coarse row is made where its first child is, which may need the next row from the next rank, and
moves to the rank that owns it; fine rows ask for their parents. Where the slabs fit nothing moves.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import njit
from app.base.petsc import restricts_by_transpose
from app.multigrid.interpolation import BESIDE, bilinear, quintics, six_around, two_around
from app.parallel.fetch import Fetch
from app.parallel.reductions import add_masked, add_row, copy_row

_NOTHING = 1e-9  # of a cell: rounding of an overlap


class Transfer:
    """Restriction and prolongation between two operators.

    Parameters
    ----------
    fine, coarse : InfluenceOperator
    factors : (int, int)
        ``(fy, fx)``: fine cells per coarse cell in y and x.
    comm : mpi4py communicator or None
        All ranks of the solver; None: this one alone.
    """

    def __init__(self, fine, coarse, factors, comm=None):
        self.fine, self.coarse, self._comm = fine, coarse, comm
        self.factors = self.fy, self.fx = factors
        self._ranks = 1 if comm is None else comm.size
        self._made = fine.slabs.coarsen(self.fy)  # where coarse rows are made
        self._local = (self._made.local, coarse.grid.nx)

    @cached_property
    def _with_children(self):
        """Fine rows, as far as they are children of the coarse rows made here."""
        first, last = (
            np.minimum(self.fy * rows, self.fine.grid.ny) for rows in self._made.bounds(self._ranks)
        )
        return Fetch(self.fine.slabs, [(first, last)], self._comm)

    @cached_property
    def _overlapping(self):
        """Fine rows that coarse rows made here may overlap on a periodic grid: one more before, and two behind."""
        first, last = self._made.bounds(self._ranks)
        low, high = self.fy * first - 1, self.fy * (last - 1) + 3
        return Fetch(self.fine.slabs, [(low, np.where(last > first, high, low))], self._comm)

    @cached_property
    def _to_owner(self):
        """Coarse rows made somewhere, where they belong."""
        return Fetch(self._made, [self.coarse.slabs.bounds(self._ranks)], self._comm)

    @cached_property
    def _of_parents(self):
        return self._parents(0)

    @cached_property
    def _of_neighbours(self):
        return self._parents(1)

    @cached_property
    def _of_many_neighbours(self):
        return self._parents(BESIDE)

    def _parents(self, beside):
        """Coarse rows that fine rows here have as parents, and so many `beside` them where there are some."""
        first, last = self.fine.slabs.bounds(self._ranks)
        some, end = last > first, self.coarse.grid.ny
        first, last = first // self.fy - beside, -(-last // self.fy) + beside
        if not self.coarse.grid.periodic:
            first, last = np.maximum(first, 0), np.minimum(last, end)
        return Fetch(self.coarse.slabs, [(first, np.where(some, last, first))], self._comm)

    def _children(self, fine):
        """Yield the fine cells with the same place in their coarse cell, and where those are, of all made here.

        Collective: they are from this rank and the next.
        """
        fine = self._with_children(fine)
        for j in range(self.fy):
            for i in range(self.fx):
                view = fine[j :: self.fy, i :: self.fx]
                yield view, (slice(view.shape[0]), slice(view.shape[1]))

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_defect(self, fine):
        """Sec. 4.2, 3, formula 1: four-point average; children that are missing count as zero. Collective."""
        mine = np.zeros(self._local)
        _add_children(self._with_children(fine), mine, self.fy, self.fx)
        mine *= 1.0 / (self.fy * self.fx)
        PETSc.Log.logFlops(fine.size + mine.size)
        return self._to_owner(mine)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_contact(self):
        """Sec. 4.2, 3, formula 2: a coarse cell is in C_H if any of its children is in C_h. Collective."""
        mine = np.zeros(self._local, bool)
        for view, parents in self._children(self.fine.mask):
            mine[parents] |= view
        self.coarse.mask[...] = self._to_owner(mine)

    def restrict_shape(self, shape):
        """Mean of the admissible children, NaN if there are none. Collective.

        Where coarse cells of a periodic grid are shorter than two fine ones, of all that they overlap, by how much: so
        the mean over the patch stays, and with it the approach of full contact.
        """
        if self.fine.grid.periodic and any(
            n % f for n, f in zip(self.fine.grid.shape, self.factors, strict=True)
        ):
            return self._to_owner(self._means_of_overlaps(shape))
        total, count = np.zeros(self._local), np.zeros(self._local)
        for view, parents in self._children(shape):
            known = ~np.isnan(view)
            total[parents] += np.where(known, view, 0.0)
            count[parents] += known
        with np.errstate(invalid="ignore"):
            return self._to_owner(total / count)

    def _means_of_overlaps(self, shape):
        known = ~np.isnan(shape)
        fields = self._overlapping(np.where(known, shape, 0.0)), self._overlapping(known.astype(float))
        (ny, nx), (coarse_ny, coarse_nx) = self.fine.grid.shape, self.coarse.grid.shape
        in_y, in_x = _overlaps(ny, coarse_ny, self.fy)[self._made.rows], _overlaps(nx, coarse_nx, self.fx)
        span = max(self.fy * (len(in_y) - 1) + 1, 0)
        sums = []
        for field in fields:
            rows = sum(in_y[:, k, None] * field[k : k + span : self.fy] for k in range(4))
            columns = (self.fx * np.arange(coarse_nx) - 1 + k for k in range(4))
            sums.append(sum(in_x[:, k] * np.take(rows, at % nx, axis=1) for k, at in enumerate(columns)))
        with np.errstate(invalid="ignore"):
            return np.where(sums[1] > _NOTHING, sums[0] / sums[1], np.nan)

    def restrict_minimum(self, fine):
        """Least of the children, NaN if all are. Collective."""
        mine = np.full(self._local, np.nan)
        for view, parents in self._children(fine):
            np.fmin(mine[parents], view, out=mine[parents])
        return self._to_owner(mine)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def add_copies(self, coarse, fine):
        """Sec. 4.2, 5, formula 3: v_H copied to the children, 0 in E_h; added to p_h. Collective."""
        mine, skipped = self._of_parents(coarse), self.fine.slabs.rows.start % self.fy
        _add_copies(mine, self.fine.mask, fine, skipped, self.fy, self.fx, np.empty(fine.shape[1]))
        PETSc.Log.logFlops(fine.size)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def copy(self, coarse, fine):
        """Sec. 4.3, 2: the "copy" strategy for p: children get the value of their coarse cell. Collective."""
        _copy(self._of_parents(coarse), fine, self.fine.slabs.rows.start % self.fy, self.fy, self.fx)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def interpolate(self, coarse, fine):
        """Sec. 4.3, 2: bilinear interpolation of u; extrapolation at the rim of patch or window. Collective.

        On a periodic grid there is no rim.
        """
        wide = self._of_neighbours(coarse)
        if not fine.size:
            return
        rows, grid, nx = self.fine.slabs.rows, self.coarse.grid, self.fine.grid.nx
        first = rows.start // self.fy - 1  # of the coarse rows fetched
        first = first if grid.periodic else max(first, 0)
        in_y, in_x = self.fine.grid.places_in(grid) if grid.periodic else (None, None)
        of_rows = two_around(rows.start, rows.stop, grid.ny, self.fy, in_y, first)
        of_columns = two_around(0, nx, grid.nx, self.fx, in_x)
        bilinear(wide, fine, *of_rows, *of_columns, self._halved, np.empty(grid.nx))
        PETSc.Log.logFlops(5 * fine.size)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def interpolate_smoothly(self, coarse, fine):
        """Over a period, by quintics through the centres of cells. Collective."""
        wide = self._of_many_neighbours(coarse)
        if not fine.size:
            return
        rows, (in_y, in_x) = self.fine.slabs.rows, self.fine.grid.places_in(self.coarse.grid)
        of_rows = six_around(rows.start, rows.stop, in_y, rows.start // self.fy - BESIDE)
        of_columns = six_around(0, self.fine.grid.nx, in_x, -BESIDE)
        quintics(wide, fine, *of_rows, *of_columns, self._halved, np.empty(coarse.shape[1] + 2 * BESIDE))
        PETSc.Log.logFlops(17 * fine.size)

    @property
    def _halved(self):
        """Whether each coarse column has two fine ones, in the same places."""
        return self.fx == 2 and not (self.coarse.grid.periodic and self.fine.grid.nx % 2)

    # -- as PETSc's matrices -----------------------------------------------------------------------------

    def restriction_mat(self, comm):
        """Mat of the masked restriction: coarse x fine, or its transpose if PETSc multiplies by that. Collective."""
        sides = (self.fine, self.coarse) if restricts_by_transpose() else (self.coarse, self.fine)
        return _transfer_mat(_Restriction(self), *sides, comm)

    def interpolation_mat(self, comm):
        """Mat (fine x coarse) of the masked copy prolongation. Collective."""
        return _transfer_mat(_Prolongation(self), self.fine, self.coarse, comm)


def _overlaps(n, count, factor):
    """By how much of each fine cell a coarse one of a period overlaps the four from one before its first child on."""
    first, size = factor * np.arange(count), n / count
    low = size * np.arange(count) + 0.5 * (n % factor)  # see `Grid.coarsen`
    cell = first[:, None] + np.arange(-1, 3)
    return np.clip(np.minimum(low[:, None] + size, cell + 1) - np.maximum(low[:, None], cell), 0.0, None)


@njit()
def _add_pairs(of, to):
    for i in range(np.uint64(of.size // 2)):
        k = np.uint64(2) * i
        to[i] += of[k]
        to[i] += of[k + np.uint64(1)]
    if of.size % 2:
        to[-1] += of[-1]


@njit()
def _add_children(fine, coarse, fy, fx):
    """Add fine cells, the first row of which is a first child, to their coarse ones."""
    for j in range(fine.shape[0]):
        if fx == 2:
            _add_pairs(fine[j], coarse[j // fy])
        else:
            add_row(coarse[j // fy], 1.0, fine[j])


@njit()
def _copy_row(of, fine, fx):
    if fx == 1:
        copy_row(of, fine)
        return
    for i in range(np.uint64(fine.size // 2)):
        k = np.uint64(2) * i
        fine[k] = fine[k + np.uint64(1)] = of[i]
    if fine.size % 2:
        fine[-1] = of[-1]


@njit()
def _copy(coarse, fine, skipped, fy, fx):
    """Copy coarse cells to their children; the first fine row is child number `skipped`."""
    for j in range(fine.shape[0]):
        _copy_row(coarse[(skipped + j) // fy], fine[j], fx)


@njit()
def _add_copies(coarse, mask, fine, skipped, fy, fx, row):
    """Add coarse cells to their children, where there is a mask. `row`: room for one."""
    for j in range(fine.shape[0]):
        _copy_row(coarse[(skipped + j) // fy], row, fx)
        add_masked(row, mask[j], fine[j])


def _transfer_mat(context, rows, columns, comm):
    def size(operator):
        return operator.local_shape[0] * operator.local_shape[1], PETSc.DETERMINE

    mat = PETSc.Mat().createPython((size(rows), size(columns)), context, comm=comm)
    mat.setUp()
    return mat


class _Restriction:
    """Sec. 4.2, 2 and 3: d_h, zero in E_h, averaged to d_H, zero in E_H."""

    def __init__(self, transfer):
        self.transfer = transfer

    def mult(self, mat, x, y):
        t = self.transfer
        defect = x.getArray(readonly=True).reshape(t.fine.local_shape) * t.fine.mask
        y.setArray((t.restrict_defect(defect) * t.coarse.mask).reshape(-1))

    multTranspose = mult


class _Prolongation:
    """Sec. 4.2, 5: v_H copied, zero in E_h."""

    def __init__(self, transfer):
        self.transfer = transfer

    def mult(self, mat, x, y):
        y.set(0)
        self.multAdd(mat, x, y, y)

    def multAdd(self, mat, x, v, y):
        """Sec. 4.2, 6: p_h + v_h."""
        t = self.transfer
        if v.handle != y.handle:
            v.copy(y)
        with y as fine:
            coarse = x.getArray(readonly=True).reshape(t.coarse.local_shape)
            t.add_copies(coarse, fine.reshape(t.fine.local_shape))
