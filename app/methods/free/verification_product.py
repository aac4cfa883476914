"""Verification product of a window, on all cells.

It is u = A p in double precision. Ranks outside the window wait in `end` while the window is solved, and take part in
each product.
"""

import numpy as np

_PRODUCT = "product"  # broadcast to waiting ranks before a product


class VerificationProduct:
    """Exact product of a window's operator.

    Parameters
    ----------
    target : InfluenceOperator
        Of the whole grid; it counts the products.
    scatter : Scatter
        Between the grid and the window.
    inner : Slabs
        Of the window.
    ranks : RankGroups

    Attributes
    ----------
    u : ndarray, shape (local rows of the target, nx), or None
        Last product, until `forget`.
    """

    count = flops = 0

    def __init__(self, target, scatter, inner, ranks):
        self._target, self._scatter, self._inner = target, scatter, inner
        self._waiting = ranks.idle_comm(inner.size)
        self._scaled = self.u = None

    def apply(self, p, u):
        """Compute u = A p. Collective over the ranks of the window."""
        if self._waiting:
            self._waiting.bcast_or_raise(_PRODUCT)
        self.apply_on_all(p, u)

    def apply_on_all(self, p, u):
        """Compute u = A p on all ranks. Collective."""
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._scatter.reverse(p, self.u, self._target.exact_product.working_storage)
        self._target.exact_displacement(self.u, self.u)
        self._scatter.forward(self.u, u)

    def forget(self):
        """Free the last product: p changes."""
        self.u = None

    def end(self, state):
        """End the products for the `state` of the window. Collective.

        Ranks outside take part until then. The factor on p since the last product is broadcast in the end; None if that
        is forgotten.
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
        """Return A p for the final p of `state`. Collective."""
        if self._scaled is None or not converged:
            self.apply_on_all(state.p, state.u)
        elif self._scaled != 1.0:
            self.u *= self._scaled
        return self.u
