"""Contact resistance of two rough surfaces against load.

Current crosses the interface only through the contact spots. Barber's theorem: the conductance of the contact is
2 dF/d(approach) / (E* (rho1 + rho2)). The incremental stiffness costs one more linear solve for each load.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

# %% Brass on copper, with constants for both conductances.
pair = Material.pair((100e3, 120e3), (0.34, 0.34))
pair = pair.conducting(resistivity=(6.5e-8, 1.7e-8), thermal_conductivity=(120, 390))  # ohm m, W/(m K)
grid = Grid.from_domain(256, 256, (0, 1, 0, 1))
surfaces = [SelfAffineSurface(0.8, 0.2, 0.03, (1, 1), seed=seed, rms_slope=0.05) for seed in (3, 4)]
problem = ContactProblem(grid, pair, surfaces=surfaces, periodic=True)

# %% A patch of 1 mm2 of nominally flat bodies, at ten mean pressures.
with ContactSolver(problem) as solver:
    path = solver.path(mean_pressure=np.geomspace(1, 300, 10), stiffness=True)
    solutions = list(path)
table = path.table
resistance = 1e6 / table["electrical_conductance"]  # micro-ohm
for p, r, g in zip(table["mean_pressure"], resistance, table["thermal_conductance"], strict=True):
    print(f"{p:6.1f} N/mm2: {r:7.2f} micro-ohm, {1e6 * g:8.0f} W/(m2 K)")

# %% Holm: one circular spot has the resistance rho / (4 a). A circle conducts least of all spots of its area.
spots, rho = [solution.patches() for solution in solutions], sum(pair.resistivity)
parallel = [1e6 * rho / (4e-3 * np.sqrt(spot.area / np.pi).sum()) for spot in spots]
cluster = [1e6 * rho / (4e-3 * np.sqrt(solution.contact_area / np.pi)) for solution in solutions]
power, _ = np.polyfit(np.log(table["mean_pressure"]), np.log(resistance), 1)
print(f"resistance proportional to load to the power {power:.3f}")

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
left.loglog(table["mean_pressure"], resistance, "o-", label="computed")
left.loglog(table["mean_pressure"], parallel, "--", label="as many circular spots far apart: ρ / (4 Σ a)")
left.loglog(table["mean_pressure"], cluster, ":", label="one circular spot of the same area")
left.set(xlabel="mean pressure [N/mm²]", ylabel="contact resistance of 1 mm² [µΩ]")
left.legend()
solutions[6].plot("contact", ax=right)
figure.savefig("contact_resistance.png", dpi=60)
