"""Wear: the gap is updated by the pressure, again and again.

A ball slides on a hard plate. By Archard's law it loses k p ds of height on a path ds. The solver is set up once; each
step replaces the gap and starts from the last solution.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, Sphere

steel = Material.isotropic(210e3, 0.3)
grid = Grid.from_domain(96, 96, (-0.36, 0.36, -0.36, 0.36))
load, ball = 50, Sphere(10)
k, path = 1e-9, 50  # wear coefficient [mm3/(N mm)], sliding path of a step [mm]

# %% Eighty times: solve, and remove what the pressure wears off.
worn, history = np.zeros(grid.shape), []
with ContactSolver(ContactProblem(grid, steel, ball)) as solver:
    solution = solver.solve(load=load)
    for step in range(81):
        if step % 20 == 0:
            history.append((step * path, solution))
            print(
                f"{step * path:5} mm: maximum pressure {solution.max_pressure:6.1f} N/mm2, contact "
                f"{solution.contact_area:.4f} mm2, worn off {worn.sum() * grid.cell_area:.3e} mm3"
            )
        worn += k * path * solution.pressure
        solver.update(ContactProblem(grid, steel, ball, surfaces=[-worn]))
        solution = solver.solve(load=load, start=solution)
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
