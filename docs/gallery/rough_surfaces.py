"""Two rough surfaces: area of contact against load, and Persson's theory.

Both surfaces are self-affine; only the sum of their heights matters. The patch is periodic, a sample of large bodies.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

# %% Two surfaces on a patch of 1 x 1 mm with waves of 0.25 to 0.03 mm.
grid = Grid.from_domain(256, 256, (0, 1, 0, 1))
surfaces = [SelfAffineSurface(0.8, 0.25, 0.03, (1, 1), seed=seed, rms_slope=0.05) for seed in (1, 2)]
steel_on_aluminium = Material.pair((210e3, 70e3), (0.3, 0.33))
problem = ContactProblem(grid, steel_on_aluminium, surfaces=surfaces, periodic=True)

# %% Set up once, solve for many mean pressures.
with ContactSolver(problem) as solver:
    path = solver.path(mean_pressure=np.geomspace(20, 4000, 10))
    solutions = list(path)
for solution in solutions:
    print(
        f"{solution.mean_pressure:7.1f} N/mm2: {100 * solution.contact_fraction_corrected:5.2f}% in contact"
    )
table = path.table

# %% Persson's fraction belongs to the rms slope of the sum of both surfaces.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
left.loglog(table["mean_pressure"], table["contact_fraction_corrected"], "o", label="computed")
left.loglog(table["mean_pressure"], table["persson_fraction"], label="Persson")
left.loglog(table["mean_pressure"], table["bush_gibson_thomas_fraction"], "--", label="Bush, Gibson, Thomas")
left.set(xlabel="mean pressure [N/mm²]", ylabel="share of the area in contact")
left.legend()
solutions[3].plot("contact", ax=right)
figure.savefig("rough_surfaces.png", dpi=50)
