"""A residual extended over the rim of the contact set, and the transpose of this, for ``C E^T B E C``.

A is to be inverted on the contact set c alone, while B is about its inverse on all cells. By the formula of block
inverses (a Schur complement) the one is, with o the cells outside,

    A_cc^-1 = B_cc - B_co B_oo^-1 B_oc = E^T B E,       E r:  r on c,  -B_oo^-1 B_oc r outside.

So `E` continues a residual such that B E r vanishes outside contact. It is done a little, and near by: `k` Richardson
steps with the 3 x 3 centre of B, starting from zero. With `N` the weights of the eight neighbours over that of the cell
itself, and steps t as of Chebyshev's iteration,

    E r:    x_c = r,  x_o = 0,       for each t  x_o += t (-N_oc r - N_oo x_o - x_o);
    E^T b:  s_o = t b_o, the first,  the others  s_o += t (b_o - N_oo s_o - s_o),     then  b_c - N_co s_o.

Both are the same sweep over a list of cells, ``x += t (source - N x - x)``. Only the *band* takes part, the cells up
to `k` away from contact (diagonal steps count one): in step i the layers 1 to i, since a value further out is zero
still, or without influence any more.

On several ranks fields are exchanged once, not in every step. What is wrong without the rows beside a slab is wrong
in its outermost k rows only: these are taken from a *strip* of 3 k rows, of which k are the neighbour's.
"""

from __future__ import annotations

from functools import cache
from math import prod
from typing import NamedTuple

import numpy as np

from app.fast import rim_kernels
from app.halfspace.halo import Halo

MAX_STEPS = 250  # kinds of cells are numbered in a byte
_CYCLE = 8  # steps after which their lengths begin anew: more in one polynomial would spread rounding
_LOWEST = 0.05  # eigenvalue of the stencil, at least, in its highest one
_NOTHING = np.zeros(0, np.uint8)


def chebyshev_steps(steps, low, high):
    """Lengths of the steps of Richardson's iteration that is best on eigenvalues between `low` and `high`.

    Not collective.
    """
    roots = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (2 * np.arange(steps) + 1) / (2 * steps))
    return 1 / roots


class _Cells(NamedTuple):
    """Cells that take part, as indices into rows that are swept."""

    band: np.ndarray  # from layer 1 outwards
    sizes: np.ndarray  # of it up to each layer
    inner: np.ndarray  # beside the band in contact, and one behind those
    rim: int  # how many of them are beside it


class _Part(NamedTuple):
    """Rows that are swept together, counted from the first of the slab: itself, or a strip across one of its ends."""

    first: int
    end: int
    wanted: slice  # rows of the slab that it is swept for
    cells: _Cells


class RimExtension:
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
    workspace : ndarray of uint8, optional
        Storage that is at rest whenever this works.

    Attributes
    ----------
    rows : ndarray of bool
        Local rows with contact cells or cells of the band; the others are zero, or not looked at.

    Raises
    ------
    ValueError
        If `steps` is negative or above 250, or there are too many cells for 32-bit indices.
    """

    def __init__(self, shape, slabs, comm, steps=3, periodic=False, workspace=None):
        rows, nx = shape
        if not 0 <= steps <= MAX_STEPS:
            raise ValueError(f"rim extension: {steps} steps; 0 to {MAX_STEPS} are possible")
        alone = comm is None or comm.size == 1
        if (rows + 2 * steps) * nx > np.iinfo(np.int32).max:
            raise ValueError(f"rim extension: {rows} x {nx} cells on a rank need more than 32 bits")
        self.shape, self.steps = (rows, nx), steps
        self._around, self._wrapped = periodic, periodic and alone and rows > 0  # in x; in y without help
        self._halo = None if alone else Halo(slabs, comm, steps, periodic)
        self._halo_of_contact = None if alone else Halo(slabs, comm, steps + 2, periodic)
        self._workspace = _NOTHING if workspace is None else workspace
        self._parts = []
        self.rows = np.zeros(rows, bool)
        self._weights, self._lengths = (0.0, 0.0, 0.0), np.ones(steps)

    def set_stencil(self, stencil):
        """Take the 3 x 3 centre of `B`, in any unit; a ValueError if its middle is not positive, or it is not even.

        Not collective.
        """
        stencil = np.asarray(stencil, float)
        if stencil.shape != (3, 3) or not stencil[1, 1] > 0:
            raise ValueError("rim extension: the stencil must be 3 x 3 with a positive centre")
        even = (stencil + stencil[::-1] + stencil[:, ::-1] + stencil[::-1, ::-1]) / 4
        if not np.allclose(stencil, even, rtol=0, atol=1e-5 * stencil[1, 1]):
            raise ValueError("rim extension: the stencil must be even in x and in y")
        even /= stencil[1, 1]
        self._weights = x, y, d = float(even[1, 0]), float(even[0, 1]), float(even[0, 0])
        of_waves = 1 + 2 * np.array([x + y + 2 * d, x - y - 2 * d, y - x - 2 * d, 2 * d - x - y])
        highest = of_waves.max()
        lowest = max(of_waves.min(), _LOWEST * highest)
        cycles = np.array_split(self._lengths, max(1, -(-self.steps // _CYCLE)))
        self._lengths = np.concatenate([chebyshev_steps(part.size, lowest, highest) for part in cycles])

    def set_contact(self, mask):
        """List the cells that take part. Collective.

        Parameters
        ----------
        mask : ndarray of bool, shape (local rows, nx)
            The contact set; a ValueError if its shape or type is another one.
        """
        if mask.shape != self.shape or mask.dtype != bool:
            raise ValueError(f"rim extension: the contact set must be bool, of shape {self.shape}")
        if not self.steps:
            np.any(mask, axis=1, out=self.rows)
            return
        before, after = self._halo_of_contact(mask) if self._halo_of_contact else (mask[:0], mask[:0])
        mask = np.vstack([before, mask, after]) if len(before) + len(after) else mask
        self._parts, self._rooms = [], {}  # they are made anew
        around = len(mask) + 2, mask.shape[1] + 2
        spread, kinds, found = self._room(
            (around, np.uint8), (mask.shape, np.uint8), (mask.size + 1, np.int32)
        )
        spread[...] = 0
        inside = spread[1:-1, 1:-1]
        kinds[...] = inside[...] = mask
        for _ in range(self.steps):
            self._dilate(spread, None, kinds)
        np.logical_not(mask, out=inside, casting="unsafe")
        for _ in range(2):
            self._dilate(spread, mask, kinds)
        # In `kinds` free cells are 0, layer i is steps + 1 - i, contact steps + 1; beside the band two more, and one
        # behind those: they get -N_co s_o, and are zero while it is formed.
        beside, rows, k = len(before), len(self.rows), self.steps
        np.any(kinds[beside : beside + rows], axis=1, out=self.rows)
        low, high, spans = -min(beside, k), rows + min(len(after), k), [(0, rows, slice(0, rows))]
        if len(before):
            spans.append((low, min(2 * k, high), slice(0, min(k, rows))))
        if len(after):
            spans.append((max(rows - 2 * k, low), high, slice(max(rows - k, 0), rows)))
        self._parts = [
            _Part(first, end, wanted, self._list(kinds[beside + first : beside + end], found))
            for first, end, wanted in spans
        ]

    def _list(self, kinds, found):
        """List the cells of each kind; `found` has room for all of them. Not collective."""
        deep = self.steps + 1
        counts, places = np.zeros((2, deep + 3), np.int64)
        number = rim_kernels.list_cells(kinds, np.uint8(deep), found, counts)
        order = [*range(self.steps, 0, -1), deep + 2, deep + 1]
        ends = np.cumsum(counts[order])
        places[order] = ends - counts[order]
        cells = np.empty(number, np.int32)
        rim_kernels.sort_cells(kinds.reshape(-1), found[:number], cells, places)
        sizes = ends[: self.steps]
        return _Cells(cells[: sizes[-1]], sizes, cells[sizes[-1] :], counts[deep + 2])

    def _room(self, *wanted):
        """Arrays of some shapes and types, in the workspace as far as it goes; they hold anything. Not collective."""
        found, start = [], 0
        for shape, dtype in wanted:
            size = (prod(shape) if isinstance(shape, tuple) else int(shape)) * np.dtype(dtype).itemsize
            part = self._workspace[start : start + size]
            found.append(part.view(dtype).reshape(shape) if part.size == size else np.empty(shape, dtype))
            start += -(-size // 64) * 64
        return found

    def extend(self, x):
        """Apply E in place. Collective.

        Parameters
        ----------
        x : ndarray of float64 or float32, shape (local rows, nx), C-contiguous
            On entry the residual on the contact set and zero elsewhere; on exit extended over the band. A ValueError
            if its shape is another one, or it is not C-contiguous.
        """
        for field, cells, (*_, new) in self._swept(x):
            band = cells.band, cells.sizes
            rim_kernels.extend(field, self._wrapped, self._around, *band, self._weights, self._lengths, new)

    def restrict(self, x):
        """Apply E^T in place: to any field; on exit it is anything outside the contact set.

        Collective. Arguments and errors as of `extend`.
        """
        for field, cells, room in self._swept(x):
            how = self._weights, self._lengths
            rim_kernels.restrict(field, self._wrapped, self._around, *cells, *how, *room)

    def _swept(self, x):
        """Give for each part rows to be swept, their cells and room; what strips come to is put into x at the end.

        Collective. A ValueError if `x` is no field of these rows.
        """
        if x.shape != self.shape or not x.flags.c_contiguous:
            raise ValueError(f"rim extension: a C-contiguous field of shape {self.shape} is needed")
        if not self.steps:
            return
        before, after = self._halo(x) if self._halo else (x[:0], x[:0])
        fields = [x, *(self._strip(part, before, x, after) for part in self._parts[1:])]
        for field, part, room in zip(fields, self._parts, self._rooms_for(x.dtype), strict=True):
            yield field, part.cells, room
        for field, part in zip(fields[1:], self._parts[1:], strict=True):
            x[part.wanted] = field[part.wanted.start - part.first : part.wanted.stop - part.first]

    @staticmethod
    def _strip(part, before, x, after):
        """Return the rows of a part, of which some are beside x. Not collective."""
        above = before[min(part.first, 0) + len(before) :]
        return np.concatenate([above, x[max(part.first, 0) : part.end], after[: max(part.end - len(x), 0)]])

    def _rooms_for(self, dtype):
        """For each part arrays for what is on its inner cells and on its band, and for new values.

        Found once for a contact set.
        """
        if dtype not in self._rooms:
            self._rooms[dtype] = [
                self._room(
                    (cells.inner.size, dtype),
                    (cells.band.size, dtype),
                    (max(cells.band.size, cells.rim), dtype),
                )
                for *_, cells in self._parts
            ]
        return self._rooms[dtype]

    def _dilate(self, spread, of, kinds):
        """Let what is marked spread to the cells beside it, and count these. Not collective."""
        if self._around:
            spread[:, 0], spread[:, -1] = spread[:, -2], spread[:, 1]
        if self._wrapped:
            spread[0], spread[-1] = spread[-2], spread[1]
        rim_kernels.dilate(spread, of, kinds)


@cache
def load_extension(dtype):
    """Load the compiled loops for fields of a type now, not in the first iteration. Not collective."""
    extension, field = RimExtension((3, 3), None, None, 1), np.zeros((3, 3), dtype)
    extension.set_contact(np.eye(3, dtype=bool))
    extension.extend(field)
    extension.restrict(field)
