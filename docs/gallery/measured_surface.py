"""A measured surface under a ball.

A map of heights comes from an instrument as a file. The script first writes such a file: a ground plate, heights in
micrometres, tilted as measured maps are.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, Material, SelfAffineSurface, Sphere, read_surface, roughness, solve

# %% A file, as an instrument writes it: 256 x 256 points, 2 um apart.
x = 0.002 * np.arange(256)
ground = SelfAffineSurface(0.8, 0.1, 0.016, (0.6, 0.6), seed=3, rms_slope=0.02)
np.savetxt("plate.txt", 1e3 * ground.height(x, x) + 2 * x + 3 * x[:, None], fmt="%.5f")

# %% Read it, remove the tilt, and look before solving.
surface = read_surface("plate.txt", "um", level="plane", spacing=(0.002, 0.002))
found = roughness(surface)
print(f"rms height {1e3 * found.rms_height:.3f} um, rms slope {found.rms_slope:.4f}")

# %% Press a ball on it. Its patch and cells are those of the file, about the origin.
steel = Material.isotropic(210e3, 0.3)
rough = solve(ContactProblem(surface.grid(), steel, Sphere(5), surfaces=[surface]), load=20)
smooth = solve(ContactProblem(surface.grid(), steel, Sphere(5)), load=20)
for name, solution in (("rough", rough), ("smooth", smooth)):
    print(
        f"{name:6} contact {1e6 * solution.contact_area:6.0f} um2, maximum {solution.max_pressure:5.0f} N/mm2, "
        f"approach {1e3 * solution.approach:.2f} um, {len(solution.patches().cells)} contact spots"
    )

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
rough.plot("contact", ax=left)
smooth.plot("pressure", ax=right)
figure.savefig("measured_surface.png", dpi=60)
