"""The product u = A p, eq. (2.6): by FFT on any grid, by a stored matrix on the smallest.

``u[j, i] = sum_{j', i'} K[|j - j'|, |i - i'|] p[j', i']`` on an ny x nx grid is a periodic convolution on an
``Ny x Nx`` grid, ``N >= 2 n - 1``, of p padded with zeros: see `app.halfspace.fft.multiplier`. On a periodic patch it
is one on the grid itself. On grids that are not small it is one on a box only a quarter larger than the patch; what the
images of the patch add there is smooth, and taken off by `app.halfspace.images`.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from app.base.mpi import MPI
from app.halfspace import events
from app.halfspace.fft.lengths import lengths_with_margin, transform_length
from app.halfspace.fft.multiplier import SERIAL, EvenMultiplier
from app.halfspace.images import Box, ImageCorrection
from app.halfspace.influence import influence_at

_SINGLE, _DOUBLE = np.dtype(np.float32), np.dtype(np.float64)
# Of boxes:
_LEAST = {_SINGLE: 320, _DOUBLE: 640}  # cells of the patch in both directions; smaller ones are padded
_MARGIN = 0.2  # of the patch is added to it, at least
# Nodes around a cell, and steps between them to the nearest image: they leave rounding only.
_NODES = {_SINGLE: (6, 10), _DOUBLE: (14, 32)}
_STRETCHED = 3.0  # ratio of their sides, at most


class Convolution(EvenMultiplier):
    """u = A p, the sum (2.6), for the influence matrix of a grid, by FFT on a grid of twice the size.

    Collective over the ranks of the layout.

    Parameters
    ----------
    quadrant_rows : callable
        ``quadrant_rows(slice) -> ndarray (rows, nx)``: influence coefficients, a few rows at a time.
    shape, layout
        See `EvenMultiplier`.
    """

    def __init__(self, quadrant_rows, shape, layout=SERIAL):
        ny, nx = shape
        super().__init__(shape, (transform_length(ny), transform_length(nx)), layout)
        self.use(layout.spectra, shape, partial(self.set_kernel, quadrant_rows, ny, nx))


class BoxProduct(EvenMultiplier):
    """As `Convolution`, the sum (2.6), in a periodic box a little larger than the patch, less what the images add.

    Collective over the ranks of the layout.

    Parameters
    ----------
    grid : Grid
    compliance : float
        [mm2/N].
    layout : Layout
    """

    def __init__(self, grid, compliance, layout=SERIAL):
        super().__init__(grid.shape, self.periods_of(grid), layout)
        self._box, self._compliance = Box(grid, self.periods, partial(influence_at, grid)), compliance
        halves = (period // 2 + 1 for period in self.periods)
        self.use(layout.spectra, None, partial(self.set_kernel, self._kernel, *halves))
        self._correct_images()

    @classmethod
    def periods_of(cls, grid):
        """Cells of the box in y and x. Not collective."""
        return lengths_with_margin(grid.shape, (_MARGIN, _MARGIN))

    @classmethod
    def suits(cls, grid, dtype):
        """Whether it is quicker than a `Convolution`. Not collective."""
        sides = [n * d for n, d in zip(cls.periods_of(grid), (grid.dy, grid.dx), strict=True)]
        return min(grid.shape) >= _LEAST[dtype] and max(sides) <= _STRETCHED * min(sides)

    def _kernel(self, rows):
        ny, nx = self.periods
        offsets = np.arange(ny // 2 + 1)[rows]
        return self._compliance * self._box.kernel(offsets, np.arange(nx // 2 + 1))

    def _correct_images(self):
        grid, (width, fine) = self._box.grid, _NODES[self.dtype]
        free = [period - n for period, n in zip(self.periods, grid.shape, strict=True)]
        nearest = min(free[0] * grid.dy, free[1] * grid.dx) / fine
        steps = [max(1, int(nearest / d)) for d in (grid.dy, grid.dx)]
        self.image_correction = ImageCorrection(
            self._box, self._compliance, steps, width, self.slabs, self.comm, self.dtype
        )

    def in_precision(self, dtype):
        """See `EvenMultiplier.in_precision`."""
        other = super().in_precision(dtype)
        other._box, other._compliance = self._box, self._compliance
        other._correct_images()
        return other

    @property
    def memory(self):
        """Bytes held on this rank."""
        return super().memory + self.image_correction.memory


class PeriodicProduct(EvenMultiplier):
    """u = A p on a periodic patch, or with the inverse of A, p = B u but for its mean: no padding.

    Collective over the ranks of the layout.

    Parameters
    ----------
    symbol : callable
        See `EvenMultiplier.set_spectrum`.
    shape, layout
        See `EvenMultiplier`.
    """

    def __init__(self, symbol, shape, layout=SERIAL):
        super().__init__(shape, shape, layout)
        with events.spectra:
            self.set_spectrum(symbol)

    def inverse(self):
        """Return the inverse on fields without mean, zero on constants; it shares storage. Not collective."""
        other = self.in_precision(self.dtype)
        scaled = self._spectrum * float(self.periods[0] * self.periods[1]) ** 2
        np.divide(1.0, scaled, out=other._spectrum, where=scaled > 0)
        return other

    def screened(self):
        """Return a `ScreenedProduct` of this A, that shares storage. Not collective."""
        other = EvenMultiplier.in_precision(self, self.dtype, ScreenedProduct)
        other.eigenvalues = self._spectrum.astype(float)
        return other

    def norm(self):
        """Largest eigenvalue. Collective."""
        largest = float(self._spectrum.max(initial=0.0)) * self.periods[0] * self.periods[1]
        return largest if self.comm is None else self.comm.allreduce(largest, MPI.MAX)


class ScreenedProduct(EvenMultiplier):
    """(B + stiffness)^-1, B the inverse of a periodic A: a half-space on springs. See `PeriodicProduct.screened`."""

    def screen(self, stiffness):
        """Set the stiffness of the springs, more than zero [(N/mm2) / mm]. Not collective."""
        cells = float(self.periods[0] * self.periods[1])
        np.divide(self.eigenvalues, 1 + stiffness * cells * self.eigenvalues, out=self._spectrum)
        self._spectrum[self.eigenvalues == 0] = 1 / (stiffness * cells)  # constants


class DenseProduct:
    """The same product by a stored matrix: quicker than an FFT on the smallest grids (n <= 256)."""

    largest = 256

    def __init__(self, matrix, shape):
        self.matrix, self.shape, self.dtype, self.flops = matrix, shape, matrix.dtype, 2 * matrix.size
        self.count = 0

    def apply(self, p, out, mask=None):
        """Compute out = A p, or out = C A C p; see `EvenMultiplier.apply`. Not collective."""
        self.count += 1
        if mask is None:
            out[...] = (self.matrix @ p.reshape(-1)).reshape(self.shape)
        else:
            np.multiply((self.matrix @ (p * mask).reshape(-1)).reshape(self.shape), mask, out=out)


class NoRows:
    """Products and preconditioners of a grid on a rank that has no part in it: they do nothing."""

    dtype, shape, periods = np.dtype(float), (0, 0), (0, 0)
    count = flops = 0
    centre = np.outer([0.0, 1.0, 0.0], [0.0, 1.0, 0.0])  # the identity's

    def apply(self, p, out, mask=None, rows=None):
        """Do nothing. Not collective; nor are the others."""

    apply_inverse = apply
