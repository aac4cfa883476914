"""Classes of a check, and of a measured number with its limits."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from app.base.errors import format_distinct


class Figure(NamedTuple):
    """Measured number with its limits (not a picture).

    A figure without limits is only reported.
    """

    what: str
    value: float
    least: float = -np.inf
    most: float = np.inf
    points: tuple = ()  # data behind the number, for a picture: two sequences

    @property
    def judged(self):
        """True if the figure has a limit."""
        return self.least > -np.inf or self.most < np.inf

    @property
    def passed(self):
        """True if the value is within its limits, which NaN is not."""
        return not self.judged or bool(self.least <= self.value <= self.most)

    @property
    def shown(self):
        """Value as text, with enough digits to distinguish it from its limits."""
        return max((format_distinct(self.value, bound) for bound in (self.least, self.most)), key=len)

    @property
    def limit(self):
        """Text of the limits of the value; empty if it has none."""
        low, high = (f"{bound:.3g}" for bound in (self.least, self.most))
        if self.least == self.most:
            return low
        if self.least > -np.inf and self.most < np.inf:
            return f"{low} to {high}"
        return f"≥ {low}" if self.least > -np.inf else f"≤ {high}" if self.most < np.inf else ""


class Check(NamedTuple):
    """One check, with its section in the verification document."""

    name: str  # on the command line
    title: str  # of the section
    law: str  # that is checked; the text of the section
    measure: Callable[[bool], Sequence[Figure]]  # ``measure(quick)``; small cases only if `quick`


def fit_order(sizes, errors):
    """Return the errors' order of convergence.

    `sizes` are the numbers of cells in a direction.
    """
    return float(-np.polyfit(np.log2(sizes), np.log2(errors), 1)[0])


def order_figure(what, sizes, errors, least, most=np.inf):
    """Return the `Figure` of an observed order of convergence."""
    return Figure(f"order of {what}", fit_order(sizes, errors), least, most, (tuple(sizes), tuple(errors)))
