"""Products u = A p with the influence matrix (2.6).

Each class of this module computes u = A p in another way. The base class `app.halfspace.fft.multiplier.EvenMultiplier`
has the Fourier transforms.

``u[j, i] = sum_{j', i'} K[|j - j'|, |i - i'|] p[j', i']`` on an ny x nx grid is a periodic convolution: p is padded by
zeros to an ``Ny x Nx`` grid, ``N >= 2 n - 1``, and multiplied in Fourier space. In a direction in which the patch
repeats no padding is needed. On large grids, padding by a quarter in each free direction is enough: in this periodic
box the images of the patch have a smooth influence, which `app.halfspace.images` subtracts.
"""

from functools import partial
from math import ceil

import numpy as np

from app.base.mpi import MPI
from app.halfspace import events
from app.halfspace.fft.lengths import fast_length, transform_length
from app.halfspace.fft.multiplier import SERIAL, EvenMultiplier
from app.halfspace.images import Box, ImageCorrection

_SINGLE, _DOUBLE = np.dtype(np.float32), np.dtype(np.float64)
_MIN_BOX_CELLS = {_SINGLE: 320, _DOUBLE: 640}  # cells of the patch in either direction
_BOX_MARGIN = 0.2  # least relative difference of the box and the patch
_MAX_BOX_ASPECT = 3.0  # ratio of the sides of a box
# Nodes around a cell, and steps between nodes to the nearest image: the interpolation error is below rounding.
_NODES = {_SINGLE: (6, 10), _DOUBLE: (14, 32)}


class Convolution(EvenMultiplier):
    """Product with A by FFT, with zero padding to twice the size. Collective.

    ``quadrant_rows(slice)`` returns rows of the influence coefficients K, shape (rows, nx). Each call is for a few
    rows. In a direction in which the patch `repeats`, a pair for y and x, no padding is needed.
    """

    def __init__(self, quadrant_rows, shape, layout=SERIAL, repeats=(False, False)):
        # (2.6)
        super().__init__(shape, self.lengths(shape, repeats), layout)
        halves = half_lengths(shape, self.periods)
        self.load_or_make(shape, partial(self.set_kernel, quadrant_rows, *halves))

    @staticmethod
    def lengths(shape, repeats):
        """Return the transforms' lengths in y and x."""
        return tuple(n if whole else transform_length(n) for n, whole in zip(shape, repeats, strict=True))


def half_lengths(shape, periods):
    """Return the numbers of offsets in y and x that a kernel needs."""
    return tuple(min(n, period // 2 + 1) for n, period in zip(shape, periods, strict=True))


class BoxProduct(EvenMultiplier):
    """Product with A in a periodic box, minus the images' influence. Collective."""

    def __init__(self, grid, kernel, layout=SERIAL):
        super().__init__(grid.shape, self.periods_of(grid), layout)
        self._compliance = kernel.compliance
        self._box = Box(grid, self.periods, kernel)
        halves = (period // 2 + 1 for period in self.periods)
        self.load_or_make(None, partial(self.set_kernel, self._kernel, *halves))
        self._correct_images()

    @staticmethod
    def periods_of(grid):
        """Return the cells of a grid's box in y and x."""
        cells = zip(grid.shape, grid.repeats, strict=True)
        return tuple(n if whole else fast_length(n + ceil(_BOX_MARGIN * n)) for n, whole in cells)

    @classmethod
    def suits(cls, grid, kernel, dtype):
        """Return whether box products are possible, and faster than a `Convolution`."""
        if not kernel.has_image_sums:
            return False
        if grid.one_way == "x" and not kernel.layers:
            return False  # Padding in y costs little, because zero rows are not transformed in x.
        periods, copies = cls.periods_of(grid), kernel.period_cells(grid)
        if any(0 < copy < period for copy, period in zip(copies, periods, strict=True)):
            return False  # The copies of a part of the period are nearer than its images.
        sides = [n * d for n, d in zip(periods, (grid.dy, grid.dx), strict=True)]
        return min(grid.shape) >= _MIN_BOX_CELLS[dtype] and max(sides) <= _MAX_BOX_ASPECT * min(sides)

    def _kernel(self, rows):
        ny, nx = self.periods
        offsets = np.arange(ny // 2 + 1)[rows]
        return self._compliance * self._box.kernel(offsets, np.arange(nx // 2 + 1))

    def _correct_images(self):
        grid, (width, per_gap) = self._box.grid, _NODES[self.dtype]
        around = zip(self.periods, grid.shape, (grid.dy, grid.dx), grid.repeats, strict=True)
        step = min((period - n) * d for period, n, d, whole in around if not whole) / per_gap
        steps, kernel = [max(1, int(step / d)) for d in (grid.dy, grid.dx)], (self._box, self._compliance)
        self.image_correction = ImageCorrection(*kernel, steps, width, self.slabs, self.comm, self.dtype)

    def in_precision(self, dtype):
        """Return a copy in another precision; see `EvenMultiplier.in_precision`."""
        other = super().in_precision(dtype)
        other._box, other._compliance = self._box, self._compliance
        other._correct_images()
        return other


class PeriodicProduct(EvenMultiplier):
    """Unpadded product with A on a periodic patch. Collective.

    ``symbol(columns, rows)`` returns the eigenvalues of A; see `EvenMultiplier.set_spectrum`.
    """

    def __init__(self, symbol, shape, layout=SERIAL):
        super().__init__(shape, shape, layout)
        with events.spectra:
            self.set_spectrum(symbol)

    def inverse(self):
        """Return the product with B: inverse of A, but zero on constants."""
        other = self.in_precision(self.dtype)
        scaled = self._spectrum * float(self.periods[0] * self.periods[1]) ** 2
        np.divide(1.0, scaled, out=other._spectrum, where=scaled > 0)
        return other

    def screened(self):
        """Return the `ScreenedProduct` of this half-space; both share a work array."""
        other = EvenMultiplier.in_precision(self, self.dtype, ScreenedProduct)
        other.eigenvalues = self._spectrum.astype(float)
        return other

    def norm(self):
        """Return the largest eigenvalue of A. Collective."""
        largest = float(self._spectrum.max(initial=0.0)) * self.periods[0] * self.periods[1]
        return largest if self.comm is None else self.comm.allreduce(largest, MPI.MAX)


class ScreenedProduct(EvenMultiplier):
    """Product with (B + k)^-1, where k is the stiffness of springs.

    The product describes a periodic half-space on springs. B is the inverse of the influence matrix A on fields without
    mean, and zero on constants.
    """

    def screen(self, stiffness):
        """Set the stiffness k of the springs, above 0 [(N/mm2) / mm]."""
        cells = float(self.periods[0] * self.periods[1])
        np.divide(self.eigenvalues, 1 + stiffness * cells * self.eigenvalues, out=self._spectrum)
        self._spectrum[self.eigenvalues == 0] = 1 / (stiffness * cells)  # constants


class DenseProduct:
    """Product with A, stored as a matrix."""

    largest = 256

    def __init__(self, matrix, shape):
        self.matrix, self.shape, self.dtype, self.flops = matrix, shape, matrix.dtype, 2 * matrix.size
        self.count = 0

    def apply(self, p, out, mask=None):
        """Store A p, or C A C p with the mask C, in `out`."""
        self.count += 1
        if mask is None:
            out[...] = (self.matrix @ p.reshape(-1)).reshape(self.shape)
        else:
            np.multiply((self.matrix @ (p * mask).reshape(-1)).reshape(self.shape), mask, out=out)


class NoRows:
    """Product or preconditioner on a rank without rows; it does nothing."""

    dtype, shape, periods = np.dtype(float), (0, 0), (0, 0)
    count = flops = 0
    centre = np.outer([0.0, 1.0, 0.0], [0.0, 1.0, 0.0])  # the identity's

    def apply(self, p, out, mask=None, rows=None):
        """Do nothing, because this rank has no cells."""

    apply_inverse = apply
