"""Test of progress, and the exception for lack of it."""

PATIENCE = 8  # iterations within which a residual must be halved


class NeedsSafeguard(Exception):
    """Lack of progress, with the Outcome so far."""

    def __init__(self, outcome):
        super().__init__(outcome.reason)
        self.outcome = outcome


class HalvingTest:
    """Test that a number is halved within PATIENCE iterations.

    Attributes
    ----------
    best : float
        Number to be halved.
    """

    def __init__(self, best=float("inf")):
        self.best, self._since = best, 0

    def update(self, number, otherwise=False):
        """Record the number, or `otherwise` other progress."""
        self._since += 1
        if number <= 0.5 * self.best or otherwise:
            self.best, self._since = min(number, self.best), 0

    @property
    def stagnates(self):
        """True if the number was not halved for PATIENCE iterations."""
        return self._since >= PATIENCE
