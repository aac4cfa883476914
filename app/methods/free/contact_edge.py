"""A residual extended over the rim of the contact set, and the transpose of this, for ``C E^T B E C``.

A is to be inverted on the contact set c alone, while B is about its inverse on all cells. By the formula of block
inverses (a Schur complement) the one is, with o the cells outside,

    A_cc^-1 = B_cc - B_co B_oo^-1 B_oc = E^T B E,       E r:  r on c,  -B_oo^-1 B_oc r outside.

So `E` continues a residual such that B E r vanishes outside contact. It is done a little, and near by: `k` Richardson
steps with the 3 x 3 centre of B, starting from zero. With `N` the weights of the eight neighbours over that of the cell
itself, and steps t as of Chebyshev's iteration,

    E r:    x_c = r,  x_o = 0,       for each t  x_o += t (-N_oc r - N_oo x_o - x_o);
    E^T b:  s_o = t b_o, the first,  the others  s_o += t (b_o - N_oo s_o - s_o),     then  b_c - N_co s_o.

The steps may begin with another field than zero, see `app.methods.free.block_average`.

All steps are made in one pass over the rows, each step a row behind the one before it, so that what they read is still
in the cache. Rows more than `k` away from contact are left out. On several ranks `k` rows beside a slab are exchanged,
once, and gone through here, too.
"""

from __future__ import annotations

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.chebyshev import chebyshev_steps
from app.parallel.halo import Halo
from app.parallel.reductions import copy_row, copy_slab_row, njit_reassoc, nonzero_span, stencil_sum
from app.parallel.slabs import Slabs, none_if_single

MAX_STEPS = 250
CHEBYSHEV_CYCLE = (
    8  # steps after which their lengths begin anew: more in one polynomial would spread rounding
)
MIN_EIGENVALUE_RATIO = 0.05  # eigenvalue of the stencil, at least, in its highest one


class EdgeExtension:
    """``E`` and ``E^T`` on one grid; arrays hold this rank's rows.

    Parameters
    ----------
    shape : (int, int)
        Local rows and columns.
    slabs : Slabs
        Distribution of the rows; not used if `comm` is None.
    comm : mpi4py.MPI.Comm or None
        Ranks that share the grid; None if this rank holds all of it.
    steps : int
        Steps `k`; with none, `E` is the identity.
    periodic : bool
        Whether what leaves the patch on one side comes in on the other.

    Attributes
    ----------
    rows : ndarray of bool
        Local rows with contact cells, or no more than `k` away from them; the others are zero, or not looked at.
    contact : ndarray of bool, shape (local rows, nx)
        The set taken over last.

    Raises
    ------
    ValueError
        If `steps` is negative or above 250.
    """

    def __init__(self, shape, slabs, comm, steps, periodic=False):
        if not 0 <= steps <= MAX_STEPS:
            raise ValueError(f"rim extension: {steps} steps; 0 to {MAX_STEPS} are possible")
        self.shape, self.steps, self._periodic = shape, steps, periodic
        self._halo, comm = None, none_if_single(comm)
        if steps and (comm is not None or (periodic and shape[0])):
            self._halo = Halo(Slabs(shape[0]) if comm is None else slabs, comm, steps, periodic)
        # With the rows beside: the contact set, and rows from each to the next one with contact.
        self._contact, self._away = np.zeros(shape, bool), np.zeros(shape[0], np.int64)
        self.contact = self._contact
        self.rows = np.zeros(shape[0], bool)
        self._weights, self._lengths, self._kinds = (0.0, 0.0, 0.0), np.ones(steps), {}

    def set_stencil(self, stencil):
        """Take the 3 x 3 centre of `B`, in any unit; a ValueError if its middle is not positive, or it is not even.

        Not collective.
        """
        stencil = np.asarray(stencil, float)
        if stencil.shape != (3, 3) or not stencil[1, 1] > 0:
            raise ValueError("rim extension: the stencil must be 3 x 3 with a positive centre")
        even = (stencil + stencil[::-1] + stencil[:, ::-1] + stencil[::-1, ::-1]) / 4
        if not abs(stencil - even).max() <= 1e-5 * stencil[1, 1]:
            raise ValueError("rim extension: the stencil must be even in x and in y")
        even /= stencil[1, 1]
        self._weights = x, y, d = float(even[1, 0]), float(even[0, 1]), float(even[0, 0])
        of_waves = 1 + 2 * np.array([x + y + 2 * d, x - y - 2 * d, y - x - 2 * d, 2 * d - x - y])
        highest = of_waves.max()
        lowest = max(of_waves.min(), MIN_EIGENVALUE_RATIO * highest)
        cycles = np.array_split(self._lengths, max(1, -(-self.steps // CHEBYSHEV_CYCLE)))
        self._lengths = np.concatenate([chebyshev_steps(part.size, lowest, highest) for part in cycles])
        self._kinds = {}

    def set_contact(self, mask):
        """Take over a contact set. Collective.

        Parameters
        ----------
        mask : ndarray of bool, shape (local rows, nx)
            A copy is kept. A ValueError if its shape or type is another one.
        """
        if mask.shape != self.shape or mask.dtype != bool:
            raise ValueError(f"rim extension: the contact set must be bool, of shape {self.shape}")
        before, after = self._beside(mask)
        if len(self._contact) != len(before) + len(mask) + len(after):
            self._contact = np.empty((len(before) + len(mask) + len(after), self.shape[1]), bool)
            self._away = np.empty(len(self._contact), np.int64)
        _take_contact(before, mask, after, self.steps, self._contact, self._away, self.rows)
        self.contact = self._contact[len(before) :][: len(mask)]

    def include_all_rows(self):
        """With the contact set taken over last: fields are not zero far from it. Not collective."""
        self._away[:], self.rows[:] = 0, True

    def extend(self, x, out=None):
        """Apply E. Collective.

        Parameters
        ----------
        x : ndarray of float64 or float32, shape (local rows, nx), C-contiguous
            The residual on the contact set; elsewhere zero, or what the steps begin with
            (`app.methods.free.block_average`). A ValueError if its shape is another one, or it is not C-contiguous.
        out : ndarray, as `x`, optional
            The same, extended over the rim. Default: `x` itself.
        """
        out = x if out is None else out
        if not self.steps and out is not x:
            out[...] = x
        self._sweep(x, out, back=False)

    def restrict(self, x):
        """Apply E^T in place: to any field. Collective. Errors as of `extend`.

        Outside the contact set, in rows no further away, it is what the transpose leaves there for that with which E
        began.
        """
        self._sweep(x, x, back=True)

    def _sweep(self, x, out, back):
        for field in (x, out):
            if field.shape != self.shape or not field.flags.c_contiguous:
                raise ValueError(f"rim extension: a C-contiguous field of shape {self.shape} is needed")
        if self.steps:
            before, after = self._beside(x)
            places = self._contact, self._away, self._periodic
            _all_steps(x, out, before, after, *places, back, *self._of_kind(x.dtype))

    def _of_kind(self, dtype):
        """Weights, lengths of steps, and room for rows, of fields of a type."""
        if dtype not in self._kinds:
            nx = self.shape[1]
            room = np.empty((self.steps, 3, nx + 2), dtype), np.zeros(nx, dtype)
            self._kinds[dtype] = np.array(self._weights, dtype), self._lengths.astype(dtype), *room
        return self._kinds[dtype]

    def _beside(self, field):
        return self._halo(field) if self._halo else (field[:0], field[:0])


# Rows are counted from the first of those before this rank's. Those that a step is behind with are in rings of three,
# padded by a cell at either end; beyond the patch all is zero.


@njit_reassoc
def _first_step_back(b, contact, length, out):
    """The first step of E^T."""
    zero = out.dtype.type(0)
    for i in range(contact.size):
        new = length * b[i]
        out[i] = zero if contact[i] else new


@njit_reassoc
def _step(above, here, below, source, contact, weights, length, out):
    """Any other, and those of E, whose source is zero; what is in contact stays."""
    x, y, d = weights[0], weights[1], weights[2]
    for i in range(contact.size):
        value = here[i + 1]
        beside = stencil_sum(above, here, below, i, x, y, d)
        new = value + length * (source[i] - (beside + value))
        out[i] = value if contact[i] else new


@njit_reassoc
def _take_off(above, here, below, weights, b):
    """What comes after the steps of E^T: b - N s on C, where s is zero, b - N s - s elsewhere."""
    x, y, d = weights[0], weights[1], weights[2]
    for i in range(b.size):
        b[i] -= stencil_sum(above, here, below, i, x, y, d) + here[i + 1]


@njit()
def _take_contact(before, mask, after, steps, contact, away, rows):
    """Copy a set and the rows beside it; count rows from each to the next with contact, to steps + 1, and tell which
    are no more than `steps` away.
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
def _close(row, periodic):
    """Put the cells beyond the ends of a padded row."""
    row[0], row[-1] = (row[-2], row[1]) if periodic else (row.dtype.type(0), row.dtype.type(0))


@njit()
def _all_steps(x, out, before, after, contact, away, periodic, back, weights, lengths, rings, nothing):
    """out = E x; or `back`, E^T in place. `rings`: room for rows; `nothing`: a row of zeros."""
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
                source = nothing
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
            _close(row, periodic)
        j = first - steps
        here = j - len(before)
        if not 0 <= here < len(x):
            continue
        last = rings[steps - 1]
        above, middle, below = last[(j - 1) % 3], last[j % 3], last[(j + 1) % 3]
        if back:
            if away[j] == 0:
                _take_off(above, middle, below, weights, x[here])
        elif away[j] > steps:
            out[here] = 0
        else:
            _step(above, middle, below, nothing, contact[j], weights, lengths[steps - 1], out[here])
