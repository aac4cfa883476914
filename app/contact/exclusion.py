"""Cells that cannot penetrate, by a lower bound of the displacement.

Let p >= 0. Then in each cell of a block I

    u >= sum over the blocks J of P_J K_IJ,

where P_J is the force in block J, and K_IJ a lower bound of the displacement by a unit force at all distances between a
point of I and one of J (`Kernel.least_influence`). It may be negative if a body has a layer. If the pressure repeats,
K_IJ is the least influence coefficient of all offsets between cells of I and J. The distances depend on the offset of
the blocks only. So this bound costs a product on the grid of blocks. Where h plus the bound is positive, the bodies
cannot penetrate: this is proved, and nothing else needs to be computed there. The test is made for whole blocks first,
with the least h of admissible cells in each block. These minima are made once: an approach only shifts h.
"""

import numpy as np
from scipy import fft

from app.base.numba_cache import njit
from app.contact.loops import gap
from app.halfspace.fft.lengths import fast_length
from app.parallel.reductions import minimum_over, njit_reassoc

BLOCK = 16  # cells of a block in each direction
_ROUNDING = 1e-12  # rounding error of the bound, over the norms of the two factors of the product


class BlockBounds:
    """Lower bounds of the displacement on blocks of a grid. Collective.

    Parameters
    ----------
    grid : Grid
        Grid of a free patch.
    kernel : Kernel
        Kernel with the method `least_influence`; any kernel if `quadrant` is given.
    b : ndarray, shape (local rows, nx), [mm]
        -h at depth 0, as in `app.contact.distance.UndeformedDistance`.
    admissible : ndarray of bool, shape (local rows, nx)
        Cells that may be in contact. All others are left out.
    first : int
        Number of the first local row.
    comm : mpi4py communicator, optional
        Ranks that share the rows.
    quadrant : ndarray, optional
        Influence coefficients at all offsets, in directions in which the patch repeats up to half a period [mm /
        (N/mm2)]. Periods must be multiples of `BLOCK`.

    Attributes
    ----------
    points : int
        Points of the transform of a product between blocks.
    """

    def __init__(self, grid, kernel, b, admissible, first=0, comm=None, quadrant=None):
        self._grid, self._fields, self._first = grid, (b, admissible), first
        self._shape = ny, nx = tuple(-(-n // BLOCK) for n in grid.shape)
        highest = np.full(self._shape, -np.inf)
        _block_maxima(b, admissible, first, highest, np.empty(grid.nx))
        self._highest = -minimum_over(comm, -highest)
        repeats = zip(self._shape, grid.repeats, strict=True)
        self._lengths = tuple(n if whole else fast_length(2 * n) for n, whole in repeats)
        self.points = np.prod(self._lengths)
        offsets = [np.arange(n // 2 + 1) for n in self._lengths]
        if quadrant is None:
            y, x = BLOCK * grid.dy * offsets[0][:, None], BLOCK * grid.dx * offsets[1]
            nearest = np.hypot(np.maximum(y - y[1], 0.0), np.maximum(x - x[1], 0.0))
            least = grid.cell_area * kernel.least_influence(nearest, np.hypot(y + y[1], x + x[1]))
        else:
            least = _least_coefficients(quadrant)
            least = least[np.ix_(*(np.minimum(k, n - 1) for k, n in zip(offsets, least.shape, strict=True)))]
        least = least[np.ix_(*(np.minimum(np.arange(n), n - np.arange(n)) for n in self._lengths))]
        self._spectrum, self._norm = fft.rfft2(least), np.linalg.norm(least)

    def displacement(self, cells, p):
        """Return a lower bound of the displacement in each block [mm].

        `cells` are the numbers of the cells with the pressures `p` [N/mm2]; all other cells have no pressure.
        """
        ny, nx = self._shape
        rows, columns = np.divmod(cells, self._grid.nx)
        blocks = rows // BLOCK * nx + columns // BLOCK
        pressures = np.bincount(blocks, p, ny * nx).reshape(ny, nx)
        u = fft.irfft2(fft.rfft2(pressures, self._lengths) * self._spectrum, self._lengths)[:ny, :nx]
        return u - _ROUNDING * self._norm * np.linalg.norm(pressures)

    def undecided(self, cells, p, depth):
        """Return the numbers of all local admissible cells that may penetrate, sorted.

        Every other one has a gap h + A p >= 0 for the pressures `p` in `cells`, at a `depth` [mm].
        """
        u = self.displacement(cells, p)
        blocks = np.argwhere(u < self._highest + depth)
        found = np.empty(len(blocks) * BLOCK**2, np.int64)
        return np.sort(found[: _collect(*self._fields, self._first, depth, u, blocks, found)])


def _least_coefficients(quadrant):
    """Return the least of the coefficients between cells of two blocks, by the offset of the blocks.

    Cells of blocks at an offset of k blocks have offsets of less than k + 1 and more than k - 1 blocks. Offsets beyond
    half a period have the coefficients of shorter ones, which are among these.
    """
    for _ in range(2):
        least = np.minimum.reduceat(quadrant, np.arange(0, len(quadrant), BLOCK), axis=0)
        least[1:] = np.minimum(least[1:], least[:-1])
        quadrant = least.T
    return quadrant


@njit_reassoc
def _raise_row(row, admissible, out):
    for i in range(row.size):
        out[i] = max(out[i], row[i] if admissible[i] else -np.inf)


@njit()
def _block_maxima(b, admissible, first, out, row):
    """Raise `out` to the maximum of each block's admissible cells; `row` is a work array of shape (nx,)."""
    for j in range(first // BLOCK, out.shape[0]):
        row[:] = -np.inf
        for k in range(max(j * BLOCK - first, 0), min((j + 1) * BLOCK - first, b.shape[0])):
            _raise_row(b[k], admissible[k], row)
        for i in range(row.size):
            out[j, i // BLOCK] = max(out[j, i // BLOCK], row[i])


@njit()
def _collect(b, admissible, first, depth, u, blocks, found):
    """Store the admissible cells of `blocks` with h + u < 0, where u is the bound; return their number."""
    count, (ny, nx) = 0, b.shape
    for k in range(blocks.shape[0]):
        j, i = blocks[k]
        for y in range(max(j * BLOCK - first, 0), min((j + 1) * BLOCK - first, ny)):
            for x in range(i * BLOCK, min((i + 1) * BLOCK, nx)):
                if admissible[y, x] and gap(u[j, i], b[y, x], depth) < 0:
                    found[count] = (first + y) * nx + x
                    count += 1
    return count
