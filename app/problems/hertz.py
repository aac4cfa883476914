"""Hertzian contact: two paraboloids (Sec. 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.problems.problem import Problem


@dataclass(frozen=True)
class Hertz(Problem):
    """Undeformed distance x^2 / (2 Rx) + y^2 / (2 Ry).

    Parameters
    ----------
    rx, ry : float
        Principal relative radii of curvature [mm].
    """

    rx: float = 1.0
    ry: float = 1.0

    name = "hertz"

    def __post_init__(self):
        for axis, radius in (("rx", self.rx), ("ry", self.ry)):
            if not (np.isfinite(radius) and radius > 0):
                raise ValueError(f"radius of curvature {axis} = {radius:g}: must be positive and finite")

    def shape_on(self, grid, rows=slice(None)):
        """See `Problem.shape_on`."""
        return grid.x()[None, :] ** 2 / (2 * self.rx) + grid.y(rows)[:, None] ** 2 / (2 * self.ry)

    def reference(self, approach):
        """Elliptic Hertz solution; None on a periodic patch."""
        if self.grid.periodic:
            return None
        from app.reference.hertz import EllipticHertz

        return EllipticHertz.from_approach(self.rx, self.ry, self.material.contact_modulus, approach)

    def describe(self):
        """See `Problem.describe`."""
        return {**super().describe(), "hertz_rx": self.rx, "hertz_ry": self.ry}
