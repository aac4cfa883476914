"""Wear of a ball, in implicit steps.

A ball slides on a hard plate. By Archard's law it loses k p ds of height on a path ds. The pressure of a step is that
at its end: with the pressure before, steps of more than 0.2 dx / (k E*) would oscillate.
"""

import matplotlib.pyplot as plt

from app import ContactProblem, ContactSolver, Grid, Material, Sphere

steel = Material.isotropic(210e3, 0.3)
grid = Grid.from_domain(96, 96, (-0.36, 0.36, -0.36, 0.36))
load, ball = 50, Sphere(10)
k, path = 1e-9, 50  # wear coefficient [mm2/N], sliding path of a step [mm]

# %% Eighty implicit steps, which do not oscillate however long they are.
history = []
with ContactSolver(ContactProblem(grid, steel, ball)) as solver:
    history.append((0, solver.solve(load=load)))
    wear = solver.wear(k, 80 * path, 80, load=load)
    for step, solution in enumerate(wear, 1):
        if step % 20 == 0:
            history.append((step * path, solution))
            print(
                f"{step * path:5} mm: maximum pressure {solution.max_pressure:6.1f} N/mm2, contact "
                f"{solution.contact_area:.4f} mm2, worn off {solution.worn_volume:.3e} mm3"
            )
worn = solution.worn_depth
print(f"Archard: the volume is k F s = {k * load * step * path:.3e} mm3")

# %% The pressure becomes flat, and the contact grows.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
middle = grid.ny // 2
for s, solution in history:
    left.plot(solution.x, solution.pressure[middle], label=f"after {s} mm")
left.set(xlabel="x [mm]", ylabel="pressure [N/mm²]")
left.legend()
right.plot(grid.x(), 1e3 * grid.x() ** 2 / 20, "--", label="new ball")
right.plot(grid.x(), 1e3 * (grid.x() ** 2 / 20 + worn[middle]), label="worn ball")
right.set(xlabel="x [mm]", ylabel="height of the surface [µm]")
right.legend()
figure.savefig("wear.png", dpi=60)
