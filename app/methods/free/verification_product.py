"""Verification product of a window, on all cells of the grid.

The product u = A p is in double precision. The product shows whether the bodies penetrate outside the window. While the
window is solved, ranks outside the window wait in `VerificationProduct.end`, and take part in each product.
"""

import numpy as np

_PRODUCT = "product"  # broadcast to waiting ranks before a product


class VerificationProduct:
    """Product A p on all cells, for a pressure in a window.

    Outside the window p is zero. The product is in double precision. The window's operator has it as `exact_product`.

    Parameters
    ----------
    target : InfluenceOperator
        Operator of the whole grid; it also counts the products.
    scatter : Scatter
        Transfer of fields between the grid and the window.
    inner : Slabs
        Distribution of the window's rows.
    ranks : RankGroups
        Ranks of the whole grid.

    Attributes
    ----------
    u : ndarray, shape (local rows of the target, nx), or None
        Last product on all cells; None after `forget`.
    """

    count = flops = 0

    def __init__(self, target, scatter, inner, ranks):
        self._target, self._scatter, self._inner = target, scatter, inner
        self._waiting = ranks.idle_comm(inner.size)
        self._scaled = self.u = None

    def apply(self, p, u):
        """Compute u = A p in the window. Collective over its ranks.

        The product is computed on all cells of the grid by all ranks. The ranks outside the window wait in `end`, and
        take part from there.
        """
        if self._waiting:
            self._waiting.bcast_or_raise(_PRODUCT)
        self.apply_on_all(p, u)

    def apply_on_all(self, p, u):
        """Compute A p on the whole grid. Collective.

        Only its part in the window is copied to `u`.
        """
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._scatter.reverse(p, self.u, self._target.exact_product.working_storage)
        self._target.exact_displacement(self.u, self.u)
        self._scatter.forward(self.u, u)

    def forget(self):
        """Free the last product, which is no longer valid if p changes."""
        self.u = None

    def end(self, state):
        """End the products of a window. Collective.

        Ranks outside the window call this method first, and take part in products until the ranks of the window call
        it, too. Then all receive the factor by which p of `state` was scaled since the last product, or None after
        `forget`.
        """
        self._scaled = None if self.u is None else state.scaled
        if self._waiting and self._inner.active:
            self._waiting.bcast_or_raise(self._scaled)
        elif self._waiting:
            no_rows = np.empty(state.u.shape)
            while (message := self._waiting.bcast_or_raise()) == _PRODUCT:
                self.apply_on_all(no_rows, no_rows)
            self._scaled = message

    def displacement(self, state, converged):
        """Return A p on all cells, for the final p. Collective.

        `state` is the state in the window. If the window has `converged`, the last product is used.
        """
        if self._scaled is None or not converged:
            self.apply_on_all(state.p, state.u)
        elif self._scaled != 1.0:
            self.u *= self._scaled
        return self.u
