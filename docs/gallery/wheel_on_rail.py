"""A wheel on a rail whose head has two radii: no ellipse of Hertz.

The rail head has 300 mm radius in its middle and 80 mm towards the gauge corner. The wheel of 460 mm radius touches it
where the two arcs meet. So the contact is egg-shaped. The stress is largest below the surface.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, Material, fit_grid, solve, stress


def gap(x, y):
    """Return the undeformed distance [mm]: x along the rail, y across."""
    return x**2 / (2 * 460) + np.where(y < 0, y**2 / (2 * 300), y**2 / (2 * 80))


# %% The patch is fitted to the contact, wherever it is.
steel = Material.isotropic(210e3, 0.28)
grid = fit_grid(gap, steel, cells=128, load=80e3)
solution = solve(ContactProblem(grid, steel, gap), load=80e3)
print(solution.summary())

# %% Below the surface.
below = stress(solution)
hottest = below.maximum()
print(
    f"von Mises {hottest.von_mises:.0f} N/mm2 at x {hottest.x:.2f}, y {hottest.y:.2f}, depth {hottest.depth:.2f} mm"
)

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
solution.plot("pressure", ax=left)
solution.plot("section_y", ax=right)
left.plot(hottest.x, hottest.y, "r+", markersize=14)
left.set_title(f"largest stress {hottest.depth:.1f} mm below +")
figure.savefig("wheel_on_rail.png", dpi=60)
