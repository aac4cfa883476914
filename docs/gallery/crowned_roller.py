"""A roller with ends: why bearing rollers have a crown.

A straight roller carries an infinite pressure at its ends. The logarithmic profile of Lundberg, and of Johns and Gohar,
falls by some micrometres towards the ends, so that the pressure is nearly the same along the roller at the design load.
"""

import matplotlib.pyplot as plt

from app import ContactProblem, Material, Roller, fit_grid, solve
from app.reference.line import LineContact

steel = Material.isotropic(210e3, 0.3)
radius, length, load = 10, 16, 20e3  # relative radius, length [mm]; design load [N]
line = LineContact(radius, length, steel.contact_modulus, load)

# %% Three rollers under the same load.
log = {"crown": "log", "design_load": load, "contact_modulus": steel.contact_modulus}
rollers = {
    "straight": Roller(radius, length),
    "arc of 1.5 m": Roller(radius, length, crown="arc", crown_radius=1500),
    "logarithmic": Roller(radius, length, **log),
}
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
for name, roller in rollers.items():
    grid = fit_grid(roller, steel, cells=(64, 512), load=load)
    solution = solve(ContactProblem(grid, steel, roller), load=load)
    along = solution.pressure.max(axis=1)  # the largest across, for every y
    print(f"{name:12} maximum {along.max():5.0f}, in the middle {along[len(along) // 2]:5.0f} N/mm2")
    left.plot(solution.y, 1e3 * roller.drop(solution.y), label=name)
    right.plot(solution.y, along, label=name)
print(f"line contact {line.max_pressure:.0f} N/mm2")

# %% Profile and pressure along the roller.
right.axhline(line.max_pressure, color="0.5", linestyle="--", label="line contact")
left.set(xlabel="y [mm]", ylabel="drop of the profile [µm]")
right.set(xlabel="y [mm]", ylabel="largest pressure across [N/mm²]", ylim=(0, 2.2 * line.max_pressure))
left.legend()
right.legend()
figure.savefig("crowned_roller.png", dpi=60)
