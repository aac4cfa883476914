"""Test of an iteration's progress, and the exception for missing progress."""

STAGNATES, TOO_MANY = "the residual stagnates", "{} active set iterations were not enough"
PATIENCE = 8  # iterations within which a residual must be halved


class NeedsSafeguard(Exception):
    """Raised if an iteration makes no progress.

    The attribute `outcome` is its Outcome.
    """

    def __init__(self, outcome):
        super().__init__(outcome.reason)
        self.outcome = outcome


class HalvingTest:
    """Test whether a number is halved within PATIENCE iterations.

    Attributes
    ----------
    best : float
        Value that must be halved next.
    """

    def __init__(self, best=float("inf")):
        self.best, self._since = best, 0

    def update(self, number, otherwise=False):
        """Record an iteration's `number`, and whether it is halved.

        If `otherwise` is true, the iteration has made another kind of progress, which counts like halving.
        """
        self._since += 1
        if otherwise or (number <= 0.5 * self.best and number < self.best):  # 0 is not halved again
            self.best, self._since = min(number, self.best), 0

    @property
    def stagnates(self):
        """True if PATIENCE iterations did not halve the value."""
        return self._since >= PATIENCE
