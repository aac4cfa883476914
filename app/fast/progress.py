"""Whether the iteration makes progress. Where it does not, `NeedsSafeguard` is raised."""

from __future__ import annotations

PATIENCE = 8  # iterations that do not halve the residual: there is no progress


class NeedsSafeguard(Exception):
    """The iteration makes no progress; ``outcome`` is what it came to."""

    def __init__(self, outcome):
        super().__init__(outcome.reason)
        self.outcome = outcome


class Progress:
    """Of the residual: in every iteration, and from product to product. Not collective.

    Parameters
    ----------
    norm : float
        Of the residual to begin with [mm].

    Attributes
    ----------
    by_product : float
        Norm by the last product, which is right whatever multiplies in between [mm].
    """

    def __init__(self, norm):
        self.by_product = self._least_by_product = norm
        self._products = self._iterations = 0  # since the residual was halved
        self._best = float("inf")

    def after_product(self, norm):
        """Take note of what a product tells of the residual [mm]."""
        self._best = max(self.by_product, norm)  # more where a load has let cells in
        self.by_product, self._products = norm, self._products + 1
        if norm <= 0.5 * self._least_by_product:
            self._least_by_product, self._products = norm, 0

    def after_iteration(self, norm):
        """Take note of the residual after an iteration [mm]."""
        self._iterations += 1
        if norm <= 0.5 * self._best:
            self._best, self._iterations = norm, 0

    @property
    def stalls(self):
        """Whether there is none, from iteration to iteration."""
        return self._iterations >= PATIENCE

    @property
    def stalls_by_products(self):
        """Whether there is none, from product to product."""
        return self._products >= PATIENCE
