"""Coating thickness against the stress below a coated contact.

A steel ball is pressed on a coated steel plate. A thick coating keeps the stress away from the substrate. A thin hard
coating does not: it concentrates the pressure, and the stress in the substrate grows a little. The bond between coating
and substrate carries the shear stress on the interface.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, EllipticHertz, Grid, Material, Sphere, solve, stress

# %% Without a coating the von Mises stress is largest at half the contact radius below the surface.
young, nu, load = 210e3, 0.3, 100
hertz = EllipticHertz.from_load(10, 10, Material.isotropic(young, nu).contact_modulus, load)
a, p0 = hertz.a, hertz.max_pressure
grid = Grid.from_domain(48, 48, (-1.6 * a, 1.6 * a, -1.6 * a, 1.6 * a))
plain = stress(solve(ContactProblem(grid, Material.isotropic(young, nu), Sphere(10)), load=load)).maximum()
print(f"without a coating: von Mises stress {plain.von_mises / p0:.3f} p0 at depth {plain.depth / a:.2f} a")


# %% Coatings of half, two and four times the modulus of steel, from 1/20 to 2 contact radii thick.
def stresses(ratio, thickness):
    """Return largest stresses over p0: von Mises in substrate and coating, shear on the interface."""
    material = Material.coated((ratio * young, young), (nu, nu), thickness * a, other=(young, nu))
    maxima = stress(solve(ContactProblem(grid, material, Sphere(10)), load=load)).layer_maxima()
    largest = maxima.substrate.von_mises, maxima.coating.von_mises, maxima.shear.horizontal_shear
    print(f"E {ratio:g}, thickness {thickness:.2f} a:", *(f"{value / p0:.3f}" for value in largest))
    return np.array(largest) / p0


thicknesses = np.geomspace(0.05, 2, 8)
table = {ratio: np.array([stresses(ratio, t) for t in thicknesses]) for ratio in (0.5, 2, 4)}

# %% Stresses against the thickness.
figure, panels = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
titles = (
    "von Mises stress in the substrate",
    "von Mises stress in the coating",
    "shear stress on the interface",
)
for k, (axes, title) in enumerate(zip(panels, titles, strict=True)):
    for ratio, rows in table.items():
        axes.semilogx(thicknesses, rows[:, k], "o-", label=f"E of the coating {ratio:g} × that of steel")
    if k < 2:
        axes.axhline(plain.von_mises / p0, color="0.5", linestyle=":", label="without a coating")
    axes.set(title=f"largest {title}", xlabel="coating thickness / contact radius", ylim=(0, None))
panels[0].set_ylabel("stress / Hertz's maximum pressure")
panels[0].legend()
figure.savefig("coating_thickness.png", dpi=60)
