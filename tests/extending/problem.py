# tests/extending/problem.py
from dataclasses import dataclass

import numpy as np

from app.options.option_table import Option, positive
from app.problems.problem import Problem


def rounded_punch(x, y):
    r = np.hypot(x, y)
    return np.where(r <= 4, np.maximum(r - 3, 0) ** 2 / 20, np.nan)


@dataclass(frozen=True)
class Cone(Problem):
    """Undeformed distance slope * r; option -cone_slope."""

    slope: float = 0.1

    OPTIONS = (Option("cone_slope", positive, 0.1, "height over radius"),)
    name = "cone"

    @classmethod
    def from_options(cls, grid, material, options):
        return cls(grid, material, options["cone_slope"])

    def shape_on(self, grid, rows=slice(None)):
        return self.slope * np.hypot(grid.x()[None, :], grid.y(rows)[:, None])

    def describe(self):
        return super().describe() | {"cone_slope": self.slope}
