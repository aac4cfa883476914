"""Multilevel product, three to four times as fast as an FFT.

    M = N + P M_H P^T

M is a product with a dense matrix, such as A or its inverse B. `N` is a stencil of 5 x 5 cells, and `P` is linear
interpolation between cell centres. `M_H` is the multilevel product on cells twice as large; on the coarsest grid it is
a product by FFT. This method is multilevel multi-summation [1]_ of the lowest order. Long cells are first coarsened
only in their shorter direction, until they are nearly square. `app.methods.multilevel_operators` makes the products for
A and B.

On several ranks a coarse row belongs to the rank with the first of its two fine rows. The halo has two fine rows and
one coarse row on each side.

References
----------
.. [1] A. Brandt, A.A. Lubrecht, Multilevel matrix multiplication and fast solution of integral equations, J. Comput.
   Phys. 90 (1990) 348-370.
"""

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.fft.multiplier import SERIAL
from app.halfspace.grid import repeats_in
from app.methods.symbol import REACH
from app.parallel.halo import CoarseHalo, Halo
from app.parallel.reductions import copy_row, njit_reassoc, scale_row, wrap_ends
from app.parallel.slabs import Slabs, none_if_single

COST_IN_TRANSFORMS = (
    0.6  # cost of stencil and interpolation per cell, over the cost of an FFT and its inverse
)


def coarse_shape(shape, factors, periodic=False):
    """Return the shape of the coarse grid.

    The coarse grid has one extra cell on each side of a coarsened direction in which the patch does not repeat.
    `periodic` is as the attribute of `Grid`.
    """
    directions = zip(shape, factors, repeats_in(periodic), strict=True)
    return tuple(n // 2 + 2 * (not repeats) if factor == 2 else n for n, factor, repeats in directions)


class MultilevelOperator:
    """Multilevel product M, approximating A or its inverse.

    Collective over the ranks of the layout. M contains the products of coarser levels.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the fields.
    near : sequence of StencilLevel
        Stencils of this level and the coarser ones.
    coarsest : callable
        Function ``coarsest(shape, layout)`` that returns the product on the coarsest grid.
    layout : Layout
        Distribution and precision of the fields.
    other : MultilevelOperator, optional
        Another product on the same grid, which shares its coarse fields. Both must not be used at the same time.
    periodic : bool or str
        As the attribute of `Grid`.

    Attributes
    ----------
    count : int
        Number of products computed so far.
    periods : (int, int)
        Periods of the FFT in y and x, in cells of this level.
    """

    def __init__(self, shape, near, coarsest, layout=SERIAL, other=None, periodic=False):
        self.count, self.shape, self.dtype = 0, shape, np.dtype(layout.dtype)
        self.slabs = slabs = layout.slabs or Slabs(shape[0])
        self.comm, dtype = none_if_single(layout.comm), self.dtype
        twice = np.where(np.arange(REACH + 1) > 0, 2.0, 1.0)
        self._stencil = np.ascontiguousarray((near[0].stencil / np.outer(twice, twice)).T, dtype)  # [y, x]
        self._factors = fy, _ = near[0].factors
        self._repeats, below = repeats_in(periodic), coarse_shape(shape, self._factors, periodic)
        in_y, _ = self._repeats
        coarse = slabs if fy == 1 else slabs.coarsen(2) if in_y else slabs.surround()
        of_coarse = layout._replace(slabs=coarse)
        if len(near) > 1:
            others = other._next if other and isinstance(other._next, MultilevelOperator) else None
            self._next = MultilevelOperator(below, near[1:], coarsest, of_coarse, others, periodic)
        else:
            self._next = coarsest(below, of_coarse)
        self.periods = tuple(f * period for f, period in zip(self._factors, self._next.periods, strict=True))
        self._first, self._first_coarse = slabs.rows.start, coarse.rows.start
        self._coarse = np.zeros((coarse.local, below[1]), dtype) if other is None else other._coarse
        self._halo = Halo(slabs, self.comm, REACH, in_y) if in_y or self.comm is not None else None
        self._parents = CoarseHalo(slabs, self.comm, in_y) if fy == 2 else None
        self._none = np.zeros((0, shape[1]), dtype)
        self._all = np.ones(slabs.local, bool)
        padded, half = shape[1] + 2 * REACH, shape[1] // 2 + 3
        self._five = (
            np.zeros((5, padded), dtype),
            np.empty((3, padded), dtype),
            np.empty((2, shape[1]), dtype),
        )
        self._four = np.zeros((5, 2 * half), dtype), np.empty((2, half), dtype)
        self._wide = np.zeros(below[1] + 2, dtype)
        self.flops = 62 * slabs.local * shape[1] + self._next.flops

    @property
    def points(self):
        """Number of cells transformed by FFT so far.

        The work of stencils and interpolation is counted as the work of an FFT that takes the same time.
        """
        return self.count * COST_IN_TRANSFORMS * self.shape[0] * self.shape[1] + self._next.points

    def apply(self, p, out, rows=None):
        """Compute out = M p, a multilevel product.

        Parameters
        ----------
        p, out : ndarray of float64 or of `dtype`, shape (local rows, nx)
            Field and its product; both may be the same array.
        rows : ndarray of bool, shape (local rows,), optional
            True in rows in which p may be nonzero and `out` is needed. Other rows of `out` are arbitrary.
        """
        self.count += 1
        rows = self._all if rows is None else rows
        before, after = self._none, self._none
        if self._halo is not None:
            before, after = (halo.astype(self.dtype, copy=False) for halo in self._halo(p))
        coarse = self._coarse
        starts = self._first, self._first_coarse
        _restrict(p, rows, before, after, *starts, coarse, self._factors, self._repeats, *self._four)
        self._next.apply(coarse, coarse)
        above, below, first_coarse = coarse[:0], coarse[:0], self._first
        if self._parents:
            (above, below), first_coarse = self._parents(coarse), self._parents.first
        parents, starts = (above, coarse, below), (self._first, first_coarse)
        _add_near(
            p, rows, before, after, self._stencil, parents, *starts, self._factors, self._repeats[1], out,
            *self._five, self._wide,
        )  # fmt: skip


# Padded rows have REACH zeros at either end, or the periodic continuation, so that the sides of the patch need no
# branches. The factor `three` has the type of the rows: a Python number would turn single precision into double.


@njit_reassoc
def _add_rows(a, b, c, d, three, out):
    """Add four rows with weights 1, 3, 3, 1."""
    for i in range(out.size):
        out[i] = a[i] + d[i] + three * (b[i] + c[i])


@njit_reassoc
def _split(row, even, odd):
    for i in range(even.size):
        even[i] = row[2 * i]
        odd[i] = row[2 * i + 1]


@njit_reassoc
def _halve(even, odd, sixteenth, three, out):
    """Sum four fine cells into each coarse cell, with weights 1, 3, 3, 1."""
    for i in range(out.size):
        out[i] = sixteenth * (even[i] + odd[i + 1] + three * (odd[i] + even[i + 1]))


@njit_reassoc
def _double(row, sixteenth, three, out):
    """Interpolate a padded coarse row linearly in x.

    The result is multiplied by 1/4, the weight of the farther row in y.
    """
    for i in range(row.size - 2):
        most = three * row[i + 1]
        out[2 * i] = sixteenth * (most + row[i])
        out[2 * i + 1] = sixteenth * (most + row[i + 2])
    if out.size % 2:
        out[-1] = sixteenth * (three * row[-1] + row[-2])


@njit_reassoc
def _in_y(rows, stencil, middle, once, twice):
    """Apply the stencil in y: sum five rows with its weights.

    The stencil's weights differ at the distances 0, 1 and 2 in x, so there are three sums: `middle`, `once`, `twice`.
    """
    a, b, c, d, e = rows
    here, here1, here2 = stencil[0, 0], stencil[0, 1], stencil[0, 2]
    next0, next1, next2 = stencil[1, 0], stencil[1, 1], stencil[1, 2]
    last0, last1, last2 = stencil[2, 0], stencil[2, 1], stencil[2, 2]
    for i in range(c.size):
        near, far = b[i] + d[i], a[i] + e[i]
        middle[i] = here * c[i] + next0 * near + last0 * far
        once[i] = here1 * c[i] + next1 * near + last1 * far
        twice[i] = here2 * c[i] + next2 * near + last2 * far


@njit_reassoc
def _in_x(middle, once, twice, near, far, three, out):
    """Apply the stencil in x; add interpolated coarse rows.

    `middle`, `once` and `twice` are the sums of `_in_y`; `near` and `far` are the nearer and the farther coarse row.
    """
    for i in range(out.size):
        next_cells, last_cells = once[i + 1] + once[i + 3], twice[i] + twice[i + 4]
        out[i] = three * near[i] + far[i] + middle[i + 2] + next_cells + last_cells


@njit()
def _copy_row_at(j, p, rows, before, after, out):
    """Copy row j of p or of its halo to `out`.

    Rows are counted from the first local row; rows outside the grid are zero. Return whether the row may be nonzero.
    """
    if 0 <= j < len(p):
        if rows[j]:
            copy_row(p[j], out)
            return True
    elif -len(before) <= j < 0:
        copy_row(before[len(before) + j], out)
        return True
    elif 0 <= j - len(p) < len(after):
        copy_row(after[j - len(p)], out)
        return True
    out[:] = 0
    return False


@njit()
def _restrict(p, rows, before, after, first, first_coarse, coarse, factors, repeats, four, halves):
    """Restrict p to the coarse grid: coarse = P^T p.

    P^T is the transpose of interpolation. `first` and `first_coarse` are the numbers of the first fine and coarse row
    of this rank; `four` and `halves` are work rows. `repeats` has two flags, for y and x: true if the patch repeats.
    """
    kind, nx, (fy, fx) = coarse.dtype.type, p.shape[1], factors
    pad_y, pad = 1 if repeats[0] else 3, 1 if repeats[1] else 3
    share, three = kind(1 / (fy * fx) ** 2), kind(3)
    row, even, odd = four[4], halves[0], halves[1]
    nonzero = 0  # bits: which of the four rows are not zero
    for j in range(len(coarse)):
        if fy == 2:
            low = 2 * (first_coarse + j) - pad_y - first
            for k in range(low + 2 if j else low, low + 4):
                copied = _copy_row_at(k, p, rows, before, after, four[k % 4, pad : pad + nx])
                if repeats[1]:
                    wrap_ends(four[k % 4], nx, pad)
                nonzero = (2 * nonzero + copied) & 15
            if nonzero:
                a, b, c, d = four[low % 4], four[(low + 1) % 4], four[(low + 2) % 4], four[(low + 3) % 4]
                _add_rows(a, b, c, d, three, row)
        else:
            nonzero = int(_copy_row_at(j, p, rows, before, after, row[pad : pad + nx]))
            if repeats[1]:
                wrap_ends(row, nx, pad)
        if not nonzero:
            coarse[j] = 0
        elif fx == 2:
            _split(row, even, odd)
            _halve(even, odd, share, three, coarse[j])
        else:
            scale_row(row[pad : pad + nx], share, coarse[j])


@njit()
def _widen(row, fx, three, periodic, wide, out):
    """Interpolate a coarse row linearly in x, times 1/4.

    `wide` is a work row.
    """
    if fx == 1:
        scale_row(row, row.dtype.type(1 / 4), out)
    elif periodic:
        copy_row(row, wide[1:-1])
        wrap_ends(wide, row.size, 1)
        _double(wide, row.dtype.type(1 / 16), three, out)
    else:
        _double(row, row.dtype.type(1 / 16), three, out)


@njit()
def _widen_parent(k, above, coarse, below, fx, three, periodic, wide, out):
    """Interpolate row k of a coarse field in x, times 1/4.

    `above` and `below` are the halo of `coarse`; rows are counted from the first row of `above`.
    """
    here = k - len(above)
    if here < 0:
        _widen(above[k], fx, three, periodic, wide, out)
    elif here < len(coarse):
        _widen(coarse[here], fx, three, periodic, wide, out)
    else:
        _widen(below[here - len(coarse)], fx, three, periodic, wide, out)


@njit()
def _add_near(
    p, rows, before, after, stencil, parents, first, first_coarse, factors, periodic, out, five, columns, doubled,
    wide,
):  # fmt: skip
    """Compute the stencil's product plus the interpolated coarse field.

    Only `rows` are computed. `parents` are the coarse rows above, in and below the slab. `five`, `columns`, `doubled`
    and `wide` are work rows; the rows of `five` have zeros at the ends.
    """
    (fy, fx), nx, three, done = factors, p.shape[1], stencil.dtype.type(3), -1
    for j in range(-4, len(p)):
        _copy_row_at(j + 2, p, rows, before, after, five[(j + 2) % 5, 2 : 2 + nx])
        if periodic:
            wrap_ends(five[(j + 2) % 5], nx, 2)
        if j < 0 or not rows[j]:
            continue
        parent = far = first + j - first_coarse
        if fy == 2:
            parent = (first + j) // 2 + 1 - first_coarse
            far = parent + 1 if (first + j) % 2 else parent - 1
        for k in range(max(done + 1, min(parent, far)), max(parent, far) + 1):
            _widen_parent(k, *parents, fx, three, periodic, wide, doubled[k % 2])
            done = k
        around = five[(j - 2) % 5], five[(j - 1) % 5], five[j % 5], five[(j + 1) % 5], five[(j + 2) % 5]
        _in_y(around, stencil, columns[0], columns[1], columns[2])
        _in_x(columns[0], columns[1], columns[2], doubled[parent % 2], doubled[far % 2], three, out[j])
