"""Extension E of a residual past the contact edge, and its transpose.

The preconditioner approximates the inverse of A_cc, the part of A on the contact set c. Let o be the cells outside c.
B is nearly the inverse of A on all cells. If it were the inverse, block inversion (a Schur complement) would give

    A_cc^-1 = B_cc - B_co B_oo^-1 B_oc = E^T B E.

Here E extends a residual r from c to all cells. On c, E r is r. On o, E r is x_o = -B_oo^-1 B_oc r, so B E r is zero
there.

The values x_o are computed approximately, by `k` Richardson steps for B_oo x_o = -B_oc r. B is replaced by its 3 x 3
centre, so each step reaches one cell further from the contact edge. Let N be the weights of the eight neighbours,
divided by the weight of the cell itself. Let t be the step length, which changes from step to step as in Chebyshev's
iteration. Then E r is

    x_c = r,  x_o = 0;             for each t        x_o += t (-N_oc r - N_oo x_o - x_o).

The transpose E^T b is

    s_o = t b_o for the first t;   for each later t  s_o += t (b_o - N_oo s_o - s_o);   result  b_c - N_co s_o.

The steps may also start from block means of the residual instead of zero (`app.methods.free.block_average`).

- *Cache.* One pass over the rows makes all steps: each step is one row behind the step before.
- *Rows* at a distance of more than `k` from contact are left out.
- *Ranks.* The halo has `k` rows, on which the steps are repeated.
"""

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.chebyshev import chebyshev_steps
from app.halfspace.grid import repeats_in
from app.parallel.halo import Halo
from app.parallel.reductions import copy_row, copy_slab_row, njit_reassoc, nonzero_span, stencil_sum
from app.parallel.slabs import Slabs, none_if_single

MAX_STEPS = 250
CHEBYSHEV_CYCLE = 8  # steps of one polynomial; more would amplify rounding
MIN_EIGENVALUE_RATIO = 0.05  # smallest over largest eigenvalue of the stencil


class EdgeExtension:
    """Extension E of a residual past the contact edge, and its transpose.

    Collective. Arrays have the rows of this rank.

    Parameters
    ----------
    shape : (int, int)
        Local rows and columns.
    slabs : Slabs
        Distribution of the rows; not used if `comm` is None.
    comm : mpi4py.MPI.Comm or None
        Ranks that share the grid; None if this rank has all of it.
    steps : int
        Number of steps `k`; for 0 steps `E` is the identity.
    periodic : bool or str
        As the attribute of `Grid`.

    Attributes
    ----------
    rows : ndarray of bool
        Local rows at a distance of at most `k` from contact. Other rows are zero, or not read.
    contact : ndarray of bool, shape (local rows, nx)
        Contact set.
    """

    def __init__(self, shape, slabs, comm, steps, periodic=False):
        if not 0 <= steps <= MAX_STEPS:
            raise ValueError(f"edge extension: {steps} steps; 0 to {MAX_STEPS} are possible")
        self.shape, self.steps, (in_y, self._periodic) = shape, steps, repeats_in(periodic)
        self._halo, comm = None, none_if_single(comm)
        if steps and (comm is not None or (in_y and shape[0])):
            self._halo = Halo(Slabs(shape[0]) if comm is None else slabs, comm, steps, in_y)
        # With the halo: the contact set, and the distance of each row from the next one with contact
        self._contact, self._away = np.zeros(shape, bool), np.zeros(shape[0], np.int64)
        self.contact = self._contact
        self.rows = np.zeros(shape[0], bool)
        self._weights, self._lengths, self._works = (0.0, 0.0, 0.0), np.ones(steps), {}

    def set_stencil(self, stencil):
        """Set the stencil for steps that extend the residual.

        `stencil` is the 3 x 3 centre of B, the inverse of A, times any factor. Only its even part is used.
        """
        stencil = np.asarray(stencil, float)
        even = (stencil + stencil[::-1] + stencil[:, ::-1] + stencil[::-1, ::-1]) / (4 * stencil[1, 1])
        self._weights = x, y, d = float(even[1, 0]), float(even[0, 1]), float(even[0, 0])
        of_waves = 1 + 2 * np.array([x + y + 2 * d, x - y - 2 * d, y - x - 2 * d, 2 * d - x - y])
        highest = of_waves.max()
        lowest = max(of_waves.min(), MIN_EIGENVALUE_RATIO * highest)
        cycles = np.array_split(self._lengths, max(1, -(-self.steps // CHEBYSHEV_CYCLE)))
        self._lengths = np.concatenate([chebyshev_steps(part.size, lowest, highest) for part in cycles])
        self._works = {}

    def set_contact(self, mask):
        """Copy a new contact set, with the halo rows of other ranks."""
        before, after = self._exchange(mask)
        if len(self._contact) != len(before) + len(mask) + len(after):
            self._contact = np.empty((len(before) + len(mask) + len(after), self.shape[1]), bool)
            self._away = np.empty(len(self._contact), np.int64)
        _set_contact(before, mask, after, self.steps, self._contact, self._away, self.rows)
        self.contact = self._contact[len(before) :][: len(mask)]

    def include_all_rows(self):
        """Include all rows, for fields that are nonzero far from contact."""
        self._away[:], self.rows[:] = 0, True

    def extend(self, x, out=None):
        """Extend a residual past the contact edge: out = E x.

        On the contact set, x is the residual. In all other cells x has the values from which the steps start: zeros, or
        block means. Both arrays are C-contiguous, float64 or float32. Without `out`, the result is stored in x.
        """
        out = x if out is None else out
        if not self.steps and out is not x:
            out[...] = x
        self._sweep(x, out, back=False)

    def restrict(self, x):
        """Apply E^T, the transpose of the extension, to x in place.

        E is a function of the residual on contact and of the start values outside (zeros or block means). So outside
        contact, x receives the part of E^T x that belongs to the start values.
        """
        self._sweep(x, x, back=True)

    def _sweep(self, x, out, back):
        if self.steps:
            before, after = self._exchange(x)
            places = self._contact, self._away, self._periodic
            _all_steps(x, out, before, after, *places, back, *self._work_of(x.dtype))

    def _work_of(self, dtype):
        """Return stencil weights, step lengths and work rows in a precision."""
        if dtype not in self._works:
            rows = np.empty((self.steps, 3, self.shape[1] + 2), dtype), np.zeros(self.shape[1], dtype)
            self._works[dtype] = np.array(self._weights, dtype), self._lengths.astype(dtype), *rows
        return self._works[dtype]

    def _exchange(self, field):
        return self._halo(field) if self._halo else (field[:0], field[:0])


# Rows are counted from the first of the halo. Each step stores its last three rows in a ring, padded by a cell at
# either end. Outside the patch all fields are zero.


@njit_reassoc
def _first_step_back(b, contact, length, out):
    """Make a row's first step of E^T b."""
    zero = out.dtype.type(0)
    for i in range(contact.size):
        new = length * b[i]
        out[i] = zero if contact[i] else new


@njit_reassoc
def _step(above, here, below, source, contact, weights, length, out):
    """Make a later step of E or E^T in a row.

    `above`, `here` and `below` are rows of the field before the step. `source` is the row of b for E^T b, zero for E.
    `length` is the step length.
    """
    x, y, d = weights[0], weights[1], weights[2]
    for i in range(contact.size):
        value = here[i + 1]
        neighbours = stencil_sum(above, here, below, i, x, y, d)
        new = value + length * (source[i] - (neighbours + value))
        out[i] = value if contact[i] else new


@njit_reassoc
def _finish_row(above, here, below, weights, b):
    """Finish E^T b, the transposed extension of b, in a row.

    Subtract s + N s from b in contact cells. `above`, `here` and `below` are rows of s, the field after the last step.
    N s is the sum over a cell's neighbours with `weights`.
    """
    x, y, d = weights[0], weights[1], weights[2]
    for i in range(b.size):
        b[i] -= stencil_sum(above, here, below, i, x, y, d) + here[i + 1]


@njit()
def _set_contact(before, mask, after, steps, contact, away, rows):
    """Copy a contact set with its halo; compute distances from contact.

    `away` receives the distance of each row from the nearest row with contact, at most steps + 1. `rows` marks the rows
    at a distance of at most `steps`.
    """
    first, count = len(before), len(contact)
    for j in range(count):
        copy_slab_row(j, mask, before, after, contact[j])
        away[j] = 0 if nonzero_span(contact[j])[1] > 0 else steps + 1
        if j:
            away[j] = min(away[j], away[j - 1] + 1)
    for j in range(count - 2, -1, -1):
        away[j] = min(away[j], away[j + 1] + 1)
    for j in range(len(rows)):
        rows[j] = away[first + j] <= steps


@njit()
def _pad_ends(row, periodic):
    """Set ghost cells at the ends of a row."""
    row[0], row[-1] = (row[-2], row[1]) if periodic else (row.dtype.type(0), row.dtype.type(0))


@njit()
def _all_steps(x, out, before, after, contact, away, periodic, back, weights, lengths, rings, zeros):
    """Extend a residual past the contact edge: out = E x.

    If `back` is true, apply the transpose of E to x in place instead.
    """
    steps, rows = lengths.size, len(contact)
    rings[...] = 0
    for first in range(rows + steps):
        for k in range(min(first + 1, steps)):
            j = first - k
            row = rings[k, j % 3]
            if j >= rows or away[j] > (steps - k if back else k):
                row[:] = 0
                continue
            here = j - len(before)
            if k > 0 and not back:
                source = zeros
            elif here < 0:
                source = before[j]
            else:
                source = x[here] if here < len(x) else after[here - len(x)]
            if k > 0:
                above, middle, below = (
                    rings[k - 1, (j - 1) % 3],
                    rings[k - 1, j % 3],
                    rings[k - 1, (j + 1) % 3],
                )
                length = lengths[k if back else k - 1]
                _step(above, middle, below, source, contact[j], weights, length, row[1:-1])
            elif back:
                _first_step_back(source, contact[j], lengths[0], row[1:-1])
            else:
                copy_row(source, row[1:-1])
            _pad_ends(row, periodic)
        j = first - steps
        here = j - len(before)
        if not 0 <= here < len(x):
            continue
        last = rings[steps - 1]
        above, middle, below = last[(j - 1) % 3], last[j % 3], last[(j + 1) % 3]
        if back:
            if away[j] == 0:
                _finish_row(above, middle, below, weights, x[here])
        elif away[j] > steps:
            out[here] = 0
        else:
            _step(above, middle, below, zeros, contact[j], weights, lengths[steps - 1], out[here])
