"""Point relaxations to compare exact Gauss-Seidel with; same interface as `GaussSeidel.sweep`.

All compute a correction d from the masked defect r, zero outside the contact set C; the caller adds it to the
solution. With D the diagonal of A:

==========  =====================================================  ==========================
relaxation  correction                                             products with A in a sweep
==========  =====================================================  ==========================
Jacobi      ``D d = omega r``                                      none
red-black   ``D d_red = omega r_red``, then                        one
            ``D d_black = omega (r - A d_red)_black``
==========  =====================================================  ==========================

A is dense, so red cells do act on each other: unlike for a five-point stencil, all red cells at once is a
Jacobi step on them, not Gauss-Seidel in another order.
"""

from __future__ import annotations

import numpy as np


class Jacobi:
    """Damped Jacobi.

    Parameters
    ----------
    diagonal : float
        D, the influence of a cell on itself [mm / (N/mm2)].
    """

    products_per_sweep = 0.0

    def __init__(self, diagonal):
        self.diagonal = diagonal

    def sweep(self, r, mask, omega, d, backward=False):
        """Compute d from r; see `app.halfspace.sweeps.gauss_seidel.GaussSeidel.sweep`. Not collective."""
        np.multiply(r, mask, out=d)
        d *= omega / self.diagonal


class RedBlack:
    """Red-black Gauss-Seidel: first all cells of one colour of a chequerboard, then the others.

    Parameters
    ----------
    diagonal : float
        D, the influence of a cell on itself [mm / (N/mm2)].
    convolve : callable
        ``convolve(p, out)`` computes out = A p on arrays of shape (local rows, nx).
    shape : (int, int)
        ``(local rows, nx)``.
    first_row : int
        Number of the first local row in the whole grid; cell (0, 0) of that grid is red.
    """

    products_per_sweep = 1.0

    def __init__(self, diagonal, convolve, shape, first_row=0):
        self.diagonal, self.convolve = diagonal, convolve
        rows, columns = np.ogrid[first_row : first_row + shape[0], : shape[1]]
        self._red = (rows + columns) % 2 == 0
        self._u = np.zeros(shape)

    def sweep(self, r, mask, omega, d, backward=False):
        """Compute d from r; see `app.halfspace.sweeps.gauss_seidel.GaussSeidel.sweep`.

        Collective if `convolve` is. A backward sweep starts with the black cells.
        """
        weight = omega / self.diagonal
        first = mask & (self._red != backward)
        np.multiply(r, first, out=d)
        d *= weight
        self.convolve(d, self._u)
        np.subtract(r, self._u, out=self._u)
        self._u *= weight
        np.copyto(d, self._u, where=mask & ~first)
