"""Influence coefficients transformed in x, for Gauss-Seidel sweeps."""

import itertools

import numpy as np
from scipy.fft import dct

from app.base.mpi import MPI
from app.halfspace.fft.lengths import fast_length, transform_length

_MAX_UNBLENDED_COLUMNS = 128  # with fewer columns a longer period gains nothing
_BLEND_MARGIN = 0.1  # share of the columns that is added to the least period for the blend
_BLOCK_ROWS = 32


class KernelInX:
    """Transforms in x of an even kernel's rows.

    The kernel K[|dy|, |dx|] has the influence coefficients at offsets dy and dx. The rows of K are made periodic with
    the length Nx and transformed. The transforms are real. They are multiplied by -1 / Nx: a sweep subtracts the effect
    of solved rows, and 1 / Nx is the scale of the inverse transform. Collective.

    Offsets from nx to Nx - nx are never used. There K is blended into its mirror image, K(Nx - x), by the integral of a
    Kaiser window. So K is smooth over the period, and short waves in x decay quickly in y.

    The function ``quadrant_rows(slice, columns)`` returns rows of K at the offsets 0 to `columns` - 1 in x. If K is
    `periodic` with an even period nx, then Nx = nx. The ranks of `comm` share the work.

    Attributes
    ----------
    length, frequencies : int
        Nx, and the number of frequencies F = Nx/2 + 1.
    reach : ndarray of int, shape (F,)
        Largest offset dy (lag) at which the kernel is not negligible, at this frequency or any higher one. A value is
        negligible if it is below the rounding error of the largest value.
    """

    def __init__(self, quadrant_rows, shape, comm=None, periodic=False):
        self._quadrant_rows, self._comm = quadrant_rows, comm
        self._ny, self._nx = ny, nx = shape
        self._exact = periodic and nx % 2 == 0
        room = fast_length(2 * nx - 1 + int(_BLEND_MARGIN * nx), even=True)
        self.length = nx if self._exact else transform_length(nx) if nx <= _MAX_UNBLENDED_COLUMNS else room
        self.frequencies = self.length // 2 + 1
        rounding = np.finfo(float).eps / 2
        steps = np.cumsum(np.kaiser(max(self.length - 2 * nx + 2, 1), -np.log(rounding)))
        self._share = 1 - steps[: max(self.frequencies - nx, 0)] / steps[-1]  # share of K, from offset nx on

        size, rank = (1, 0) if comm is None else (comm.size, comm.rank)
        self._lags = [ny * q // size for q in range(size + 1)]
        first, last = self._lags[rank], self._lags[rank + 1]
        least = rounding * np.abs(self.rows(0, 1)).max()
        self._local, reach = np.empty((last - first, self.frequencies)), np.zeros(self.frequencies, np.int64)
        for start in range(first, last, _BLOCK_ROWS):
            stop = min(start + _BLOCK_ROWS, last)
            block = self._local[start - first : stop - first]
            block[...] = self.rows(start, stop)
            np.maximum(reach, ((np.abs(block) > least).T * np.arange(start, stop)).max(axis=1), out=reach)
        if comm is not None:
            reach, local = np.empty_like(reach), reach
            comm.Allreduce(local, reach, MPI.MAX)
        self.reach = np.maximum.accumulate(reach[::-1])[::-1]

    def rows(self, first, last):
        """Return rows of the kernel, transformed in x.

        The rows are at the lags `first` to `last` - 1; a lag is an offset in y, in rows. The transforms are multiplied
        by -1 / Nx, and zero from lag ny on.
        """
        nx, half = self._nx, self.frequencies - 1
        transformed = np.zeros((last - first, half + 1))
        for start in range(first, min(last, self._ny), _BLOCK_ROWS):
            stop = min(start + _BLOCK_ROWS, last, self._ny)
            block = self._quadrant_rows(slice(start, stop), max(self.length - nx, half) + 1)
            even = block[:, : half + 1].copy()
            if not self._exact:
                even[:, nx:] *= self._share
                even[:, nx:] += (1 - self._share) * block[:, half:][:, ::-1]
            transformed[start - first : stop - first] = dct(even, type=1, axis=1, overwrite_x=True)
        return transformed / -self.length

    def columns(self, edges):
        """Return the kernel by frequency and lag. Collective.

        A lag is an offset in y, in rows; all ny lags are returned. This rank gets the frequencies `first` to `last` -
        1, with ``first, last = edges[rank]``. The shape is (last - first, ny). Call this only once, because it frees
        the data.
        """
        local = self._local[:, : edges[-1][1]].T.copy()  # The last rank has the last frequencies.
        del self._local
        first, last = edges[0 if self._comm is None else self._comm.rank]
        if self._comm is None:
            return local[first:last]
        counts = np.diff(self._lags)
        sent = [(b - a) * local.shape[1] for a, b in edges], [a * local.shape[1] for a, _ in edges]
        received = np.empty((last - first) * self._ny)
        self._comm.Alltoallv([local, sent], [received, list((last - first) * counts)])
        kernel = np.empty((last - first, self._ny))
        for a, b in itertools.pairwise(self._lags):
            kernel[:, a:b] = received[(last - first) * a : (last - first) * b].reshape(last - first, b - a)
        return kernel
