"""The tilt of the bodies: h = shape - approach - x slope_x - y slope_y."""

from typing import NamedTuple

import numpy as np


class Tilt(NamedTuple):
    """Slopes by which the bodies are turned, about a pivot."""

    x: float = 0.0  # change of the approach per mm of x
    y: float = 0.0
    pivot_x: float = 0.0  # [mm]
    pivot_y: float = 0.0

    def rise(self, x, y):
        """Return what the tilt adds to the approach at a place [mm]."""
        return self.x * (x - self.pivot_x) + self.y * (y - self.pivot_y)


NO_TILT = Tilt()


def linear_sums(field, x, y):
    """Return the sums of ``field * f * g`` over the local cells, shape (3, 3), for f and g in 1, x and y.

    `x` and `y` are the coordinates of columns and rows.
    """
    rows = field @ np.stack([np.ones_like(x), x, x * x], axis=1)
    (total, in_x, in_xx), (in_y, in_xy, _) = rows.sum(axis=0), y @ rows
    return np.array([[total, in_x, in_y], [in_x, in_xx, in_xy], [in_y, in_xy, (y * y) @ rows[:, 0]]])
