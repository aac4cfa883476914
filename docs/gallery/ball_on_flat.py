"""A ball on a flat, against Hertz.

A steel ball of 10 mm radius is pressed on a steel plate by 100 N. Lengths are in mm, forces in N, stresses in N/mm2.
"""

import matplotlib.pyplot as plt

from app import ContactProblem, EllipticHertz, Material, Sphere, fit_grid, solve

# %% The problem: a material, a shape, and a grid around the contact.
steel = Material.isotropic(210e3, 0.3)  # Young's modulus, Poisson's ratio
grid = fit_grid(Sphere(10), steel, cells=128, load=100)
solution = solve(ContactProblem(grid, steel, Sphere(10)), load=100)
print(solution.summary())

# %% Hertz knows the answer.
exact = EllipticHertz.from_load(10, 10, steel.contact_modulus, 100)
for name in ("approach", "max_pressure", "contact_area"):
    computed, known = getattr(solution, name), getattr(exact, name)
    print(f"{name:13} {computed:.6g}, by Hertz {known:.6g}, deviation {100 * (computed / known - 1):+.3f}%")

# %% The pressure, and its section through the middle.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
solution.plot("pressure", ax=left)
middle = grid.ny // 2
right.plot(solution.x, solution.pressure[middle], ".", label="computed")
right.plot(solution.x, exact.pressure(solution.x, solution.y[middle]), label="Hertz")
right.set(xlabel="x [mm]", ylabel="pressure [N/mm²]")
right.legend()
figure.savefig("ball_on_flat.png", dpi=60)
