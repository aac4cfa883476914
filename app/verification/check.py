"""A check measures figures; a figure knows its limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.base.errors import format_distinct


@dataclass(frozen=True)
class Figure:
    """A number that was measured, and where it has to lie.

    Parameters
    ----------
    what : str
    value : float
    least, most : float
        Limits, both allowed; without them the number is only told.
    points : pair of sequences of float
        What it was made from, for a picture.
    """

    what: str
    value: float
    least: float = -np.inf
    most: float = np.inf
    points: tuple = field(default=(), repr=False, compare=False)

    @property
    def judged(self):
        """Whether it has a limit."""
        return self.least > -np.inf or self.most < np.inf

    @property
    def passed(self):
        """Whether it keeps its limits; NaN does not."""
        return not self.judged or bool(self.least <= self.value <= self.most)

    @property
    def shown(self):
        """The value, with digits enough to tell it from its limits."""
        return max((format_distinct(self.value, bound) for bound in (self.least, self.most)), key=len)

    @property
    def limit(self):
        """The limits in words."""
        low, high = (f"{bound:.3g}" for bound in (self.least, self.most))
        if self.least == self.most:
            return low
        if self.least > -np.inf and self.most < np.inf:
            return f"{low} to {high}"
        return f"≥ {low}" if self.least > -np.inf else f"≤ {high}" if self.most < np.inf else ""


@dataclass(frozen=True)
class Check:
    """One subject of the document.

    Parameters
    ----------
    name : str
        On the command line.
    title : str
    law : str
        What has to hold, for the reader.
    measure : callable
        ``measure(quick) -> sequence of Figure``; `quick`: small cases only.
    """

    name: str
    title: str
    law: str
    measure: Callable[[bool], Sequence[Figure]]


def order(sizes, errors):
    """Order in the cell size that errors on grids of so many cells fall with: slope of the fitted line."""
    return float(-np.polyfit(np.log2(sizes), np.log2(errors), 1)[0])


def order_figure(what, sizes, errors, least, most=np.inf):
    """Figure of an observed order."""
    return Figure(f"order of {what}", order(sizes, errors), least, most, (tuple(sizes), tuple(errors)))
