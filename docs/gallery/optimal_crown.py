"""The crown of a roller that minimises the largest pressure, found by its derivatives.

The maximum is not smooth, so a p-norm of the pressure takes its place. One solve gives its value. Two more linear
solves give its derivatives with respect to the height of every cell, and so to any number of parameters of the crown.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

from app import ContactProblem, ContactSolver, Material, Roller, fit_grid
from app.reference.line import LineContact

steel = Material.isotropic(210e3, 0.3)
radius, length, load, norm = 10, 16, 20e3, 32  # relative radius, length [mm]; load [N]; p of the p-norm
line = LineContact(radius, length, steel.contact_modulus, load)
roller = Roller(radius, length)
grid = fit_grid(roller, steel, cells=(48, 384), load=load)

# %% The drop of the profile is a sum of powers of y over half the length, with coefficients in micrometres.
powers = np.abs(2 * grid.y()[:, None] / length) ** [2, 4, 8, 16, 32]
across = np.ones(grid.nx)
evaluations = []


def solve(coefficients):
    """Return the solution for a crown."""
    drop = 1e-3 * powers @ coefficients
    solver.update(ContactProblem(grid, steel, roller, surfaces=[-np.outer(drop, across)]))
    return solver.solve(load=load)


def objective(coefficients):
    """Return the p-norm of the pressure over that of a line contact, and its gradient."""
    solution = solve(coefficients)
    p = solution.pressure / line.max_pressure
    value = np.mean(p**norm) ** (1 / norm)
    slope = p ** (norm - 1) * value ** (1 - norm) / (p.size * line.max_pressure)  # with respect to pressures
    shape = solver.sensitivity(solution, slope)  # with respect to the undeformed distance of each cell
    evaluations.append(solution.max_pressure)
    return value, 1e-3 * powers.T @ shape.sum(axis=1)


# %% From a circular arc of 1.5 m to the best crown. Each evaluation is one solve and two linear solves.
arc = np.array([1e3 * (length / 2) ** 2 / (2 * 1500), 0, 0, 0, 0])
with ContactSolver(ContactProblem(grid, steel, roller)) as solver:
    found = minimize(objective, arc, jac=True, method="L-BFGS-B", bounds=[(0, None)] * len(arc))
    solutions = {"straight": solve(0 * arc), "arc of 1.5 m": solve(arc), "best": solve(found.x)}
for name, solution in solutions.items():
    print(f"{name:12} maximum {solution.max_pressure:5.0f} N/mm2")
print(f"line contact {line.max_pressure:.0f} N/mm2; {len(evaluations)} evaluations; {found.x.round(2)} um")

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
for (name, solution), crown in zip(solutions.items(), (0 * arc, arc, found.x), strict=True):
    left.plot(grid.y(), np.where(abs(grid.y()) < length / 2, powers @ crown, np.nan), label=name)
    right.plot(grid.y(), solution.pressure.max(axis=1), label=name)
right.axhline(line.max_pressure, color="0.5", linestyle="--", label="line contact")
left.set(xlabel="y [mm]", ylabel="drop of the profile [µm]", ylim=(-0.5, 25))
right.set(xlabel="y [mm]", ylabel="largest pressure across [N/mm²]", ylim=(0, 2 * line.max_pressure))
left.legend()
right.legend()
figure.savefig("optimal_crown.png", dpi=60)
