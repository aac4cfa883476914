"""Between a grid and the next coarser one (Sec. 4.2): defect, contact set, correction, displacement, shape.

A coarse cell joins 2 x 2 fine ones (2 x 1 or 1 x 2 where the other direction is short already). Slabs are cut so
that its children are on one rank: only a coarse level that is replicated on all ranks, and the rows beside a
slab in `interpolate`, need communication.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.compiled import njit
from app.petsc import restricts_by_transpose

_FIRST, _LAST = 1, 2  # tags: which row of a slab


class Transfer:
    """Restriction and prolongation between two operators.

    Parameters
    ----------
    fine, coarse : InfluenceOperator
    factors : (int, int)
        ``(fy, fx)``: fine cells per coarse cell in y and x.
    """

    def __init__(self, fine, coarse, factors):
        self.fine, self.coarse = fine, coarse
        self.factors = self.fy, self.fx = factors
        self.gathers = fine.comm is not None and coarse.comm is None
        slabs = fine.slabs.coarsen(self.fy)
        self.rows = slabs.rows if self.gathers else slice(0, coarse.local_shape[0])
        if self.gathers:
            counts = np.array(slabs.counts) * coarse.grid.nx
            self._parts = counts, np.concatenate([[0], np.cumsum(counts)[:-1]])
        self._local = (self.rows.stop - self.rows.start, coarse.grid.nx)

    def _children(self, fine):
        """Yield the fine cells with the same place in their coarse cell, as (view, rows, columns)."""
        for j in range(self.fy):
            for i in range(self.fx):
                view = fine[j :: self.fy, i :: self.fx]
                yield view, slice(view.shape[0]), slice(view.shape[1])

    def _complete(self, mine, dtype):
        """Coarse field from the coarse rows made here: the others' rows too if the level is replicated."""
        if not self.gathers:
            return mine
        everything = np.empty(self.coarse.local_shape, dtype)
        self.fine.comm.Allgatherv(mine, [everything, self._parts])
        return everything

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_defect(self, fine):
        """Sec. 4.2, 3, formula 1: four-point average; children outside the patch count as zero. Collective."""
        mine = np.zeros(self._local)
        for view, rows, columns in self._children(fine):
            mine[rows, columns] += view
        mine *= 1.0 / (self.fy * self.fx)
        return self._complete(mine, float)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_contact(self):
        """Sec. 4.2, 3, formula 2: a coarse cell is in C_H if any of its children is in C_h. Collective."""
        mine = np.zeros(self._local, bool)
        for view, rows, columns in self._children(self.fine.mask):
            mine[rows, columns] |= view
        self.coarse.mask[...] = self._complete(mine, bool)

    def restrict_shape(self, shape):
        """Mean of the admissible children, NaN if there are none. Collective."""
        total, count = np.zeros(self._local), np.zeros(self._local)
        for view, rows, columns in self._children(shape):
            known = ~np.isnan(view)
            total[rows, columns] += np.where(known, view, 0.0)
            count[rows, columns] += known
        with np.errstate(invalid="ignore"):
            return self._complete(total / count, float)

    def restrict_minimum(self, fine):
        """Least of the children, NaN if all are. Collective."""
        mine = np.full(self._local, np.nan)
        for view, rows, columns in self._children(fine):
            here = mine[rows, columns]
            np.fmin(here, view, out=here)
        return self._complete(mine, float)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def add_copies(self, coarse, fine):
        """Sec. 4.2, 5, formula 3, and 6: v_H copied to the children, 0 in E_h; p_h + v_h. Not collective."""
        mine = coarse[self.rows]
        for (view, rows, columns), (mask, _, _) in zip(
            self._children(fine), self._children(self.fine.mask), strict=True
        ):
            np.add(view, mine[rows, columns], out=view, where=mask)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def copy(self, coarse, fine):
        """Sec. 4.3, 2: the "copy" strategy for p: children get the value of their coarse cell. Not collective."""
        mine = coarse[self.rows]
        for view, rows, columns in self._children(fine):
            view[...] = mine[rows, columns]

    @PETSc.Log.EventDecorator("ContactTransfer")
    def interpolate(self, coarse, fine):
        """Sec. 4.3, 2: bilinear interpolation of u; extrapolation at the rim of patch or window. Collective.

        On a periodic grid there is no rim.
        """
        wide, first = self._with_neighbours(coarse)
        rows = self.fine.slabs.rows
        self._interpolate(wide, fine, rows, first)

    def _with_neighbours(self, coarse):
        """Return the coarse rows here, one more on either side where there is one, and the number of the first."""
        slabs, periodic = self.fine.slabs.coarsen(self.fy), bool(self.coarse.grid.periodic)
        rows = slabs.rows
        first = rows.start - 1 if periodic else max(rows.start - 1, 0)
        if self.coarse.comm is None:
            if periodic:
                return coarse[np.arange(first, rows.stop + 1) % len(coarse)], first
            return coarse[first : rows.stop + 1], first
        comm = self.coarse.comm
        if not slabs.local:
            return coarse, first
        before, after = slabs.neighbours(periodic)
        above, below = np.empty((2, 1, coarse.shape[1]))
        # At the rim nobody is there. Around a period both neighbours may be the same rank, or this one.
        requests = [comm.Irecv(above, before, _LAST), comm.Irecv(below, after, _FIRST)]
        requests += [
            comm.Isend(coarse[:1].copy(), before, _FIRST),
            comm.Isend(coarse[-1:].copy(), after, _LAST),
        ]
        for request in requests:
            request.Wait()
        return np.vstack([above[before < 0 :], coarse, below[after < 0 :]]), first

    def _interpolate(self, coarse, fine, rows, first):
        """Interpolate to global fine rows `rows` from coarse rows that start at global row `first`."""
        if not fine.size:
            return
        grid = self.coarse.grid
        a, b, weight = _neighbours(np.arange(rows.start, rows.stop), grid.ny, self.fy, grid.periodic)
        c, d, weight_x = _neighbours(np.arange(self.fine.grid.nx), grid.nx, self.fx, grid.periodic)
        d %= grid.nx
        _bilinear(coarse, fine, a - first, b - first, weight, c, d, weight_x)

    # -- as PETSc's matrices -----------------------------------------------------------------------------

    def restriction_mat(self, comm):
        """Mat of the masked restriction: coarse x fine, or its transpose if PETSc multiplies by that. Collective."""
        sides = (self.fine, self.coarse) if restricts_by_transpose() else (self.coarse, self.fine)
        return _transfer_mat(_Restriction(self), *sides, comm)

    def interpolation_mat(self, comm):
        """Mat (fine x coarse) of the masked copy prolongation. Collective."""
        return _transfer_mat(_Prolongation(self), self.fine, self.coarse, comm)


@njit()
def _bilinear(coarse, fine, a, b, weight_y, c, d, weight_x):
    """fine[j, i] from the four coarse cells in rows a, b and columns c, d."""
    row = np.empty(coarse.shape[1])
    for j in range(fine.shape[0]):
        w = weight_y[j]
        for i in range(coarse.shape[1]):
            row[i] = w * coarse[a[j], i] + (1 - w) * coarse[b[j], i]
        for i in range(fine.shape[1]):
            fine[j, i] = weight_x[i] * row[c[i]] + (1 - weight_x[i]) * row[d[i]]


def warm_up():
    """Load the compiled loop now, not in the first iteration. Not collective."""
    field, cells, weights = np.zeros((0, 0)), np.zeros(0, int), np.zeros(0)
    _bilinear(field, field, cells, cells, weights, cells, cells, weights)


def _neighbours(index, count, factor, periodic):
    """Coarse cells around fine cells, and the weight of the first: 3/4 for the parent, 1/4 for the next one.

    At the rim the two cells are the parent and the one inside, with weights 5/4 and -1/4. Over a period the next one
    may be number -1 or `count`.
    """
    parent = index // factor
    if factor == 1 or count == 1:
        return parent, parent, np.ones(len(index))
    towards = np.where(index % 2, 1, -1)
    other = parent + towards
    if periodic:
        return parent, other, np.full(len(index), 0.75)
    inside = (other >= 0) & (other < count)
    other = np.where(inside, other, parent - towards)
    return parent, other, np.where(inside, 0.75, 1.25)


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
    """Sec. 4.2, 5 and 6: v_H copied, zero in E_h, and added."""

    def __init__(self, transfer):
        self.transfer = transfer

    def mult(self, mat, x, y):
        y.set(0)
        self.multAdd(mat, x, y, y)

    def multAdd(self, mat, x, v, y):
        t = self.transfer
        if v.handle != y.handle:
            v.copy(y)
        with y as fine:
            coarse = x.getArray(readonly=True).reshape(t.coarse.local_shape)
            t.add_copies(coarse, fine.reshape(t.fine.local_shape))
