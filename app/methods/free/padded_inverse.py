"""Inverse of A's periodic continuation, for fields continued past the patch boundary.

A residual that ends at the patch boundary jumps there. The energy of a jump is in short waves. Where a stiff layer lies
on a soft substrate, short waves have much energy compared with long ones, so this energy slows CG down. Therefore the
residual is continued by some cells past the boundary, where it decays linearly to zero: B is replaced by W^T B W, with
the continuation W. On half-spaces W gains nothing. In a direction in which the patch repeats, there is no boundary.
"""

import numpy as np

from app.halfspace.fft.multiplier import SERIAL
from app.halfspace.grid import Grid
from app.methods.multilevel_operators import create_circulant_inverse
from app.parallel.slabs import Slabs

PADDING = 8  # cells past the boundary; the number is even, like the rows of a coarse cell
_WEIGHTS = np.arange(1, PADDING + 1) / (PADDING + 1)  # of the cells up to the boundary


class PaddedInverse:
    """Product with W^T B W. Collective over the ranks of the layout.

    B is the inverse of the periodic continuation of A. W continues fields past the patch boundary.

    The parameters are as in `create_circulant_inverse`.

    Attributes
    ----------
    periods : (int, int)
        Periods of B in y and x.
    flops : int
        Operations of a product with B on this rank.
    """

    def __init__(self, grid, kernel, layout=SERIAL):
        in_y, self._in_x = (0 if repeats else PADDING for repeats in grid.repeats)
        slabs, ny = layout.slabs or Slabs(grid.ny), grid.ny + 2 * in_y
        starts = [
            ny if start == grid.ny else start + in_y * (start > 0) for start in slabs.starts
        ]  # the ranks with the first and last rows have the cells beyond
        around = Slabs.starting(starts, slabs.rank)
        padded = Grid(grid.nx + 2 * self._in_x, ny, grid.dx, grid.dy, periodic=grid.one_way)
        self._inverse = create_circulant_inverse(padded, kernel, layout._replace(slabs=around), apart=True)
        self.periods, self.flops = self._inverse.periods, self._inverse.flops
        self._field = np.zeros((around.local, padded.nx), layout.dtype)
        self._rows = np.ones(around.local, bool)
        self._weights = _WEIGHTS.astype(layout.dtype)
        below = in_y if slabs.local and slabs.rows.start == 0 else 0
        self._inside = slice(below, below + slabs.local)

    @property
    def points(self):
        """Number of cells transformed by FFT so far."""
        return self._inverse.points

    def apply(self, p, out, rows=None):
        """Compute out = W^T B W p; see `MultilevelOperator.apply`."""
        field, weights, size, inside = self._field, self._weights, PADDING, self._inside
        self._rows[:] = True
        if rows is not None:
            self._rows[inside] = rows
        middle = field[inside, self._in_x : field.shape[1] - self._in_x]
        middle[...] = p
        middle[~self._rows[inside]] = 0
        sides = (field[inside], field[inside, ::-1]) if self._in_x else ()
        for part in sides:
            part[:, :size] = part[:, size : size + 1] * weights
        ends = [field] * (inside.start > 0) + [field[::-1]] * (inside.stop < len(field))
        for part in ends:
            part[:size] = weights[:, None] * part[size]
        self._inverse.apply(field, field, rows=self._rows)
        for part in ends:
            part[size] += weights @ part[:size]
        for part in sides:
            part[:, size] += part[:, :size] @ weights
        out[...] = middle
