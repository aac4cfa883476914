"""Rough contact: a smooth rigid flat-ended circular punch on a rough elastic half-space (Sec. 5.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from app.problems.problem import Problem
from app.problems.surfaces import WavySurface


@dataclass(frozen=True)
class Punch(Problem):
    """Undeformed distance -z(x, y) under the punch; contact is impossible outside.

    Parameters
    ----------
    diameter : float
        Of the punch, centred at the origin [mm].
    surface : WavySurface
        Heights z of the half-space; positive approach moves the punch into the reference plane z = 0.
    """

    diameter: float = 1.0
    surface: WavySurface = field(default=None)

    name = "punch"

    def __post_init__(self):
        if not (np.isfinite(self.diameter) and self.diameter > 0):
            raise ValueError(f"punch diameter {self.diameter:g}: must be positive and finite")
        if not self.under_punch(self.grid).any():
            raise ValueError(
                f"punch diameter {self.diameter:g}: no cell centre of the patch lies under the punch"
            )

    def under_punch(self, grid, rows=slice(None)):
        """Cells whose centre is under the punch, shape (rows, nx). Not collective."""
        return grid.x()[None, :] ** 2 + grid.y(rows)[:, None] ** 2 <= (self.diameter / 2) ** 2

    def shape_on(self, grid, rows=slice(None)):
        """See `Problem.shape_on`."""
        return np.where(self.under_punch(grid, rows), -self.surface.height(grid.x(), grid.y(rows)), np.nan)

    def describe(self):
        """See `Problem.describe`."""
        surface = self.surface
        return {
            **super().describe(),
            "punch_diameter": self.diameter,
            "surface_seed": surface.seed,
            "surface_sigma": surface.sigma,
            "surface_decay": surface.decay,
            "surface_modes": list(surface.modes),
        }
