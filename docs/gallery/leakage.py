"""Leakage of a seal, and the load at which it stops.

A rubber seal is pressed on a rough metal face. Fluid flows through the gap that is left. If the contact spots join, no
open path is left from one side to the other: the gap does not percolate, and the flow stops.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

# %% A rubber seal on a rough face, periodic in x and y, a sample of a large face.
grid = Grid.from_domain(256, 256, (0, 1, 0, 1))
face = SelfAffineSurface(0.8, 0.25, 0.03, (1, 1), seed=4, rms_slope=0.1)
problem = ContactProblem(grid, Material.pair((10, np.inf), (0.5, 0.3)), surfaces=[face], periodic=True)

# %% The leak curve, and the mean pressures between which the gap closes.
with ContactSolver(problem) as solver:
    path = solver.path(mean_pressure=np.linspace(0.04, 0.4, 10), flow=True)
    solutions = list(path)
    table = path.table
    is_open = table["percolates_x"]
    low, high = table["mean_pressure"][is_open].max(), table["mean_pressure"][~is_open].min()
    while high > 1.01 * low:
        middle = solver.solve(mean_pressure=(low + high) / 2)
        low, high = (
            (middle.mean_pressure, high) if middle.flow().percolates_x else (low, middle.mean_pressure)
        )
for solution in solutions:
    flow = solution.flow()
    print(
        f"{solution.mean_pressure:.2f} N/mm2: {solution.contact_fraction:.1%} in contact, hydraulic aperture "
        f"{1e3 * flow.hydraulic_aperture_x:.3g} um, within {flow.flow_error:.1g}"
    )
print(
    f"the gap closes in x between {low:.4f} and {high:.4f} N/mm2, at {middle.contact_fraction:.1%} in contact"
)

# %% The flow of water (1e-9 N s/mm2) through a seal of 1 mm x 100 mm, at a pressure drop of 0.1 N/mm2.
rate = table["transmissivity_x"] * 100 / 1 * 0.1 / 1e-9

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
left.semilogy(table["mean_pressure"][is_open], rate[is_open], "o-")
left.axvline(low, color="0.5", linestyle="--", label="the gap closes")
left.set(xlabel="mean pressure [N/mm²]", ylabel="leakage [mm³/s]")
left.legend()
solution = solutions[3]
flux = np.hypot(solution.flow().flux_x, solution.flow().flux_y)
picture = right.imshow(
    np.where(flux > 0, solution.flow().fluid_pressure, np.nan), origin="lower", extent=(0, 1, 0, 1)
)
figure.colorbar(picture, label=f"fluid pressure at {solution.mean_pressure:.2f} N/mm² (white: contact)")
right.contour(grid.x(), grid.y(), flux / flux.max(), levels=[0.05], colors="white", linewidths=0.6)
right.set(xlabel="x [mm]", ylabel="y [mm]", title="the lines enclose the largest fluxes")
figure.savefig("leakage.png", dpi=50)
