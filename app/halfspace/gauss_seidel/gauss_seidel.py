"""Exact lexicographic Gauss-Seidel sweeps for C A C p = b.

A sweep costs as much as one or two products with A. A damped sweep solves ``(D / omega + L_C) d = r`` on the contact
set C, then ``p += d``. D is the diagonal of A, and r the defect, zero outside C. L is the strictly lower part of A in
row-major order; L_C is L with zero rows and columns outside C. Cell by cell the work would be O(n^2) for n cells. But L
is Toeplitz, so forward substitution is a convolution in which the input becomes known cell by cell. Such a *causal*
(on-line) convolution can be computed in blocks:

- *Rows in x-Fourier space.* A solved row is transformed in x, padded to ``Nx >= 2 nx - 1``. For each of the
  ``F = Nx/2 + 1`` frequencies, the effect of the row on later rows is a convolution in y, with one real number for each
  lag (distance in rows). The transform back gives the right-hand side of the next row.
- *Leaves.* A leaf is a block of 64 rows, or 32 rows on several ranks. Rows act directly on rows of their own leaf and
  of the next leaf.
- *Transfers.* A transfer is the effect of leaves on leaves further away. When m leaves are solved, let 2^k be the
  largest power of two that divides m. Then the last 2^k leaves act, by an FFT in y, on the 2^k leaves after the next
  leaf. So every pair of leaves that are not neighbours is treated exactly once. A transfer is computed while the next
  leaf is solved, because that leaf does not need it.
- *Reach.* The effect of a wave of length l in x decays as ``exp(-2 pi |y| / l)``, so most frequencies matter for the
  next few rows only. This holds if the kernel is smooth over its period in x. The padding of the kernel, at offsets
  above nx-1, does not affect the result. The padding joins the kernel smoothly to its mirror image. Frequencies are
  treated in chunks; transfers beyond the reach of a chunk omit it.
- *In a row* each contact cell acts on the contact cells after it. Scalar products with the solved cells give the
  right-hand sides of four contact cells at a time. Long rows are cut into segments, and solved segments act on later
  ones as leaves do. If contact has no holes in a row, the row is multiplied by the inverse of the triangular matrix,
  which is also a convolution.
- *Columns* without contact at the left and right are omitted.

Up to round-off the result equals the result of the scalar double loop, for any contact set. The work is O(n log^2 n);
rows and leaves without contact cost nothing. A backward sweep is a forward sweep on arrays flipped in both directions,
because the kernel is even.

`app.halfspace.gauss_seidel.pipeline` explains sweeps on several ranks.
"""

import numpy as np

from app.halfspace.fft.lengths import transform_length
from app.halfspace.gauss_seidel.loops import LANES, TILE, find_contact_extent, solve_leaf, transfer
from app.halfspace.gauss_seidel.pipeline import SweepMessages
from app.halfspace.gauss_seidel.tables import SEGMENT_COLUMNS, SweepTables
from app.parallel.slabs import Slabs, none_if_single

_COLUMN_MARGIN = 0.1  # share of the columns in contact that is added to them, because contact may grow
_MAX_COLUMN_SHARE = 0.85  # share of all columns above which all columns are swept over


class GaussSeidel:
    """Exact lexicographic Gauss-Seidel sweeps for the influence matrix of a grid.

    The tables of `SweepTables` are made in the first sweep, and again when the contact set has become wider.

    The function ``quadrant_rows(slice, columns)`` returns a few rows of the influence coefficients ``K[|dy|, |dx|]``,
    at offsets dx up to about 1.5 nx. A `periodic` kernel has the periods nx and ny. Without `slabs` and `comm` this
    rank has all rows. The attributes `defect` and `correction` are work arrays for the caller of `sweep`, shape (local
    rows, nx).
    """

    def __init__(self, quadrant_rows, grid_shape, slabs=None, comm=None, periodic=False):
        self.shape = ny, nx = grid_shape
        self.slabs = slabs or Slabs(ny)
        self.comm = none_if_single(comm)
        self._quadrant_rows, self._periodic, self._tables = quadrant_rows, periodic, None
        self._diagonal = float(quadrant_rows(slice(0, 1), 1)[0, 0])
        self._solves = self.comm is None or comm.rank == 0
        self._width = 0  # columns to sweep over
        self._flops = self._sweeps = 0
        self.defect, self.correction = (np.zeros((self.slabs.local, nx)) for _ in range(2))

    def reset(self):
        """Make sweeps independent of earlier sweeps, in rounding, too.

        Earlier sweeps determine the number of columns, which determines the lengths of the FFTs.
        """
        self._width = 0

    @property
    def products_per_sweep(self):
        """Mean work of past sweeps, in products with A.

        The operations are counted by a model: 2.5 N log2 N for a real transform of length N, twice as many for a
        complex transform, and 2 for a multiplication with addition. The count depends only on the contact sets, and on
        whether one rank or several share the grid, because their leaves differ.
        """
        ny, nx = self.shape
        in_x, in_y = transform_length(nx), transform_length(ny)
        product = 2 * ny * _flops(in_x) + (in_x // 2 + 1) * (4 * _flops(in_y) + 2 * in_y)
        return self._flops / max(1, self._sweeps) / product

    def sweep(self, r, mask, omega, d, backward=False):
        """Solve ``(D / omega + L_C) d = r`` on C. Collective.

        D is the diagonal of A, and L_C its strictly lower part on the contact set C, the `mask`. A backward sweep
        begins with the last cell, and has ``L_C^T`` instead of ``L_C``. The output `d` is zero outside C, and the
        defect `r` is ignored there. All arrays have the shape (local rows, nx); otherwise ValueError is raised. With
        `omega` = 1 the sweep is undamped.
        """
        shape = self.slabs.local, self.shape[1]
        if not r.shape == mask.shape == d.shape == shape:
            raise ValueError(f"fields of shapes {r.shape}, {mask.shape}, {d.shape}: all must be {shape}")
        self._sweeps += 1
        mask = mask.astype(bool, copy=False)
        occupied, cells, columns = self._prepare(mask)
        d[:, : columns.start] = d[:, columns.stop :] = 0
        if not cells:
            return
        tables, tiles = self._tables, self._tables.leaf_rows // TILE
        correction, column = d, columns.start
        if backward or self.comm is not None:
            r, mask, correction, column = r[:, columns], mask[:, columns], d[:, columns], 0
        if self.comm is not None:
            r, correction = np.ascontiguousarray(r, float), np.zeros(r.shape)
            mask = self._gather(mask)
        leaves, filled = self._cut_into_leaves(occupied, cells, backward)
        correction[~occupied[self.slabs.rows]] = 0
        messages = self.comm and SweepMessages(self.comm, self.slabs, tables.edges, leaves, r, correction)
        affected = np.zeros(tables.leaves + 1, bool)  # leaves on which transfers have acted
        for m, leaf in enumerate(leaves):
            if not leaf:
                tables.stored[m] = 0
            elif self._solves:
                defect, solution = messages.fields(m) if messages else (r[leaf], correction[leaf])
                both = filled[m * tiles : (m + 2) * tiles]  # tiles of the leaf before and of this leaf
                fields = defect, mask[leaf], solution
                self._solve(m, affected[m], both, *fields, column, omega, backward, messages)
            if not self._solves and tables.stored.size:
                if affected[m + 1] and leaves[m + 1]:
                    messages.send_effects(m + 1, tables.stored[m + 1])
                if leaf:
                    messages.receive_solved(m, tables.stored[m])
            self._transfer(m + 1, leaves, affected)
        if messages:
            messages.finish()
            d[:, columns] = correction

    def _prepare(self, mask):
        """Make tables; return rows with contact, cells, and columns to sweep. Collective."""
        ny, nx = self.shape
        local = np.empty(len(mask) + 3, np.int64)  # rows with contact, columns, cells
        local[-3:] = find_contact_extent(mask, local[:-3])
        if self.comm is None:
            parts = [local]
        else:
            sizes = [count + 3 for count in self.slabs.counts]
            gathered = np.empty(sum(sizes), np.int64)
            self.comm.Allgatherv(local, [gathered, sizes])
            parts = np.split(gathered, np.cumsum(sizes)[:-1])
        first, last, cells = (f(part[k] for part in parts) for f, k in ((min, -3), (max, -2), (sum, -1)))
        width = int(last - first)
        if width > self._width:
            self._width = width + int(_COLUMN_MARGIN * width) + 1
            self._width = nx if self._width > _MAX_COLUMN_SHARE * nx else self._width
        if width > 0 and (self._tables is None or self._width != self._tables.shape[1]):
            period = self._periodic and self._width == nx
            self._tables = None
            self._tables = SweepTables(self._quadrant_rows, (ny, self._width), self.comm, period)
        prepared = self._tables.shape[1] if cells else 0
        start = int(np.clip(first - (prepared - width) // 2, 0, nx - prepared))
        occupied = np.concatenate([part[:-3] for part in parts]).astype(bool)
        return occupied, int(cells), slice(start, start + prepared)

    def _gather(self, mask):
        """Gather the contact set on rank 0. Collective."""
        whole = np.empty((self.shape[0], mask.shape[1]) if self._solves else 0, bool)
        sizes = [count * mask.shape[1] for count in self.slabs.counts]
        self.comm.Gatherv(np.ascontiguousarray(mask), [whole, sizes] if self._solves else None)
        return whole

    def _cut_into_leaves(self, occupied, cells, backward):
        """Cut the grid into leaves, blocks of rows in the sweep's order.

        Return a list and an array. The list has for each leaf the slice of its rows in the grid, or None for a leaf
        without contact. The array marks the tiles (groups of TILE rows) with contact, leaf after leaf. The array begins
        with the tiles of an empty leaf, so that every leaf has a leaf before it.
        """
        ny, rows, number = self.shape[0], self._tables.leaf_rows, self._tables.leaves
        ordered = np.zeros((number + 1) * rows, bool)
        ordered[rows : rows + ny] = occupied[::-1] if backward else occupied
        self._flops += self._rows_flops(cells, ordered)
        leaves, occupied = [], ordered.reshape(-1, rows).any(axis=1)[1:]
        for m in range(number):
            first, last = m * rows, min((m + 1) * rows, ny)
            leaf = slice(ny - last, ny - first) if backward else slice(first, last)
            leaves.append(leaf if occupied[m] else None)
        return leaves, ordered.reshape(-1, TILE).any(axis=1)

    def _solve(self, m, affected, filled, r, mask, d, column, omega, backward, messages):
        """Solve leaf m (a block of rows); send it to other ranks."""
        tables, step, weight = self._tables, -1 if backward else 1, omega / self._diagonal
        block, own = tables.ring[m % 2], slice(*tables.edges[0])
        if affected:
            block[own] = tables.stored[m]
            if messages:
                messages.collect(block)
        tables.invert_triangle(weight)
        fields = [np.ascontiguousarray(field[::step, ::step]) for field in (r, mask, d)]
        kernel = tables.chunks[0] if affected else 0, tables.near, tables.reach
        solve_leaf(tables.ring.view(float), m % 2, *kernel, filled, tables.rows, *fields, column, weight)
        if not np.may_share_memory(d, fields[2]):
            d[...] = fields[2][::step, ::step]
        tables.stored[m] = block[own]
        if messages:
            messages.deal(block)
            messages.send_back(m, d)

    def _transfer(self, m, leaves, affected):
        """Add the effect of the last solved leaves on later leaves.

        A leaf is a block of rows; `m` is the number of solved leaves. Let 2^k be the largest power of two that divides
        m. Then the last 2^k solved leaves act on the 2^k leaves after the next leaf; see *Transfers* in the module
        docstring.
        """
        tables = self._tables
        if not tables.chunks[0]:
            return
        largest = min((m & -m).bit_length(), len(tables.transfers)) - 1
        for level in range(largest, -1, -1):
            sources, targets = 1 << level, min(1 << level, tables.leaves - m - 1)
            if not (any(leaves[m - sources : m]) and any(leaves[m + 1 : m + 1 + targets])):
                return
            if level == largest:
                for leaf in range(m + 1, m + 1 + targets):
                    if not affected[leaf]:
                        tables.stored[leaf] = 0
                affected[m + 1 : m + 1 + targets] = True
            chunks = (tables.chunks[level + 1] if level < largest else 0), tables.chunks[level]
            length = tables.transfers[level][-1].shape[1]
            self._flops += (chunks[1] - chunks[0]) * LANES * (4 * _flops(length) + 6 * length)
            first, last = (min(max(c - tables.first, 0), tables.stored.shape[1]) for c in chunks)
            if first < last:
                transfer(tables.stored, first, last, m, sources, targets, *tables.transfers[level])

    def _rows_flops(self, cells, occupied):
        """Count operations within rows, and between neighbouring leaves' rows."""
        tables, rows = self._tables, self._tables.leaf_rows
        filled = occupied.reshape(-1, rows).sum(axis=1)
        pairs = np.sum(filled[1:] * (filled[1:] - 1) / 2) + np.sum(filled[1:] * filled[:-1])
        lanes = 2 * LANES * np.minimum(tables.reach / (1.5 * rows), 1).sum()
        within = cells * min(SEGMENT_COLUMNS, tables.shape[1])
        return filled.sum() * 2 * _flops(tables.length) + 2 * pairs * lanes + within


def _flops(length):
    return 2.5 * length * np.log2(length)  # operations of a real transform
