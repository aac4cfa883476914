"""A residual extended over the rim of the contact set, and the transpose of this, for ``C E^T B E C``.

`B`, an inverse circulant, takes the residual for zero outside the contact set. `E` puts there what `B` would
rather see: `k` Richardson steps with the 3 x 3 centre of `B` on the cells outside, starting from zero. With `N` the
weights of the eight neighbours over that of the cell itself, `c` the contact set, `o` the cells outside, and steps t
as of Chebyshev's iteration,

    E r:    x_c = r,  x_o = 0,       for each t  x_o += t (-N_oc r - N_oo x_o - x_o);
    E^T b:  s_o = t b_o, the first,  the others  s_o += t (b_o - N_oo s_o - s_o),     then  b_c - N_co s_o.

Both are the same sweep over a list of cells, ``x += t (source - N x - x)``. Only the *band* takes part, the cells up
to `k` away from contact (diagonal steps count one): in step i the layers 1 to i, since a value further out is zero
still, or without influence any more.

What the rows beside a slab are in each step is computed here, too, on a *strip* of k rows of the neighbour's and k of
these: so fields are exchanged once, not in every step.
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
    """Cells of some rows that take part, as indices into these."""

    band: np.ndarray  # from layer 1 outwards
    sizes: np.ndarray  # of it up to each layer
    inner: np.ndarray  # beside the band in contact, and one behind those
    rim: int  # how many of them are beside it


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
        if rows * nx > np.iinfo(np.int32).max:
            raise ValueError(f"rim extension: {rows} x {nx} cells on a rank need more than 32 bits")
        self.shape, self.steps = (rows, nx), steps
        alone = comm is None or comm.size == 1
        self._around, self._wrapped = periodic, periodic and alone and rows > 0  # in x; in y without help
        self._halo = None if alone else Halo(slabs, comm, steps, periodic)
        self._halo_of_contact = None if alone else Halo(slabs, comm, steps + 2, periodic)
        self._workspace = _NOTHING if workspace is None else workspace
        self._parts = None  # top strip, these rows, bottom strip
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
        self._parts, self._rooms = None, {}  # they are made anew
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
        first, k = len(before), self.steps
        last = first + len(self.rows)
        here = kinds[first:last]
        top, bottom = kinds[max(first - k, 0) : first + k], kinds[max(last - k, 0) : last + k]
        self._parts = [
            self._cells(top, found) if first else None,
            self._cells(here, found),
            self._cells(bottom, found) if len(after) else None,
        ]
        np.any(here, axis=1, out=self.rows)

    def _cells(self, kinds, found):
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
        flat = self._flat(x)
        if not self.steps:
            return
        cells, strips, (*_, new) = self._parts[1], self._strips(x), self._room_for(x.dtype)
        if not strips:
            band = cells.band, cells.sizes
            rim_kernels.extend(x, self._wrapped, self._around, *band, self._weights, self._lengths, new)
            return
        for layer, (size, length) in enumerate(zip(cells.sizes, self._lengths, strict=True)):
            beside, how = self._beside(x, strips), (self._weights, length)
            for strip in strips:
                strip.sweep(layer, new[:0], self._around, *how)
            rim_kernels.sweep(flat, *beside, cells.band[:size], new[:0], *how, new)

    def restrict(self, x):
        """Apply E^T in place: to any field; on exit it is anything outside the contact set.

        Collective. Arguments and errors as of `extend`.
        """
        if not self.steps:
            return
        flat, cells, strips = self._flat(x), self._parts[1], self._strips(x)
        inner, source, new = self._room_for(x.dtype)
        if not strips:
            how = self._weights, self._lengths
            rim_kernels.restrict(x, self._wrapped, self._around, *cells, *how, inner, source, new)
            return
        rim_kernels.take_out(flat, cells.inner, inner)
        first, *others = self._lengths
        sources = [strip.begin(first) for strip in strips]
        rim_kernels.take_and_scale(flat, cells.band, first, source)
        for layer, length in zip(range(self.steps - 2, -1, -1), others, strict=True):
            beside, how = self._beside(x, strips), (self._weights, length)
            for strip, of_strip in zip(strips, sources, strict=True):
                strip.sweep(layer, of_strip, self._around, *how)
            rim_kernels.sweep(flat, *beside, cells.band[: cells.sizes[layer]], source, *how, new)
        rim, how = cells.rim, (self._weights, 1.0)
        rim_kernels.sweep(flat, *self._beside(x, strips), cells.inner[:rim], inner, *how, new)
        rim_kernels.put(flat, cells.inner[rim:], inner[rim:])

    def _room_for(self, dtype):
        """Arrays for what is on the inner cells, on the band, and for new values; found once for a contact set."""
        if dtype not in self._rooms:
            cells = self._parts[1]
            sizes = cells.inner.size, cells.band.size, max(cells.band.size, cells.rim)
            self._rooms[dtype] = self._room(*((size, dtype) for size in sizes))
        return self._rooms[dtype]

    def _flat(self, x):
        if x.shape != self.shape or not x.flags.c_contiguous:
            raise ValueError(f"rim extension: a C-contiguous field of shape {self.shape} is needed")
        return x.reshape(-1)

    def _dilate(self, spread, of, kinds):
        """Let what is marked spread to the cells beside it, and count these. Not collective."""
        if self._around:
            spread[:, 0], spread[:, -1] = spread[:, -2], spread[:, 1]
        if self._wrapped:
            spread[0], spread[-1] = spread[-2], spread[1]
        rim_kernels.dilate(spread, of, kinds)

    def _strips(self, x):
        """Rows around the first and the last border of these, as far as there is one. Collective."""
        if self._halo is None:
            return []
        before, after = self._halo(x)
        k, more = self.steps, max(self.steps - len(x), 0)
        top = _Strip([before, x[:k], after[:more]], len(before) - 1, 0, self._parts[0])
        bottom = _Strip(
            [before[len(before) - min(more, len(before)) :], x[-k:], after], -len(after), 1, self._parts[2]
        )
        return [strip for strip, rows in ((top, before), (bottom, after)) if len(rows)]

    def _beside(self, x, strips):
        """Rows above and below these; zero at the end of a free patch. Not collective."""
        above_and_below = np.zeros((2, self.shape[1]), x.dtype)
        for strip in strips:
            above_and_below[strip.side] = strip.rows[strip.neighbour]
        return *above_and_below, self._around


class _Strip:
    """Rows on both sides of a border between slabs, on which the sweeps are done again."""

    def __init__(self, parts, neighbour, side, cells):
        self.rows = np.vstack(parts)
        self.neighbour, self.side, self._cells = neighbour, side, cells
        self._flat = self.rows.reshape(-1)
        self._nothing = np.zeros(self.rows.shape[1], self.rows.dtype)

    def begin(self, length):
        """Take the contact cells beside the band out, and a first step on the band; return what was there."""
        inner, band = (
            np.empty(len(cells), self.rows.dtype) for cells in (self._cells.inner, self._cells.band)
        )
        rim_kernels.take_out(self._flat, self._cells.inner, inner)
        rim_kernels.take_and_scale(self._flat, self._cells.band, length, band)
        return band

    def sweep(self, layer, source, around, weights, length):
        """Sweep over the band up to a layer, from a source or, if it is empty, none, with a step of some length."""
        cells = self._cells.band[: self._cells.sizes[layer]]
        new = np.empty(len(cells), self.rows.dtype)
        rim_kernels.sweep(
            self._flat, self._nothing, self._nothing, around, cells, source, weights, length, new
        )


@cache
def load_extension(dtype, alone):
    """Load the compiled loops for fields of a type, on this rank only or on several, now. Not collective."""
    extension, field = RimExtension((3, 3), None, None, 1), np.zeros((3, 3), dtype)
    extension.set_contact(np.eye(3, dtype=bool))
    if alone:
        extension.extend(field)
        extension.restrict(field)
    else:
        strip = _Strip([field], 0, 0, extension._parts[1])
        strip.sweep(0, strip.begin(np.float64(1)), False, (0.0, 0.0, 0.0), np.float64(1))
        rim_kernels.put(field.reshape(-1), extension._parts[1].inner[:0], field[0])
