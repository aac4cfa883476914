"""Whether the iteration makes progress. Where it does not, `NeedsSafeguard` is raised."""

from __future__ import annotations

PATIENCE = 8  # iterations that do not halve the residual: there is no progress


class NeedsSafeguard(Exception):
    """The iteration makes no progress; ``outcome`` is what it came to."""

    def __init__(self, outcome):
        super().__init__(outcome.reason)
        self.outcome = outcome


class HalvingTest:
    """Whether a number is halved from time to time. Not collective.

    Attributes
    ----------
    best : float
        What it is to be half of.
    """

    def __init__(self, best=float("inf")):
        self.best, self._since = best, 0

    def after(self, number, otherwise=False):
        """Take note of it after an iteration; `otherwise`: there was other progress."""
        self._since += 1
        if number <= 0.5 * self.best or otherwise:
            self.best, self._since = min(number, self.best), 0

    @property
    def stalls(self):
        """Whether it has not been for too long."""
        return self._since >= PATIENCE


class ResidualProgress:
    """Of the residual. Not collective.

    Parameters
    ----------
    norm : float
        Of the residual to begin with [mm].

    Attributes
    ----------
    iterations, products : HalvingTest
        In every iteration, and from product to product.
    by_product : float
        Norm by the last product, which is right whatever multiplies in between [mm].
    """

    def __init__(self, norm):
        self.by_product, self.products, self.iterations = norm, HalvingTest(norm), HalvingTest()

    def after_product(self, norm):
        """Take note of what a product tells of the residual [mm]."""
        self.iterations.best = max(self.by_product, norm)  # more where a load has let cells in
        self.by_product = norm
        self.products.after(norm)
