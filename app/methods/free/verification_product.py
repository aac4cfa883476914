"""The verification product of a window: u = A p in double precision, on all cells of the target grid, by all ranks.

Ranks that have no part in the window wait while it is worked on: from `end` they take part in every product, until the
ranks of the window get there, too.
"""

from __future__ import annotations

import numpy as np

_PRODUCT = "product"  # what waiting ranks are told before one


class VerificationProduct:
    """The exact product of a window's operator.

    Parameters
    ----------
    target : InfluenceOperator
        Of the whole grid.
    scatter : Scatter
        Between it and the window.
    inner : Slabs
        Of the window.
    ranks : Ranks
        All.

    Attributes
    ----------
    u : ndarray, shape (local rows of the target, nx), or None
        The last product, if it is not forgotten.
    """

    count = flops = 0  # its products are those of the target grid's operator

    def __init__(self, target, scatter, inner, ranks):
        self._target, self._scatter, self._inner = target, scatter, inner
        self._waiting = ranks.idle_comm(inner.size)
        self._scaled = None
        self.u = None

    def apply(self, p, u):
        """Compute u = A p in the window and everywhere else. Collective over the ranks of the window."""
        if self._waiting:
            self._waiting.bcast_or_raise(_PRODUCT)
        self.by_all(p, u)

    def by_all(self, p, u):
        """As `apply`, for ranks that have no part in the window, too. Collective over all ranks."""
        if self.u is None:
            self.u = np.empty(self._target.local_shape)
        self.u[...] = 0
        self._scatter.reverse(p, self.u, self._target.exact_product.working_storage)
        self._target.exact_displacement(self.u, self.u)
        self._scatter.forward(self.u, u)

    def forget(self):
        """Free the last product: p changes. Not collective."""
        self.u = None

    def end(self, state):
        """Take part in the products for the `state` of the window, until there are no more. Collective over all ranks.

        What p has been multiplied by since the last one is told in the end; None if that is forgotten.
        """
        self._scaled = None if self.u is None else state.scaled
        if self._waiting and self._inner.active:
            self._waiting.bcast_or_raise(self._scaled)
        elif self._waiting:
            nothing = np.empty(state.u.shape)
            while (told := self._waiting.bcast_or_raise()) == _PRODUCT:
                self.by_all(nothing, nothing)
            self._scaled = told

    def displacement(self, state, converged):
        """Return A p for the p that `state` has ended with; another product, if need be. Collective over all ranks."""
        if self._scaled is None or not converged:
            self.by_all(state.p, state.u)
        elif self._scaled != 1.0:
            self.u *= self._scaled
        return self.u
