"""A tilted roller: how much misalignment a crown allows.

Shafts bend, so the rollers of a bearing are loaded off centre. Bearing makers print the largest pressure against the
misalignment, the angle between roller and raceway in minutes of arc. A straight roller has high pressures at its ends
at any angle; the logarithmic profile delays the edge stress to some minutes.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Material, Roller, fit_grid
from app.reference.line import LineContact

steel = Material.isotropic(210e3, 0.3)
radius, length, load = 10, 16, 10e3  # relative radius, length [mm]; load, half of the design load [N]
line = LineContact(radius, length, steel.contact_modulus, load)
minute = np.pi / 180 / 60  # minute of arc [rad]
angles = np.array([0, 1, 2, 3, 4, 6, 8])

# %% Three rollers, turned by a prescribed tilt about the x axis under one load.
log = {"crown": "log", "design_load": 2 * load, "contact_modulus": steel.contact_modulus}
rollers = {
    "straight": Roller(radius, length),
    "arc of 3 m": Roller(radius, length, crown="arc", crown_radius=3000),
    "logarithmic": Roller(radius, length, **log),
}
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
for name, roller in rollers.items():
    grid = fit_grid(roller, steel, cells=(32, 256), load=load)
    with ContactSolver(ContactProblem(grid, steel, roller)) as solver:
        solver.quiet = True
        turned = [solver.solve(load=load, tilt=(0, angle * minute)) for angle in angles]
        # The same by the centre of the load, under which the roller is free to tilt.
        offset = turned[3].pressure_centre_y
        balanced = solver.solve(load=load, load_centre=(0, offset))
        stiffness = solver.with_stiffness(balanced, tilts=True).tilt_stiffness
    right.plot(angles, [solution.max_pressure / line.max_pressure for solution in turned], "o-", label=name)
    print(f"{name:12} load {offset:.2f} mm off the middle: {balanced.tilt_y / minute:.2f} minutes, ", end="")
    print(f"{1e-3 * minute * stiffness[2, 2]:.3g} N m more moment for each minute")
for angle, solution in list(zip(angles, turned, strict=True))[::2]:  # of the logarithmic roller
    left.plot(solution.y, solution.pressure.max(axis=1), label=f"{angle}'")

# %% Pressure along the logarithmic roller, and the largest pressure of all.
left.set(xlabel="y [mm]", ylabel="largest pressure across [N/mm²]", title="logarithmic roller, turned")
right.set(
    xlabel="misalignment [minutes of arc]", ylabel="largest pressure / that of a line contact", ylim=(0, 5)
)
left.legend()
right.legend()
figure.savefig("tilted_roller.png", dpi=60)
