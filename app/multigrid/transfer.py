"""Restriction to the next coarser grid, and prolongation (Sec. 4.2, 4.3).

A coarse cell, the parent, consists of 2 x 2 fine cells, its children (2 x 1 or 1 x 2 if the other direction is not
halved). Each grid has its own slabs and ranks. The rank that owns the first child of a coarse row computes this coarse
row, perhaps with the next rank's first row, and sends it to its owner. For prolongation, ranks fetch the parents of
their rows. If a coarse row is on the same rank as its children, no rows are sent.
"""

from functools import cached_property

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import njit
from app.base.petsc import restricts_by_transpose
from app.multigrid.interpolation import (
    QUINTIC_MARGIN,
    bilinear_weights,
    interpolate_bilinear,
    interpolate_quintic,
    quintic_weights,
)
from app.parallel.fetch import Fetch
from app.parallel.reductions import add_masked, add_row, copy_row

_OVERLAP_ROUNDING = 1e-9  # least overlap above rounding, over a cell


class Transfer:
    """Restriction and prolongation between the grids of two operators.

    Parameters
    ----------
    fine, coarse : InfluenceOperator
        Operators of the two grids.
    factors : (int, int)
        ``(fy, fx)``: fine cells per coarse cell in y and x.
    comm : mpi4py communicator or None
        All ranks of the solver; None if there is only one.
    """

    def __init__(self, fine, coarse, factors, comm=None):
        self.fine, self.coarse, self._comm = fine, coarse, comm
        self.factors = self.fy, self.fx = factors
        self._ranks = 1 if comm is None else comm.size
        self._made = fine.slabs.coarsen(self.fy)  # coarse rows computed by each rank
        self._local = (self._made.local, coarse.grid.nx)

    @cached_property
    def _fetch_children(self):
        """`Fetch` of the children of the coarse rows that this rank computes."""
        bounds = self.fy * np.array(self._made.bounds(self._ranks))
        return Fetch(self.fine.slabs, [np.minimum(bounds, self.fine.grid.ny)], self._comm)

    @cached_property
    def _fetch_overlapping(self):
        """`Fetch` of fine rows overlapping this rank's coarse rows."""
        first, last = self._made.bounds(self._ranks)
        low, high = self.fy * first - 1, self.fy * (last - 1) + 3
        return Fetch(self.fine.slabs, [(low, np.where(last > first, high, low))], self._comm)

    @cached_property
    def _send_to_owner(self):
        """`Fetch` that brings computed coarse rows to their owners."""
        return Fetch(self._made, [self.coarse.slabs.bounds(self._ranks)], self._comm)

    _fetch_parents = cached_property(lambda self: self._make_parent_fetch(0))
    _fetch_neighbours = cached_property(lambda self: self._make_parent_fetch(1))
    _fetch_quintic_neighbours = cached_property(lambda self: self._make_parent_fetch(QUINTIC_MARGIN))

    @cached_property
    def _places(self):
        """`Grid.places_in` the coarse grid, in y and x; None where the patch does not repeat."""
        places = zip(self.fine.grid.places_in(self.coarse.grid), self.fine.grid.repeats, strict=True)
        return [place if repeats else None for place, repeats in places]

    def _make_parent_fetch(self, margin):
        """Make the `Fetch` of parent rows, with `margin` more at each end."""
        first, last = self.fine.slabs.bounds(self._ranks)
        some, end = last > first, self.coarse.grid.ny
        first, last = first // self.fy - margin, -(-last // self.fy) + margin
        if not self.coarse.grid.repeats[0]:
            first, last = np.maximum(first, 0), np.minimum(last, end)
        return Fetch(self.coarse.slabs, [(first, np.where(some, last, first))], self._comm)

    def _children(self, fine):
        """Yield the first, second, ... child of all coarse cells. Collective.

        Each item is a view of the fine field, and the index of those coarse cells that have this child.
        """
        fine = self._fetch_children(fine)
        for j in range(self.fy):
            for i in range(self.fx):
                view = fine[j :: self.fy, i :: self.fx]
                yield view, (slice(view.shape[0]), slice(view.shape[1]))

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_defect(self, fine):
        """Return coarse cells' means over children; missing children are zero. Collective."""
        coarse = np.zeros(self._local)
        _add_children(self._fetch_children(fine), coarse, self.fy, self.fx)
        coarse *= 1.0 / (self.fy * self.fx)  # Sec. 4.2, 3, formula 1
        PETSc.Log.logFlops(fine.size + coarse.size)
        return self._send_to_owner(coarse)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def restrict_contact(self):
        """Set the coarse contact set C_H from the fine one C_h. Collective.

        A coarse cell is in C_H if it has a child in C_h. The sets are the masks of the two operators.
        """
        contact = np.zeros(self._local, bool)
        for child, parents in self._children(self.fine.mask):
            contact[parents] |= child  # Sec. 4.2, 3, formula 2
        self.coarse.mask[...] = self._send_to_owner(contact)

    def restrict_shape(self, shape):
        """Return each coarse cell's mean undeformed distance. Collective.

        The mean is over the admissible fine cells, where contact is possible; NaN if there are none. If the patch
        repeats in a direction with an odd number of cells, coarse cells are shorter than two fine cells. Then the mean
        is over all fine cells that overlap the coarse cell, weighted by the overlap. This preserves the mean over the
        patch, and so the approach of full contact.
        """
        grid = self.fine.grid
        if any(r and n % f for r, n, f in zip(grid.repeats, grid.shape, self.factors, strict=True)):
            return self._send_to_owner(self._means_of_overlaps(shape))
        coarse, fine = np.empty(self._local), self._fetch_children(shape)
        _mean_of_children(fine, coarse, self.fy, self.fx, np.zeros((2, coarse.shape[1])))
        return self._send_to_owner(coarse)

    def _means_of_overlaps(self, shape):
        admissible = ~np.isnan(shape)
        fetch = self._fetch_overlapping
        fields = fetch(np.where(admissible, shape, 0.0)), fetch(admissible.astype(float))
        (ny, nx), (coarse_ny, coarse_nx) = self.fine.grid.shape, self.coarse.grid.shape
        repeats_y, repeats_x = self.fine.grid.repeats
        in_y = _overlaps(ny, coarse_ny, self.fy, repeats_y)[self._made.rows]
        in_x = _overlaps(nx, coarse_nx, self.fx, repeats_x)
        span = max(self.fy * (len(in_y) - 1) + 1, 0)
        sums = []
        for field in fields:
            rows = sum(in_y[:, k, None] * field[k : k + span : self.fy] for k in range(4))
            columns = (self.fx * np.arange(coarse_nx) - 1 + k for k in range(4))
            sums.append(sum(in_x[:, k] * np.take(rows, at % nx, axis=1) for k, at in enumerate(columns)))
        with np.errstate(invalid="ignore"):
            return np.where(sums[1] > _OVERLAP_ROUNDING, sums[0] / sums[1], np.nan)

    def restrict_minimum(self, fine):
        """Return coarse cells' minima over children that are not NaN. Collective."""
        coarse = np.full(self._local, np.inf)
        _least_of_children(self._fetch_children(fine), coarse, self.fy, self.fx)
        coarse[coarse == np.inf] = np.nan
        return self._send_to_owner(coarse)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def add_copies(self, coarse, fine):
        """Add coarse values to children in the fine contact set C_h. Collective."""
        parents, skipped = self._fetch_parents(coarse), self.fine.slabs.rows.start % self.fy
        row = np.empty(fine.shape[1])
        _add_copies(parents, self.fine.mask, fine, skipped, self.fy, self.fx, row)  # Sec. 4.2, 5, formula 3
        PETSc.Log.logFlops(fine.size)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def copy(self, coarse, fine):
        """Copy coarse cells' values to their children. Collective."""
        _copy(self._fetch_parents(coarse), fine, self.fine.slabs.rows.start % self.fy, self.fy, self.fx)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def interpolate(self, coarse, fine):
        """Interpolate a coarse field bilinearly; extrapolate at boundaries. Collective."""
        wide = self._fetch_neighbours(coarse)
        if not fine.size:
            return
        rows, grid, nx = self.fine.slabs.rows, self.coarse.grid, self.fine.grid.nx
        first = rows.start // self.fy - 1  # coarse row that is fetched
        in_y, in_x = self._places
        first = first if in_y else max(first, 0)
        of_rows = bilinear_weights(rows.start, rows.stop, grid.ny, self.fy, in_y, first)
        of_columns = bilinear_weights(0, nx, grid.nx, self.fx, in_x)
        interpolate_bilinear(wide, fine, *of_rows, *of_columns, self._halved, np.empty(grid.nx))
        PETSc.Log.logFlops(5 * fine.size)

    @PETSc.Log.EventDecorator("ContactTransfer")
    def interpolate_quintic(self, coarse, fine):
        """Interpolate a coarse periodic field by quintic polynomials. Collective."""
        wide = self._fetch_quintic_neighbours(coarse)
        if not fine.size:
            return
        rows, (in_y, in_x) = self.fine.slabs.rows, self.fine.grid.places_in(self.coarse.grid)
        of_rows = quintic_weights(rows.start, rows.stop, in_y, rows.start // self.fy - QUINTIC_MARGIN)
        of_columns = quintic_weights(0, self.fine.grid.nx, in_x, -QUINTIC_MARGIN)
        row = np.empty(coarse.shape[1] + 2 * QUINTIC_MARGIN)
        interpolate_quintic(wide, fine, *of_rows, *of_columns, self._halved, row)
        PETSc.Log.logFlops(17 * fine.size)

    @property
    def _halved(self):
        """True if each coarse column has two fine columns."""
        return self.fx == 2 and not (self.coarse.grid.repeats[1] and self.fine.grid.nx % 2)

    def restriction_mat(self, comm):
        """Make the Mat of the restriction. Collective.

        The Mat has the transposed size (fine x coarse) if this release of PETSc restricts by a transposed product.
        """
        sides = (self.fine, self.coarse) if restricts_by_transpose() else (self.coarse, self.fine)
        return _transfer_mat(_Restriction(self), *sides, comm)

    def interpolation_mat(self, comm):
        """Make a `_Prolongation`'s Mat (fine x coarse). Collective."""
        return _transfer_mat(_Prolongation(self), self.fine, self.coarse, comm)


def _overlaps(n, count, factor, repeats):
    """Return the overlap of coarse cells with four fine cells each.

    `n` and `count` are the numbers of fine and coarse cells along one axis; `repeats` is true if the patch repeats
    along it. The first of the four is the fine cell before the coarse cell's first child. Lengths are in fine cells.
    """
    first = factor * np.arange(count)
    cell = first[:, None] + np.arange(-1, 3)
    if not repeats:
        return ((cell >= first[:, None]) & (cell < np.minimum(first + factor, n)[:, None])).astype(float)
    size = n / count
    low = size * np.arange(count) + 0.5 * (n % factor)  # see `Grid.coarsen`
    return np.clip(np.minimum(low[:, None] + size, cell + 1) - np.maximum(low[:, None], cell), 0.0, None)


@njit()
def _add_pairs(fine, coarse):
    for i in range(np.uint64(fine.size // 2)):
        k = np.uint64(2) * i
        coarse[i] += fine[k]
        coarse[i] += fine[k + np.uint64(1)]
    if fine.size % 2:
        coarse[-1] += fine[-1]


@njit()
def _add_children(fine, coarse, fy, fx):
    """Add the values of fine cells to the values of the parents."""
    for j in range(fine.shape[0]):
        if fx == 2:
            _add_pairs(fine[j], coarse[j // fy])
        else:
            add_row(coarse[j // fy], 1.0, fine[j])


@njit()
def _mean_of_children(fine, coarse, fy, fx, sums):
    """Store the means over children that are not NaN; `sums` is a work array of two coarse rows."""
    total, count = sums
    for j in range(coarse.shape[0]):
        total[:] = count[:] = 0
        for row in fine[fy * j : fy * (j + 1)]:
            for k in range(fx):
                for i in range(np.uint64((row.size - k + fx - 1) // fx)):
                    value = row[np.uint64(fx) * i + np.uint64(k)]
                    total[i] += value if value == value else 0.0
                    count[i] += 1.0 if value == value else 0.0
        for i in range(count.size):
            coarse[j, i] = total[i] / count[i] if count[i] else np.nan


@njit()
def _least_of_children(fine, coarse, fy, fx):
    for j in range(fine.shape[0]):
        row, out = fine[j], coarse[j // fy]
        for k in range(fx):
            for i in range(np.uint64((row.size - k + fx - 1) // fx)):
                value = row[np.uint64(fx) * i + np.uint64(k)]
                out[i] = value if value < out[i] else out[i]


@njit()
def _copy_row(coarse, fine, fx):
    if fx == 1:
        copy_row(coarse, fine)
        return
    for i in range(np.uint64(fine.size // 2)):
        k = np.uint64(2) * i
        fine[k] = fine[k + np.uint64(1)] = coarse[i]
    if fine.size % 2:
        fine[-1] = coarse[-1]


@njit()
def _copy(coarse, fine, skipped, fy, fx):
    """Copy coarse cells' values to their children.

    `skipped` is the number of children of the first coarse row that come before the first row of `fine`.
    """
    for j in range(fine.shape[0]):
        _copy_row(coarse[(skipped + j) // fy], fine[j], fx)


@njit()
def _add_copies(coarse, mask, fine, skipped, fy, fx, row):
    """Add copies inside a mask, as `_copy`; `row` is a work row."""
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
    """Mat context of the restriction between contact sets.

    The result is the mean over the children of each cell of the coarse set, and zero elsewhere. Children outside the
    fine set count as zero.
    """

    def __init__(self, transfer):
        self.transfer = transfer

    def mult(self, mat, x, y):
        t = self.transfer
        defect = x.getArray(readonly=True).reshape(t.fine.local_shape) * t.fine.mask
        y.setArray((t.restrict_defect(defect) * t.coarse.mask).reshape(-1))

    multTranspose = mult


class _Prolongation:
    """Mat context of the prolongation: copies to children in contact, zero elsewhere."""

    def __init__(self, transfer):
        self.transfer = transfer

    def mult(self, mat, x, y):
        y.set(0)
        self.multAdd(mat, x, y, y)

    def multAdd(self, mat, x, v, y):
        """Compute y = v + P x, with the prolongation P."""
        t = self.transfer
        if v.handle != y.handle:
            v.copy(y)
        with y as fine:
            coarse = x.getArray(readonly=True).reshape(t.coarse.local_shape)
            t.add_copies(coarse, fine.reshape(t.fine.local_shape))  # Sec. 4.2, 6
