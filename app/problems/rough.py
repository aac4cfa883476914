"""Self-affine rough surface under a flat rigid body, or two of them by their combined heights."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from app.problems.problem import Problem
from app.problems.surfaces import SelfAffineSurface


@dataclass(frozen=True)
class Rough(Problem):
    """Undeformed distance -z(x, y), counted from the mean plane of the surface: at approach 0 the flat body is there.

    So the mean gap of a periodic patch is minus the approach, and contact begins at minus the highest peak.

    Parameters
    ----------
    surface : SelfAffineSurface
        Heights z [mm].

    Raises
    ------
    ValueError
        If the grid cannot carry the shortest wave.
    """

    surface: SelfAffineSurface = field(default=None)

    name = "rough"
    sampled = True  # what a coarse grid cannot carry is averaged, not seen as some other wave
    refinable = True

    def __post_init__(self):
        check_cut_off(self.grid, self.surface.shortest_wavelength)

    def shape_on(self, grid, rows=slice(None)):
        """See `Problem.shape_on`."""
        return np.negative(self.surface.height(grid.x(), grid.y(rows)))

    def describe(self):
        """See `Problem.describe`."""
        surface = self.surface
        return {
            **super().describe(),
            "surface_hurst": surface.hurst,
            "surface_rolloff": surface.rolloff_wavelength,
            "surface_cutoff": surface.shortest_wavelength,
            "surface_rms_slope": surface.rms_slope,
            "surface_rms_height": surface.rms_height,
            "surface_seed": surface.seed,
        }


def check_cut_off(grid, shortest):
    """Refuse waves [mm] shorter than two cells of a grid. Not collective.

    Raises
    ------
    ValueError
        Names the grid that carries them.
    """
    if shortest < 2 * max(grid.dx, grid.dy) * (1 - 1e-12):
        sides = (grid.nx * grid.dx, grid.ny * grid.dy)
        nx, ny = (int(np.ceil(2 * side / shortest * (1 - 1e-12))) for side in sides)
        raise ValueError(
            f"surface cut-off {shortest:g}: cells of {grid.dx:g} x {grid.dy:g} mm cannot carry waves that short; "
            f"needed: at least -grid {nx},{ny}, two cells to a wave"
        )
